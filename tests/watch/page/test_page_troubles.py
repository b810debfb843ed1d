"""What goes wrong around the page in a browser: answers that fail or come late, no WebGL, many tabs, odd presses."""

from __future__ import annotations

import contextlib
import re
import socket
from collections.abc import Iterator

import chromium
import pytest
from chromium import Browser
from shown_page import PAINTED, await_session, serving, show, stored

pytest.importorskip("uvicorn", reason="the extra monitor is not installed")

from mesh_motion_server.watch.page.live import MOST_LISTENERS
from proofs.server_process import ServerProcess

pytestmark = [pytest.mark.nightly, pytest.mark.skipif(bool(chromium.missing()), reason=chromium.missing())]

SHORT, THIRD = ("2" * 32, "3" * 32)


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ServerProcess]:
    with serving(tmp_path_factory.mktemp("server")) as served:
        stored(served.state, SHORT, "flag", 20)
        stored(served.state, THIRD, "wing", 40)
        yield served


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


def test_a_look_elsewhere_while_the_mesh_comes_does_not_break_it(tab: Browser, server: ServerProcess) -> None:
    show(tab, server, SHORT)
    tab.run(HELD)
    tab.wait(lambda: tab.run("return globalThis.held"), "the mesh is asked for")
    for other in (THIRD, SHORT):
        tab.run("globalThis.monitor.choose(arguments[0])", other)
        tab.wait(lambda other=other: tab.run("return globalThis.monitor.mesh.session.session") == other, "it is chosen")
    tab.run("globalThis.release()")
    tab.wait(lambda: tab.run("return !!globalThis.monitor.mesh.mesh"), "the mesh is there")
    assert tab.run("return globalThis.monitor.mesh.mesh.triangles?.length") > 0
    assert tab.text("#mesh-note") == ""


#: The first answer about something is an error.
FAILING = """
const [kind] = arguments;
const asked = globalThis.fetch;
let failed = false;
globalThis.fetch = async (path, options) => {
  if (failed || !path.includes(kind)) return asked(path, options);
  failed = true;
  return new Response('{"message": "too many questions at a time"}', { status: 503 });
};
"""


@pytest.mark.parametrize(("kind", "where"), [("/series", "#trouble"), ("/mesh", "#mesh-note")])
def test_what_failed_is_asked_again(tab: Browser, server: ServerProcess, kind: str, where: str) -> None:
    show(tab, server, SHORT)
    tab.run(FAILING, kind)
    tab.run("globalThis.monitor.choose(arguments[0])", THIRD)
    tab.wait(lambda: "too many questions" in tab.text(where), "it is told")
    shown = (
        "const m = globalThis.monitor; return m.history.columns.step.length === 40 && m.mesh.mesh?.triangles.length > 0"
    )
    tab.wait(lambda: tab.run(shown), "charts and mesh come later")
    tab.wait(lambda: "too many questions" not in tab.text(where), "nothing is wrong any more")


#: As where there is no graphics card, on a remote desktop.
NO_WEBGL = """
const own = HTMLCanvasElement.prototype.getContext;
HTMLCanvasElement.prototype.getContext = function (kind, ...rest) {
  return kind.startsWith('webgl') ? null : own.call(this, kind, ...rest);
};
"""


def test_a_browser_that_cannot_draw_says_so_for_each_session(tab: Browser, server: ServerProcess) -> None:
    with tab.prepared(NO_WEBGL):
        show(tab, server, SHORT, mesh=False)
    tab.wait(lambda: "cannot draw the mesh" in tab.text("#mesh-note"), "it is told")
    tab.run("globalThis.monitor.choose(arguments[0])", THIRD)
    await_session(tab, THIRD, mesh=False)
    tab.wait(lambda: "cannot draw the mesh" in tab.text("#mesh-note"), "it is told of this one too")
    tab.wait(lambda: len(tab.texts("#worst tbody tr")) == 10, "the rest is there")


#: The driver of the graphics card starts anew.
LOST = """
const { scene } = globalThis.monitor.mesh;
globalThis.monitor.mesh.seen = false; // no news of the mesh meanwhile, which would be drawn
globalThis.lost = scene.renderer.getContext().getExtension('WEBGL_lose_context');
const own = scene.draw.bind(scene);
globalThis.drawn = 0;
scene.draw = (...given) => {
  globalThis.drawn += 1;
  own(...given);
};
"""


def test_the_mesh_is_drawn_again_when_the_graphics_are_back(tab: Browser, server: ServerProcess) -> None:
    show(tab, server, SHORT)
    colours = tab.run(PAINTED)
    tab.run(LOST)
    tab.run("globalThis.lost.loseContext()")
    tab.wait(
        lambda: tab.run("return globalThis.monitor.mesh.scene.renderer.getContext().isContextLost()"), "it is lost"
    )
    tab.run("globalThis.drawn = 0; globalThis.lost.restoreContext()")
    tab.wait(lambda: tab.run("return globalThis.drawn > 0"), "it is drawn by itself")
    assert tab.run(PAINTED) == colours


def test_a_press_that_began_elsewhere_is_none(tab: Browser, server: ServerProcess) -> None:
    show(tab, server, SHORT)
    tab.complaints()
    said = tab.text("#mesh-said")
    release = "document.getElementById('mesh').dispatchEvent(new PointerEvent('pointerup', { pointerId: 7 }))"
    tab.run(release)
    assert tab.complaints() == []
    tab.run("document.getElementById('mesh').scrollIntoView({ block: 'center' })")
    tab.click("#mesh", 20, 30)
    named = tab.wait(lambda: tab.text("#mesh-said").replace(said, ""), "the cell is named")
    tab.run("globalThis.monitor.mesh.said('')")
    tab.run(release)
    assert tab.text("#mesh-said") == ""
    assert "of partition 0" in named


def test_an_inverted_cell_is_pink_whatever_its_quality(tab: Browser, server: ServerProcess) -> None:
    show(tab, server, SHORT)
    pink = (
        "return globalThis.monitor.mesh.scene.uniforms.inverted.value.toArray().map((v) => Math.round(255 * v)).join()"
    )
    colour = tab.run(pink)
    assert tab.run("return Math.min(...globalThis.monitor.mesh.mesh.quality)") > 0.0
    assert colour not in tab.run(PAINTED)
    tab.run("const m = globalThis.monitor.mesh; m.mesh.inverted[m.mesh.owners[0]] = 1; m.show(m.mesh)")
    assert tab.run(PAINTED)[colour] > 50


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


def test_few_steps_are_points_and_days_ago_have_a_date(tab: Browser, server: ServerProcess) -> None:
    show(tab, server, SHORT)
    shown = (
        "const { plot } = globalThis.monitor.history.charts[0]; "
        "return plot.series.slice(1).filter((one) => one.show).map((one) => one.points.show(plot, 1))"
    )
    assert tab.run(shown)
    assert all(tab.run(shown))
    asked = "import('/static/format.js').then((m) => arguments[0]([m.clock(0), m.clock(Date.now() / 1000)]))"
    long_ago, now = tab.driver.execute_async_script(asked)
    assert re.fullmatch(r"19\d\d-\d\d-\d\d \d\d:\d\d:\d\d", long_ago)
    assert re.fullmatch(r"\d\d:\d\d:\d\d", now)


#: Whether the page is in the background.
HIDDEN = """
Object.defineProperty(document, 'hidden', { configurable: true, get: () => globalThis.behind });
globalThis.turn = (behind) => {
  globalThis.behind = behind;
  document.dispatchEvent(new Event('visibilitychange'));
};
"""


def test_a_page_in_the_background_holds_no_line(tab: Browser, server: ServerProcess) -> None:
    show(tab, server, SHORT)
    tab.run(HIDDEN)
    line = "return globalThis.monitor.live.source.readyState"
    tab.run("globalThis.turn(true)")
    assert tab.run(line) == 2
    tab.run("globalThis.turn(false)")
    tab.wait(lambda: tab.run(line) == 1, "it listens again")
    assert tab.text("#gone") == ""


def test_a_page_for_which_there_is_no_seat_says_so(tab: Browser, server: ServerProcess) -> None:
    host, port = server.settings["monitor"].split(":")
    request = b"GET /api/live HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n"
    with contextlib.ExitStack() as lines:
        for _ in range(MOST_LISTENERS):
            line = lines.enter_context(socket.create_connection((host, int(port)), timeout=60))
            line.sendall(request)
            assert line.recv(12) in (b"HTTP/1.1 200", b"HTTP/1.1 503")  # of the tests before some may be left
        tab.show(f"http://{server.settings['monitor']}/#{SHORT}")
        tab.wait(lambda: "refuses this page: too many pages" in tab.text("#gone"), "the reason is told")
    await_session(tab, SHORT)
    tab.wait(lambda: tab.text("#gone") == "", "nothing is wrong any more")


def test_a_line_that_is_being_made_is_left_in_peace(tab: Browser, server: ServerProcess) -> None:
    show(tab, server, SHORT)
    tried = """
    const { live } = globalThis.monitor;
    const [kept, made] = [live.source, live.connect];
    let count = 0;
    live.connect = () => (count += 1);
    live.gone = true;
    live.tried = Date.now() - 1000 * arguments[1];
    live.source = { readyState: arguments[0], close() {} };
    live.watch();
    [live.source, live.connect, live.gone] = [kept, made, false];
    return count;
    """
    assert [tab.run(tried, state, seconds) for state in (0, 1, 2) for seconds in (1, 5, 20)] == [
        0,
        0,
        1,
        0,
        0,
        1,
        0,
        1,
        1,
    ]
