"""Faults around the page in a browser: answers that fail or come late, many tabs, a page in the background."""

import re
import time
from collections.abc import Iterator

import chromium
import pytest
from chromium import Browser
from shown_page import serving, show, stored

pytest.importorskip("uvicorn", reason="the extra monitor is not installed")

from tests.faults.server_process import ServerProcess

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


@pytest.mark.parametrize(("kind", "where"), [("/series", "#trouble"), ("/mesh", "#mesh-note")])
def test_a_failed_request_of_the_page_is_repeated(tab: Browser, server: ServerProcess, kind: str, where: str) -> None:
    show(tab, server, SHORT)
    tab.run(FAILING, kind)
    tab.run("globalThis.monitor.choose(arguments[0])", THIRD)
    tab.wait(lambda: "too many requests" in tab.text(where), "it is shown")
    shown = "const m = globalThis.monitor; return m.history.columns.step.length === 40 && !m.mesh.picture.hidden"
    tab.wait(lambda: tab.run(shown), "charts and mesh come later")
    tab.wait(lambda: "too many requests" not in tab.text(where), "nothing is wrong any more")


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


def test_a_server_that_refuses_the_list_is_reported_with_its_reason(tab: Browser, server: ServerProcess) -> None:
    show(tab, server, SHORT)
    tab.run(FAILING, "api/sessions")
    tab.wait(lambda: "refuses this page: too many requests" in tab.text("#gone"), "the reason is shown")
    tab.wait(lambda: tab.text("#gone") == "", "nothing is wrong any more")
