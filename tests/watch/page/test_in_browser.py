"""The page in headless Chromium, as users see it: content, live updates, long runs, a stopped server, keys, contrast;
answers that fail or come late, many tabs, a page in the background.
"""

import fcntl
import json
import time
from collections.abc import Iterator

import chromium
import pytest
from chromium import Browser
from histories import largest_angle, refused
from shown_page import await_session, serving, show, stored

from tests.faults.server_process import ServerProcess

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
    shown = tab.texts("#faces tbody tr")[0].split("\t")
    assert shown == ["largest non-orthogonality", "24.5°", f"{largest_angle(120):.1f}°"]
    assert len(tab.texts("#faces tbody tr")) == 7
    assert any("refused" in line or "_" in line for line in tab.texts("#events .code"))
    assert "threshold 0.2" in tab.run("return document.querySelector('#quality .plot').getAttribute('aria-label')")
    assert tab.complaints() == []


def test_the_mesh_is_a_picture_by_day_and_by_night(tab: Browser, server: ServerProcess) -> None:
    show(tab, server, SHORT)
    source = "return globalThis.monitor.mesh.picture.src"
    light = tab.run(source)
    assert light.startswith("data:image/png;base64,")
    assert tab.text("#mesh-note") == ""
    show(tab, server, SHORT, scheme="dark")
    assert tab.run(source) != light
    assert tab.complaints() == []


@pytest.mark.nightly
def test_many_steps_are_thinned_and_the_latest_are_not(tab: Browser, server: ServerProcess) -> None:
    show(tab, server, LONG)
    columns = "return globalThis.monitor.history.columns"
    assert 1500 <= len(tab.run(columns)["step"]) <= 1501
    least = min(tab.run(columns)["actual_min"])
    tab.run("document.getElementById('latest-steps').click()")
    tab.wait(lambda: tab.run(columns)["step"] == list(range(STEPS - 100, STEPS + 1)), "single steps are shown")
    tab.run("document.getElementById('all-steps').click()")
    tab.wait(lambda: len(tab.run(columns)["step"]) >= 1500, "all steps are shown")
    assert min(tab.run(columns)["actual_min"]) == least


@pytest.mark.nightly
def test_new_events_are_shown_without_a_reload(tab: Browser, server: ServerProcess) -> None:
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
    with segments[-1].open("a") as file:  # alone: nothing but the refusal shows that there is news
        file.write(json.dumps({"at": time.time()} | refused(121, "it is too bad")) + "\n")
    tab.wait(lambda: "FAILED_PRECONDITION.QUALITY" in tab.text("#events li"), "the refusal is shown")
    assert "in smaller steps" in tab.text("#events li")
    tab.wait(lambda: tab.text("#verdict").startswith("refused for "), "the verdict is the refusal")
    assert "step 121: it is too bad" in tab.text("#verdict")
    row = f"#sessions li[data-session='{SHORT}']"
    assert (tab.text(f"{row} .badge"), "it is too bad" in tab.text(f"{row} .why")) == ("refused", True)
    assert tab.run("return document.title").startswith("refused · ")
    tab.wait(lambda: tab.run("return globalThis.monitor.history.columns.step.at(-1)") == 121, "the chart has the step")
    assert "next 1 time refused" in tab.text("#figures")  # the open step's refusals are counted, too
    tab.show(f"http://{server.settings['monitor']}/")  # nothing is chosen: the one in trouble, which is not the latest
    await_session(tab, SHORT)
    # of two in trouble the one with the lower minimum, not the one that changed last
    chosen = """
const m = globalThis.monitor, one = m.sessions.find(({ session }) => session === m.chosen);
const other = { ...one, session: "f".repeat(32), minimum: 0.9 * one.minimum };
m.chosen = "";
m.take({ at: 0, build: {}, missing: "", sessions: [one, other] });
return m.chosen;
"""
    assert tab.run(chosen) == "f" * 32


def test_a_server_that_is_gone_is_reported_and_its_return_too(tab: Browser, server: ServerProcess) -> None:
    show(tab, server, SHORT)
    server.stop()
    tab.wait(lambda: "The server is gone since" in tab.text("#gone"), "the page says so")
    assert tab.text("#label") == "<b>flag</b>"  # what was known stays
    assert tab.text("#verdict").startswith("server gone for ")
    assert tab.texts("#sessions .badge") == ["server gone"] * 3
    assert tab.run("return document.title").startswith("server gone · ")
    server.start()
    tab.wait(lambda: tab.text("#connection").startswith("live"), "the page goes on")
    assert not tab.text("#gone")


@pytest.mark.nightly
def test_keys_walk_lists_and_charts(tab: Browser, server: ServerProcess) -> None:
    show(tab, server, LONG)
    order = tab.texts("#sessions .name")
    walked = []
    while "plot" not in walked and len(walked) < 60:
        tab.keys("TAB")
        walked.append(tab.focused())
    assert walked[0] == "skip"
    assert "sessions" in walked
    assert walked.index("sessions") < walked.index("plot")
    ring = "return getComputedStyle(document.activeElement).outlineStyle"
    assert tab.run(ring) == "solid"
    tab.run("document.querySelector('#quality .plot').focus()")
    tab.keys("END")
    assert f"step {STEPS}" in tab.run("return document.activeElement.getAttribute('aria-label')")
    tab.run("document.getElementById('sessions').focus()")
    tab.keys("HOME", "ARROW_DOWN")
    tab.wait(lambda: tab.text("#label") == order[1], "the next session is shown")


@pytest.mark.nightly
@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("width", [1400, 360])
def test_it_fits_the_screen_and_can_be_read(tab: Browser, server: ServerProcess, scheme: str, width: int) -> None:
    # as high as the page, because only visible parts are fetched and drawn
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
  showWorst({ of: 'committed', step: 12, cells }, 0.2);
  const region = document.getElementById('worst').parentElement;
  const { left, right } = region.getBoundingClientRect();
  const box = (part) => part.getBoundingClientRect();
  const outside = (part) => box(part).right > right + 0.5 || box(part).left < left - 0.5;
  done([...region.querySelectorAll('th, td')].filter(outside).map((part) => part.innerText));
});
"""


@pytest.mark.nightly
def test_places_of_worst_cells_are_in_sight_on_a_phone(tab: Browser, server: ServerProcess) -> None:
    show(tab, server, SHORT, width=360, height=3600)
    tab.run("globalThis.monitor.update = async () => {}")  # nothing else is shown meanwhile
    assert tab.driver.execute_async_script(WORST) == []


def test_axe_is_there_to_be_asked() -> None:
    if not chromium.AXE.exists():
        pytest.skip("axe-core is not there (`python tools/fetch_vendor.py --tests` fetches it)")


#: Answers about meshes are held back until ``release()`` is called; then the next one is asked for at once.
HELD = """
const asked = globalThis.fetch;
const gate = new Promise((open) => (globalThis.release = open));
globalThis.fetch = async (path, options) => {
  const reply = await asked(path, options);
  if (path.includes('/mesh')) {
    globalThis.held = (globalThis.held ?? 0) + 1;
    await gate;
  }
  return reply;
};
const m = globalThis.monitor.mesh;
m.goOn();
m.stale = true;
m.refresh();
"""


@pytest.mark.nightly
def test_a_look_elsewhere_while_the_mesh_comes_does_not_break_it(tab: Browser, server: ServerProcess) -> None:
    show(tab, server, SHORT)
    tab.run(HELD)
    tab.wait(lambda: tab.run("return globalThis.held"), "the mesh is asked for")
    for other in (THIRD, SHORT):
        tab.run("globalThis.monitor.choose(arguments[0])", other)
        tab.wait(lambda other=other: tab.run("return globalThis.monitor.mesh.session.session") == other, "it is chosen")
    tab.run("globalThis.release()")
    tab.wait(lambda: not tab.run("return globalThis.monitor.mesh.picture.hidden"), "the mesh is there")
    assert tab.text("#mesh-note") == ""


#: The first answer about something is an error.
FAILING = """
const [kind] = arguments;
const asked = globalThis.fetch;
let failed = false;
globalThis.fetch = async (path, options) => {
  if (failed || !path.includes(kind)) return asked(path, options);
  failed = true;
  return new Response('{"message": "too many requests at a time"}', { status: 503 });
};
"""


@pytest.mark.nightly
@pytest.mark.parametrize(("kind", "where"), [("/series", "#trouble"), ("/mesh", "#mesh-note")])
def test_a_failed_request_of_the_page_is_repeated(tab: Browser, server: ServerProcess, kind: str, where: str) -> None:
    show(tab, server, SHORT)
    tab.run(FAILING, kind)
    tab.run("globalThis.monitor.choose(arguments[0])", THIRD)
    tab.wait(lambda: "too many requests" in tab.text(where), "it is shown")
    shown = "const m = globalThis.monitor; return m.history.columns.step.length === 40 && !m.mesh.picture.hidden"
    tab.wait(lambda: tab.run(shown), "charts and mesh come later")
    tab.wait(lambda: "too many requests" not in tab.text(where), "nothing is wrong any more")


@pytest.mark.nightly
def test_more_tabs_than_a_browser_has_lines_are_all_filled(tab: Browser, server: ServerProcess) -> None:
    first = tab.driver.current_window_handle
    try:
        for _ in range(7):
            tab.driver.switch_to.new_window("tab")
            show(tab, server, SHORT, mesh=False)
        tab.driver.switch_to.window(first)
        show(tab, server, THIRD)
    finally:
        for handle in set(tab.driver.window_handles) - {first}:
            tab.driver.switch_to.window(handle)
            tab.driver.close()
        tab.driver.switch_to.window(first)


#: Whether the page is in the background.
HIDDEN = """
Object.defineProperty(document, 'hidden', { configurable: true, get: () => globalThis.behind });
globalThis.turn = (behind) => {
  globalThis.behind = behind;
  document.dispatchEvent(new Event('visibilitychange'));
};
"""


@pytest.mark.nightly
def test_a_page_in_the_background_asks_nothing(tab: Browser, server: ServerProcess) -> None:
    show(tab, server, SHORT)
    tab.run(HIDDEN)
    tab.run("globalThis.turn(true)")
    tab.wait(lambda: not tab.run("return globalThis.monitor.live.asking"), "the last question is answered")
    last = tab.run("return globalThis.monitor.live.last")
    time.sleep(2.0)
    assert tab.run("return globalThis.monitor.live.last") == last
    tab.run("globalThis.turn(false)")
    tab.wait(lambda: tab.run("return globalThis.monitor.live.last") > last, "it asks again")
    assert tab.text("#gone") == ""


@pytest.mark.nightly
def test_a_server_that_refuses_the_list_is_reported_with_its_reason(tab: Browser, server: ServerProcess) -> None:
    show(tab, server, SHORT)
    tab.run(FAILING, "api/sessions")
    tab.wait(lambda: "refuses this page: too many requests" in tab.text("#gone"), "the reason is shown")
    tab.wait(lambda: tab.text("#gone") == "", "nothing is wrong any more")


#: Texts whose contrast with their background is below WCAG's AA.
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
