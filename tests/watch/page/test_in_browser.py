"""The page as people see it, in headless Chromium: content, live, long runs, a dropped server, keys, contrast."""

from __future__ import annotations

import fcntl
import json
import time
from collections.abc import Iterator

import chromium
import numpy as np
import pytest
from chromium import Browser
from histories import largest_angle, refused
from matplotlib import colormaps
from shown_page import PAINTED, serving, show, stored

from mesh_motion_server.watch.pictures.palette import INVERTED_COLOUR, QUALITY_MAP
from proofs.server_process import ServerProcess

pytest.importorskip("uvicorn", reason="the extra monitor is not installed")
pytestmark = [pytest.mark.slow, pytest.mark.skipif(bool(chromium.missing()), reason=chromium.missing())]

LONG, SHORT, THIRD = ("1" * 32, "2" * 32, "3" * 32)
STEPS = 3000


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ServerProcess]:
    with serving(tmp_path_factory.mktemp("server")) as served:
        stored(served.state, SHORT, "<b>flag</b>", 120)
        stored(served.state, THIRD, "wing", 40)
        stored(served.state, LONG, "long run", STEPS, iterations=1)
        yield served


def test_three_sessions_and_what_is_known_of_one(tab: Browser, server: ServerProcess) -> None:
    show(tab, server, SHORT)
    rows = tab.texts("#sessions li")
    assert len(rows) == 3
    assert any("long run" in row for row in rows)
    assert tab.text("#label") == "<b>flag</b>"  # what a client calls itself stays text
    assert "trial" not in tab.text("#figures")
    assert len(tab.texts("#worst tbody tr")) == 10
    assert "triangle" in tab.texts("#worst tbody tr")[0]
    assert tab.text("#faces-of") == "step 120"
    told = tab.texts("#faces tbody tr")[0].split("\t")
    assert told == ["largest non-orthogonality", "24.5°", f"{largest_angle(120):.1f}°"]
    assert len(tab.texts("#faces tbody tr")) == 5
    assert any("refused" in line or "_" in line for line in tab.texts("#events .code"))
    assert "threshold 0.2" in tab.run("return document.querySelector('#quality .plot').getAttribute('aria-label')")
    tab.run("document.getElementById('as-table').open = true")
    assert len(tab.wait(lambda: tab.texts("#history-table tbody tr"), "the table")) == 60
    assert tab.complaints() == []


def test_the_mesh_is_drawn_and_a_cell_tells_who_it_is(tab: Browser, server: ServerProcess) -> None:
    show(tab, server, SHORT)
    assert len(tab.run(PAINTED)) > 20
    tab.run("document.getElementById('mesh').scrollIntoView({ block: 'center' })")
    tab.click("#mesh", 20, 30)
    tab.wait(lambda: tab.text("#mesh-said").startswith("triangle "), "the cell is named")
    assert "of partition 0" in tab.text("#mesh-said")
    tab.run("document.querySelector('#worst button').click()")
    assert "at" in tab.text("#mesh-said")


@pytest.mark.nightly
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_a_quality_has_the_colour_that_it_has_in_pictures(tab: Browser, server: ServerProcess, scheme: str) -> None:
    show(tab, server, SHORT, mesh=False, scheme=scheme)
    asked = (
        "import('/static/colours.js').then((m) => arguments[0]([...Array(256).keys()].map((k) => m.colourOf(k / 255))))"
    )
    drawn = colormaps[QUALITY_MAP](np.arange(256), bytes=True)[:, :3]
    # the page holds 33 colours of the map and draws straight lines between them
    np.testing.assert_allclose(tab.driver.execute_async_script(asked), drawn, atol=2.0)
    scale = "return [...document.getElementById('scale').getContext('2d').getImageData(0, 0, 256, 1).data]"
    np.testing.assert_allclose(np.reshape(tab.run(scale), (256, 4))[:, :3], drawn, atol=2.5)
    inverted = "return getComputedStyle(document.documentElement).getPropertyValue('--mesh-inverted').trim()"
    assert tab.run(inverted) == INVERTED_COLOUR


@pytest.mark.nightly
def test_many_steps_are_thinned_and_closer_where_one_looks(tab: Browser, server: ServerProcess) -> None:
    show(tab, server, LONG)
    columns = "return globalThis.monitor.history.columns"
    assert 1500 <= len(tab.run(columns)["step"]) <= 1501
    least = min(tab.run(columns)["actual_min"])
    tab.run("globalThis.monitor.history.zoom([1500, 1600])")
    tab.wait(lambda: len(tab.run(columns)["step"]) == 101, "single steps are shown")
    tab.run("document.getElementById('all-steps').click()")
    tab.wait(lambda: len(tab.run(columns)["step"]) >= 1500, "all steps are shown")
    assert min(tab.run(columns)["actual_min"]) == least


@pytest.mark.nightly
def test_what_comes_is_shown_without_a_reload(tab: Browser, server: ServerProcess) -> None:
    show(tab, server, SHORT)
    segments = sorted((server.state / "sessions" / SHORT / "history").glob("events-*"))
    lines = [json.loads(line) for line in segments[-1].read_text().splitlines()]
    committed = next(event for event in reversed(lines) if event["event"] == "committed")
    with (segments[-1].parents[1] / "lock").open() as held, segments[-1].open("a") as file:
        fcntl.flock(held, fcntl.LOCK_EX)  # or it were a step that a crash took
        file.write(json.dumps(committed | {"at": time.time(), "step": 121}) + "\n")
        file.flush()
        tab.wait(lambda: tab.text("#figures dd").startswith("121"), "the step is shown")
        tab.wait(lambda: "step 121, minimum 0." in tab.text("#verdict"), "the verdict has the step")
        assert tab.text("#verdict").startswith("at rest for ")
        assert tab.run("return document.title").startswith("at rest · <b>flag</b> · step 121")
    with segments[-1].open("a") as file:  # alone: nothing but the refusal tells that there is news
        file.write(json.dumps({"at": time.time()} | refused(121, "it is too bad")) + "\n")
    tab.wait(lambda: "FAILED_PRECONDITION.QUALITY" in tab.text("#events li"), "the refusal is shown")
    assert "in smaller steps" in tab.text("#events li")
    tab.wait(lambda: tab.text("#verdict").startswith("refused for "), "the verdict is the refusal")
    assert "step 121: it is too bad" in tab.text("#verdict")
    row = f"#sessions li[data-session='{SHORT}']"
    assert (tab.text(f"{row} .badge"), "it is too bad" in tab.text(f"{row} .why")) == ("refused", True)
    assert tab.run("return document.title").startswith("refused · ")
    tab.wait(lambda: tab.run("return globalThis.monitor.history.columns.step.at(-1)") == 121, "the chart has the step")


@pytest.mark.nightly
def test_one_goes_to_the_worst_step_and_back(tab: Browser, server: ServerProcess) -> None:
    show(tab, server, THIRD)
    latest = tab.text("#figures dd")
    lowest = "const c = monitor.history.columns; return c.step[c.actual_min.indexOf(Math.min(...c.actual_min))]"
    worst = str(tab.run(lowest))
    tab.run("document.getElementById('scrub-worst').click()")
    tab.wait(lambda: tab.text("#figures dd").split()[0] == worst, "the worst step is shown")
    assert tab.text("#worst-of") == f"committed, step {worst}"
    assert tab.run("return document.getElementById('scrub').getAttribute('aria-valuetext')") == f"step {worst}"
    told = tab.text("#mesh-note")  # the drawn mesh is of another moment: it says so, and how one gets the other
    assert f"for the mesh of step {worst}: mesh-motion play --from-journal '/" in told
    assert told.endswith(f"/{THIRD}' --until {worst}")
    tab.run("const s = document.getElementById('scrub'); s.value = 6; s.dispatchEvent(new Event('input'))")
    tab.wait(lambda: tab.text("#figures dd").split()[0] == "7", "the step of the slider is shown")
    tab.click("#quality .plot", 0, 0)
    tab.wait(lambda: tab.text("#figures dd").split()[0] not in ("7", latest), "the step in the chart's middle is shown")
    tab.run("document.getElementById('scrub-latest').click()")
    tab.wait(lambda: tab.text("#figures dd") == latest, "the latest step is shown")
    assert tab.complaints() == []


@pytest.mark.nightly
def test_chart_fonts_have_whole_pixels_and_no_name_is_struck_through(tab: Browser, server: ServerProcess) -> None:
    """uPlot takes the first digits of a font for its size, and made 22.5px of 11.5px with two pixels to one."""
    show(tab, server, SHORT, mesh=False)
    fonts = "return monitor.history.charts.flatMap((c) => c.plotOptions().axes.map((a) => parseFloat(a.font)))"
    assert all(float(size).is_integer() for size in tab.run(fonts))
    assert tab.texts("#quality .chart-legend button .value") != []
    tab.run("document.querySelector('#quality .chart-legend button').click()")
    style = "return getComputedStyle(document.querySelector('#quality .chart-legend button')).textDecorationLine"
    assert tab.run(style) == "none"


def test_a_server_that_is_gone_is_told_and_its_return_too(tab: Browser, server: ServerProcess) -> None:
    show(tab, server, SHORT)
    server.stop()
    tab.wait(lambda: "The server is gone since" in tab.text("#gone"), "the page tells")
    assert tab.text("#label") == "<b>flag</b>"  # what was known stays
    assert tab.text("#verdict").startswith("server gone for ")
    assert tab.texts("#sessions .badge") == ["server gone"] * 3
    assert tab.run("return document.title").startswith("server gone · ")
    server.start()
    tab.wait(lambda: tab.text("#connection").startswith("live"), "the page goes on")
    assert not tab.text("#gone")


@pytest.mark.nightly
def test_keys_walk_lists_charts_and_mesh(tab: Browser, server: ServerProcess) -> None:
    show(tab, server, LONG)
    order = tab.texts("#sessions .name")
    walked = []
    while "mesh" not in walked and len(walked) < 60:
        tab.keys("TAB")
        walked.append(tab.focused())
    assert walked[0] == "skip"
    assert "sessions" in walked
    assert walked.index("sessions") < walked.index("plot") < walked.index("mesh")
    half = tab.run("return globalThis.monitor.mesh.camera.half")
    tab.keys("+")
    assert tab.run("return globalThis.monitor.mesh.camera.half") < half
    tab.keys("ARROW_RIGHT", "w")
    assert "triangle" in tab.text("#mesh-said")
    ring = "return getComputedStyle(document.activeElement).outlineStyle"
    assert tab.run(ring) == "solid"
    tab.run("document.querySelector('#quality .plot').focus()")
    tab.keys("END")
    assert f"step {STEPS}" in tab.run("return document.activeElement.getAttribute('aria-label')")
    tab.keys("+")
    tab.wait(lambda: tab.run("return Array.isArray(globalThis.monitor.history.window)"), "the chart is closer")
    tab.keys("0")
    tab.run("document.getElementById('sessions').focus()")
    tab.keys("HOME", "ARROW_DOWN")
    tab.wait(lambda: tab.text("#label") == order[1], "the next session is shown")


@pytest.mark.nightly
@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("width", [1400, 360])
def test_it_fits_the_screen_and_can_be_read(tab: Browser, server: ServerProcess, scheme: str, width: int) -> None:
    # as high as the page, for only what is in sight is fetched and drawn
    show(tab, server, SHORT, width=width, height=1500 if width > 1000 else 3600, scheme=scheme)
    assert tab.run("return document.documentElement.scrollWidth") <= width
    low = tab.run(CONTRAST)
    assert low == []
    targets = (
        "return [...document.querySelectorAll('button')].filter((b) => b.offsetParent && b.offsetHeight < 24).length"
    )
    assert tab.run(targets) == 0
    if chromium.AXE.exists():
        assert tab.violations() == []


#: Of a mesh in space, from one of many partitions.
WORST = """
const [done] = arguments;
const centre = [-0.07123, 0.8471, 12.35];
const cells = Array.from({ length: 10 }, (_, k) => (
  { type: 'hexahedron', cell: 123450 + k, partition: 12, metric: -0.123, size: 0.456, skew: -0.789, centre }
));
import('/static/tables.js').then(({ showWorst }) => {
  showWorst({ of: 'committed', step: 12, cells }, 0.2, (cell) => (globalThis.shown = cell.cell));
  const region = document.getElementById('worst').parentElement;
  const { left, right } = region.getBoundingClientRect();
  const box = (part) => part.getBoundingClientRect();
  const outside = (part) => box(part).right > right + 0.5 || box(part).left < left - 0.5;
  done([...region.querySelectorAll('th, td, button')].filter(outside).map((part) => part.innerText));
});
"""


@pytest.mark.nightly
def test_places_of_worst_cells_are_in_sight_on_a_phone(tab: Browser, server: ServerProcess) -> None:
    show(tab, server, SHORT, width=360, height=3600)
    tab.run("globalThis.monitor.update = async () => {}")  # nothing else is shown meanwhile
    assert tab.driver.execute_async_script(WORST) == []
    tab.run("document.querySelector('#worst').parentElement.focus()")
    tab.keys("TAB")
    assert tab.focused() == "Show"
    tab.keys("ENTER")
    assert tab.run("return globalThis.shown") == 123450


def test_axe_is_there_to_be_asked() -> None:
    if not chromium.AXE.exists():
        pytest.skip("axe-core is not there (`python tools/fetch_vendor.py --tests` fetches it)")


#: Texts whose contrast with what is behind them is below WCAG's AA.
CONTRAST = """
const probe = document.createElement('canvas').getContext('2d', { willReadFrequently: true });
const rgba = (colour) => {
  probe.clearRect(0, 0, 1, 1);
  probe.fillStyle = colour;
  probe.fillRect(0, 0, 1, 1);
  return [...probe.getImageData(0, 0, 1, 1).data];
};
const luminance = ([r, g, b]) => {
  const [x, y, z] = [r, g, b].map((v) => (v /= 255) <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4);
  return 0.2126 * x + 0.7152 * y + 0.0722 * z;
};
const behind = (element) => {
  for (let e = element; e; e = e.parentElement) {
    const colour = rgba(getComputedStyle(e).backgroundColor);
    if (colour[3] > 250) return colour;
  }
  return [255, 255, 255, 255];
};
const found = [];
for (const element of document.querySelectorAll('body *')) {
  const own = [...element.childNodes].some((node) => node.nodeType === 3 && node.textContent.trim());
  if (!own || !element.offsetParent) continue;
  const [a, b] = [luminance(rgba(getComputedStyle(element).color)), luminance(behind(element))];
  const ratio = (Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05);
  if (ratio < 4.5) found.push([element.className || element.tagName, element.textContent.slice(0, 20), ratio]);
}
return found;
"""
