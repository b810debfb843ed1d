"""Changes while a user looks at the page: sessions that are discarded, refusals that are announced."""

import json
import shutil
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import chromium
import pytest
from chromium import Browser
from histories import refused
from shown_page import await_session, serving, show, stored

pytest.importorskip("uvicorn", reason="the extra monitor is not installed")

from tests.faults.server_process import ServerProcess

pytestmark = [pytest.mark.nightly, pytest.mark.skipif(bool(chromium.missing()), reason=chromium.missing())]

FLAG, WING, AGAIN = ("2" * 32, "3" * 32, "4" * 32)


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ServerProcess]:
    with serving(tmp_path_factory.mktemp("server")) as served:
        stored(served.state, FLAG, "flag", 20)
        stored(served.state, WING, "wing", 40)
        yield served


def folder_of(server: ServerProcess, session: str) -> Path:
    return server.state / "sessions" / session


def await_list(tab: Browser, *names: str) -> None:
    tab.wait(lambda: sorted(tab.texts("#sessions .name")) == list(names), f"the list of {', '.join(names)}")


SELECTED = "return [...document.querySelectorAll('#sessions [aria-selected=true]')].map((row) => row.dataset.session)"


def test_a_session_that_is_gone_is_reported_and_not_swapped(
    tab: Browser, server: ServerProcess, tmp_path: Path
) -> None:
    show(tab, server, FLAG)
    kept = tmp_path / "kept"
    shutil.move(folder_of(server, FLAG), kept)
    text_shown = tab.wait(lambda: tab.text("#ended"), "the page says so")
    assert "“flag” (22222222) was discarded" in text_shown
    assert "last step here was 2, minimum" in text_shown
    assert (tab.text("#label"), tab.text("#state")) == ("flag", "not listed")
    assert "not listed" in tab.run("return document.title")
    assert tab.run("return globalThis.monitor.history.columns.step.length") == 20  # what was known stays
    assert tab.run(SELECTED) == []
    shutil.move(kept, folder_of(server, FLAG))
    tab.wait(lambda: tab.text("#ended") == "", "it is there again")
    await_session(tab, FLAG)
    assert tab.run(SELECTED) == [FLAG]
    shutil.move(folder_of(server, FLAG), kept)
    tab.wait(lambda: tab.text("#ended"), "the page says so again")
    tab.run("document.querySelector(`[data-session='${arguments[0]}'] .name`).click()", WING)
    await_session(tab, WING)
    assert (tab.text("#label"), tab.text("#ended")) == ("wing", "")
    shutil.move(kept, folder_of(server, FLAG))


def test_a_run_that_was_begun_again_is_offered_under_its_label(tab: Browser, server: ServerProcess) -> None:
    stored(server.state, AGAIN, "flag", 30)
    show(tab, server, AGAIN)
    await_list(tab, "22222222 flag", "44444444 flag", "wing")
    shutil.rmtree(folder_of(server, AGAIN))
    tab.wait(lambda: "Show the other “flag” (22222222)" in tab.text("#ended button"), "the other one is offered")
    tab.run("document.querySelector('#ended button').click()")
    await_session(tab, FLAG)
    assert tab.run("return location.hash") == f"#{FLAG}"
    await_list(tab, "flag", "wing")


def test_a_link_to_a_session_that_is_not_there_waits_for_it(tab: Browser, server: ServerProcess) -> None:
    tab.show(f"http://{server.settings['monitor']}/#{AGAIN}")
    text_shown = tab.wait(lambda: tab.text("#ended"), "the page says so")
    assert "There is no session 44444444" in text_shown
    assert tab.text("#label") == ""
    await_list(tab, "flag", "wing")
    stored(server.state, AGAIN, "again", 10)
    await_session(tab, AGAIN)
    assert (tab.text("#label"), tab.text("#ended")) == ("again", "")
    shutil.rmtree(folder_of(server, AGAIN))


def happens(server: ServerProcess, session: str, *events: dict[str, Any]) -> None:
    """Add events to the end of a history, each with the time now."""
    segment = max((folder_of(server, session) / "history").glob("events-*"))
    with segment.open("a") as file:
        file.writelines(json.dumps({"at": time.time()} | event) + "\n" for event in events)


#: Texts that a screen reader announces politely: what is added to logs and statuses, each time it is.
LISTENING = """
globalThis.announced = [];
new MutationObserver((records) => {
  for (const { target, addedNodes } of records) {
    const region = (target.closest ? target : target.parentElement).closest('[role=log], [role=status], [aria-live]');
    if (region) for (const node of addedNodes) globalThis.announced.push([region.id, node.textContent]);
  }
}).observe(document.body, { childList: true, subtree: true });
"""
#: Of the line to the server, which may come and go on a busy machine, what it repeats.
ANNOUNCED = """
const [line, others] = [[], []];
for (const [id, text] of globalThis.announced.filter(([, text]) => text.trim())) {
  (id === 'connection' ? line : others).push(text);
}
return [...others, ...line.filter((text, k) => k && text === line[k - 1])];
"""


def test_news_is_announced_once_and_nothing_that_was_there(tab: Browser, server: ServerProcess) -> None:
    show(tab, server, WING)
    happens(server, WING, refused(41, "the first"))
    tab.wait(lambda: "the first" in tab.text("#events"), "it is shown")
    tab.run(LISTENING)
    happens(server, WING, refused(42, "the second"))
    tab.wait(lambda: "the second" in tab.text("#events"), "it is shown")
    assert tab.run(ANNOUNCED) == ["Step 42: MOVE refused, FAILED_PRECONDITION.QUALITY. the second"]
    happens(server, WING, refused(43, "the second"))
    tab.wait(lambda: "× 2 since" in tab.text("#events li"), "the repeat is counted")
    happens(server, WING, *(refused(44, f"number {k}") for k in range(5)))
    tab.wait(lambda: "number 4" in tab.text("#events"), "they are shown")
    said = tab.run(ANNOUNCED)[1:]
    assert said[0] == "2 more warnings and refusals, and then:"
    assert [text[-8:] for text in said[1:]] == ["number 2", "number 3", "number 4"]
    before = len(tab.run(ANNOUNCED))
    tab.run("globalThis.monitor.choose(arguments[0])", FLAG)
    await_session(tab, FLAG)
    tab.run("globalThis.monitor.choose(arguments[0])", WING)
    await_session(tab, WING)
    tab.wait(lambda: "number 4" in tab.text("#events"), "they are shown again")
    assert len(tab.run(ANNOUNCED)) == before


def test_a_selected_text_stays_when_news_comes(tab: Browser, server: ServerProcess) -> None:
    show(tab, server, WING)
    happens(server, WING, refused(45, "to be copied"))
    tab.wait(lambda: "to be copied" in tab.text("#events"), "it is shown")
    tab.run("getSelection().selectAllChildren(document.querySelector('#events li p'))")
    happens(server, WING, refused(46, "what comes next"))
    tab.wait(lambda: "what comes next" in tab.text("#events"), "it is shown")
    assert tab.run("return getSelection().toString().trim()") == "to be copied"
    texts = tab.texts("#events li p:first-of-type")
    assert texts[:2] == ["what comes next", "to be copied"]
    text_shown = tab.run("return fetch(`api/sessions/${arguments[0]}`).then((reply) => reply.json())", WING)["notable"]
    assert texts == [event["message"] for event in text_shown if event.get("message")]


def test_a_press_on_a_session_counts_though_it_steps(tab: Browser, server: ServerProcess) -> None:
    from selenium.webdriver.common.action_chains import ActionChains  # noqa: PLC0415
    from selenium.webdriver.common.by import By  # noqa: PLC0415

    show(tab, server, WING)
    row = tab.driver.find_element(By.CSS_SELECTOR, f"[data-session='{FLAG}'] .second")
    ActionChains(tab.driver).click_and_hold(row).perform()
    order = tab.texts("#sessions .name")
    assert "step 777" in tab.run(STEPPED, FLAG)
    ActionChains(tab.driver).release().perform()
    await_session(tab, FLAG)
    assert tab.texts("#sessions .name") == order


#: The list is late: as it was when the session had made one step; a process holds it, or no process does.
LATE = """
const m = globalThis.monitor;
const [late, worker] = arguments;
m.key = '';
m.live.take = (news) => {
  const sessions = news.sessions.map((one) => (one.session === late ? { ...one, step: 1, worker } : one));
  m.take({ ...news, sessions });
};
m.live.take({ at: 0, build: {}, missing: '', sessions: m.sessions });
"""


def test_step_and_qualities_are_of_one_moment(tab: Browser, server: ServerProcess) -> None:
    show(tab, server, FLAG)
    for worker, step in (("alive", "20"), ("none", "1")):
        tab.run(LATE, FLAG, worker)
        tab.wait(lambda step=step: tab.text("#figures dd").split()[0] == step, f"step {step} is shown")


#: A session has made steps, and changed later than all others; what its row says until the next list comes.
STEPPED = """
const m = globalThis.monitor;
const [first] = arguments;
const last = m.sessions.find((one) => one.session === first);
const others = m.sessions.filter((one) => one.session !== first);
m.list.show([{ ...last, minimum_of: 777, spark: [0.5, 0.4] }, ...others], m.chosen);
return document.querySelector(`[data-session='${first}']`).textContent;
"""
