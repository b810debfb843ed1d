"""Answers and refusals of the page's server."""

import asyncio
import hashlib
import json
import math
import shutil
import threading
import time
import tomllib
from concurrent.futures import ThreadPoolExecutor, as_completed
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from histories import refused, resumed_at, write_history
from starlette.exceptions import HTTPException

from mesh_motion_server.security.host_header import is_allowed_host
from mesh_motion_server.session.store import SessionStore
from mesh_motion_server.watch.observation.followed import plain_column
from mesh_motion_server.watch.page.app import STATIC, Page
from mesh_motion_server.watch.page.archive import as_json
from tests.faults.driver import SESSION, make_driver
from tests.faults.stand_in import grid_mesh

testclient = pytest.importorskip("starlette.testclient", reason="the extra monitor is not installed")
BUILD = {"version": "1", "protocol": "1.0", "python": "3"}


def test_the_page_makes_no_markup_of_text() -> None:
    """Data of clients becomes text of elements; the page's own sources have no other way."""
    ways = ("innerHTML", "outerHTML", "insertAdjacentHTML", "document.write", "createContextualFragment", "eval(")
    for path in [*STATIC.glob("*.js"), *STATIC.glob("*.html")]:
        assert [way for way in ways if way in path.read_text("utf-8")] == [], path


def stored(folder: Path, steps: int, session: str = SESSION, history: int = 0, label: str = "wing") -> None:
    driver = make_driver(SessionStore(folder), [grid_mesh()], session=session, spec={"label": label})
    driver.open()
    for step in range(1, steps + 1):
        driver.advance(step)
    driver.host.close()
    if history:
        shutil.rmtree(folder / "sessions" / session / "history")
        write_history(folder / "sessions" / session, history)


def asking(state: Path, **options: Any) -> Any:
    return asking_of(Page(state, BUILD, **options))


def asking_of(page: Page) -> Any:
    return testclient.TestClient(page.app, base_url="http://127.0.0.1:7441")


@pytest.fixture(scope="module")
def client(tmp_path_factory: pytest.TempPathFactory) -> Any:
    state = tmp_path_factory.mktemp("state")
    stored(state, 2, history=600)
    return asking(state)


def test_the_list_shows_what_folders_and_supervisor_know(tmp_path: Path) -> None:
    stored(tmp_path, 3, history=100)
    page = Page(tmp_path, BUILD)
    page.update({"missing": "", "sessions": [[SESSION, "alive", "TRIAL", 3, 1], ["f" * 32, "alive", "OPENING", 0, 1]]})
    asked = testclient.TestClient(page.app, base_url="http://localhost")
    new, known = asked.get("/api/sessions").json()["sessions"]
    assert (new["session"], new["built"], new["state"]) == ("f" * 32, False, "OPENING")
    assert (known["label"], known["state"], known["worker"]) == ("wing", "TRIAL", "alive")
    assert len(known["spark"]) == 32
    assert known["minimum"] == known["spark"][-1]
    page.update({"missing": "", "sessions": [[SESSION, "dead", "READY", 3, 1]]})
    assert listed(page)[0]["worker"] == "dead"


def test_a_session_that_is_being_discarded_is_none_that_is_not_built_yet(tmp_path: Path) -> None:
    """Its folder disappears before its worker: for a moment the list had it without a label, and kept that."""
    stored(tmp_path, 1)
    page = Page(tmp_path, BUILD)
    page.update({"missing": "", "sessions": [[SESSION, "alive", "READY", 1, 1], ["f" * 32, "alive", "OPENING", 0, 1]]})
    assert [one["label"] for one in listed(page)] == ["", "wing"]
    shutil.rmtree(tmp_path / "sessions" / SESSION)
    assert [one["session"] for one in listed(page)] == ["f" * 32]
    assert [one["session"] for one in listed(page)] == ["f" * 32]


def append(state: Path, *events: dict[str, Any]) -> None:
    segment = max((state / "sessions" / SESSION / "history").glob("events-*"))
    with segment.open("a") as file:
        file.writelines(json.dumps({"at": time.time()} | event) + "\n" for event in events)


def read_again(page: Page) -> Any:
    """The current list, not one from the last second."""
    page._due = 0.0
    return asking_of(page).get("/api/sessions").json()


def listed(page: Page) -> list[dict[str, Any]]:
    found: list[dict[str, Any]] = read_again(page)["sessions"]
    return found


def test_a_refusal_alone_is_news(tmp_path: Path) -> None:
    stored(tmp_path, 1, history=5)
    page = Page(tmp_path, BUILD)
    (before,) = listed(page)
    assert listed(page) == [before]
    append(tmp_path, refused(6))
    (after,) = listed(page)
    assert after["version"] != before["version"]
    assert after["changed_at"] > before["changed_at"]
    assert after["state"] == before["state"]


def test_an_unreadable_session_is_reported_and_read_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    stored(tmp_path, 1)
    page = Page(tmp_path, BUILD)
    (before,) = listed(page)
    read, tries = page._archive.overview, iter([OSError("stale file handle"), MemoryError()])

    def sometimes(workers: list[list[Any]]) -> list[dict[str, Any]]:
        for error in tries:
            raise error
        return read(workers)

    monkeypatch.setattr(page._archive, "overview", sometimes)
    said = [read_again(page) for _ in range(3)]
    assert [reply["missing"] for reply in said] == [
        "the list cannot be read: stale file handle",
        "the list cannot be read: MemoryError",
        "",
    ]
    assert [one["session"] for reply in said for one in reply["sessions"]] == 3 * [before["session"]]


def test_many_who_ask_start_no_further_reading(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    page = Page(tmp_path, BUILD)
    read, readings = page._archive.overview, [0]

    def counted(workers: list[list[Any]]) -> list[dict[str, Any]]:
        readings[0] += 1
        return read(workers)

    monkeypatch.setattr(page._archive, "overview", counted)
    monkeypatch.setattr("mesh_motion_server.watch.page.app._LIST_SECONDS", 3600.0)
    asked = asking_of(page)
    first, second = (asked.get("/api/sessions").json() for _ in range(2))
    assert first["sessions"] == second["sessions"]
    assert first["at"] < second["at"]
    assert readings == [1]


def test_series_are_thinned_to_minima_and_the_latest_are_not(client: Any) -> None:
    whole = client.get(f"/api/sessions/{SESSION}/series?points=10000").json()["columns"]
    thin = client.get(f"/api/sessions/{SESSION}/series?points=30").json()["columns"]
    assert (len(whole["step"]), whole["step"][-1], thin["step"][-1]) == (600, 600, 600)
    assert len(thin["step"]) in (30, 31)  # and the latest
    assert min(thin["actual_min"]) == min(whole["actual_min"])
    latest = client.get(f"/api/sessions/{SESSION}/series?points=1500&first=500").json()["columns"]
    assert latest["step"] == list(range(500, 601))
    assert latest["actual_min"] == whole["actual_min"][499:]


def test_long_answers_are_compressed_for_who_takes_them_so(client: Any) -> None:
    series, detail = f"/api/sessions/{SESSION}/series?points=1500", f"/api/sessions/{SESSION}"
    plain = client.get(series, headers={"accept-encoding": "identity"})
    packed = client.get(series, headers={"accept-encoding": "br, gzip"})
    assert "content-encoding" not in plain.headers
    assert packed.headers["content-encoding"] == "gzip"
    assert packed.headers["vary"] == "accept-encoding"
    assert 3 * int(packed.headers["content-length"]) < int(plain.headers["content-length"])
    assert packed.content == plain.content
    assert "content-encoding" not in client.get(detail, headers={"accept-encoding": "gzip"}).headers


def test_a_prediction_goes_with_its_trial(tmp_path: Path) -> None:
    stored(tmp_path, 1, history=5)
    asked = asking(tmp_path)
    path = f"/api/sessions/{SESSION}"
    segment = max((tmp_path / "sessions" / SESSION / "history").glob("events-*"))
    events = [json.loads(line) for line in segment.read_text().splitlines()]
    moved = next(event for event in reversed(events) if event["event"] == "moved")
    append(tmp_path, moved | {"at": time.time(), "step": 6})
    reply = asked.get(path).json()
    assert (reply["worst"]["of"], reply["worst"]["step"], reply["moved"]["step"]) == ("predicted", 6, 6)
    append(tmp_path, {"event": "rolled_back", "step": 5, "iteration": 1})
    reply = asked.get(path).json()
    assert (reply["worst"]["of"], reply["worst"]["step"], reply["moved"], reply["corrected"]) == (
        "committed",
        5,
        {},
        {},
    )


def test_steps_that_a_crash_took_are_shown_no_more(tmp_path: Path) -> None:
    stored(tmp_path, 1, history=5)
    asked = asking(tmp_path)
    path = f"/api/sessions/{SESSION}"
    assert (asked.get(path).json()["worst"]["of"], asked.get(path).json()["worst"]["step"]) == ("committed", 5)
    append(tmp_path, resumed_at(1))
    reply = asked.get(path).json()
    assert (reply["worst"]["of"], reply["moved"], reply["corrected"]) == ("uploaded", {}, {})
    assert asked.get(f"{path}/series").json()["columns"]["step"] == [1]


def test_a_trial_is_over_when_it_was_taken_back_or_its_worker_is_gone(tmp_path: Path) -> None:
    stored(tmp_path, 1, history=5)
    quality = {"threshold": 0.2}
    append(tmp_path, {"event": "moved", "step": 6, "iteration": 3, "quality": quality})
    page = Page(tmp_path, BUILD)
    page.update({"missing": "", "sessions": [[SESSION, "alive", "TRIAL", 5, 1]]})
    assert [(one["state"], one["iteration"]) for one in listed(page)] == [("TRIAL", 3)]
    page.update({"missing": "", "sessions": []})
    assert [(one["state"], one["worker"], one["iteration"]) for one in listed(page)] == [("READY", "none", 0)]
    append(tmp_path, {"event": "rolled_back", "step": 5, "iteration": 3})
    page.update({"missing": "", "sessions": [[SESSION, "alive", "READY", 5, 1]]})
    assert [(one["state"], one["iteration"]) for one in listed(page)] == [("READY", 0)]


def test_lists_that_wait_are_bounded_and_hold_up_no_other_question(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    stored(tmp_path, 1, history=5)
    monkeypatch.setattr("mesh_motion_server.watch.page.app._WAITING", 2)
    page = Page(tmp_path, BUILD)
    release, read = threading.Event(), page._archive.overview

    def slowly(workers: list[list[Any]]) -> list[dict[str, Any]]:
        release.wait(60)
        return read(workers)

    monkeypatch.setattr(page._archive, "overview", slowly)
    asked = asking_of(page)
    with ThreadPoolExecutor(3) as many:
        answers = [many.submit(asked.get, "/api/sessions") for _ in range(3)]
        refused = next(as_completed(answers)).result()
        assert (refused.status_code, refused.json()["message"]) == (503, "too many requests at a time")
        assert asked.get(f"/api/sessions/{SESSION}").status_code == 200
        release.set()
    assert sorted(answer.result().status_code for answer in answers) == [200, 200, 503]


def test_a_session_with_a_worker_is_listed_before_many_others(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for number in range(1, 4):
        stored(tmp_path, 1, session=f"{number}" * 32)
    monkeypatch.setattr("mesh_motion_server.watch.observation.overview._LISTED", 2)
    page = Page(tmp_path, BUILD)
    assert [one["session"][0] for one in listed(page)] == ["3", "2"]
    page.update({"missing": "", "sessions": [["1" * 32, "alive", "READY", 1, 1]]})
    assert [(one["session"][0], one["built"], one["label"]) for one in listed(page)] == [
        ("3", True, "wing"),
        ("1", True, "wing"),
    ]


def test_new_events_of_a_session_are_read(tmp_path: Path) -> None:
    stored(tmp_path, 1, history=5)
    asked = asking(tmp_path)
    path = f"/api/sessions/{SESSION}/series"
    assert asked.get(path).json()["columns"]["step"] == [1, 2, 3, 4, 5]
    (segment,) = (tmp_path / "sessions" / SESSION / "history").iterdir()
    lines = segment.read_text().splitlines()
    committed = json.loads(lines[-1]) | {"step": 6}
    with segment.open("a") as file:
        file.write(json.dumps(committed) + '\n{"at": 1, "event": "comm')
    assert asked.get(path).json()["columns"]["step"] == [1, 2, 3, 4, 5, 6]


def test_the_mesh_is_drawn_as_plot_draws_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    stored(tmp_path, 2)
    asked = asking(tmp_path)
    light = asked.get(f"/api/sessions/{SESSION}/mesh.png")
    assert light.headers["content-type"] == "image/png"
    assert light.content.startswith(b"\x89PNG")
    assert "retry-after" not in light.headers
    again = asked.get(f"/api/sessions/{SESSION}/mesh.png")
    assert again.content == light.content
    assert float(again.headers["retry-after"]) >= 1  # it was drawn before: a newer one may come
    dark = asked.get(f"/api/sessions/{SESSION}/mesh.png?dark")
    assert dark.content != light.content


def test_a_mesh_that_needs_too_much_memory_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    stored(tmp_path, 1)

    def narrowly(_folder: Path) -> Any:
        raise MemoryError

    monkeypatch.setattr("mesh_motion_server.watch.page.drawing.read_pair", narrowly)
    answer = asking(tmp_path).get(f"/api/sessions/{SESSION}/mesh.png")
    assert (answer.status_code, answer.json()["message"]) == (400, "the mesh is too large to be drawn here")


def test_half_a_character_is_shown_as_an_escape() -> None:
    assert json.loads(as_json({"label": "flap \udc80"})) == {"label": "flap \udc80"}


@pytest.mark.parametrize(
    ("path", "status"),
    [
        ("/api/sessions/" + "0" * 32, 404),
        (f"/api/sessions/{SESSION.upper()}x", 404),
        ("/api/sessions/..%2f..%2fetc", 404),
        ("/static/../app.py", 404),
        ("/static/%2e%2e/app.py", 404),
        ("/static/..%2fapp.py", 404),
        ("/static//etc/passwd", 404),
        ("/static/", 404),
        ("/manifest", 404),
        (f"/api/sessions/{SESSION}/series?points=many", 400),
        (f"/api/sessions/{SESSION}/series?first=-1", 400),
        (f"/api/sessions/{SESSION}/series?points=0&first=9999999999999999999", 400),
    ],
)
def test_unknown_paths_are_not_found(client: Any, path: str, status: int) -> None:
    answer = client.get(path)
    assert answer.status_code == status
    assert "root:" not in answer.text
    assert "import" not in answer.text


@pytest.mark.parametrize(
    "host", ["evil.example", "127.0.0.1.evil.example:7441", "localhost.", "192.0.2.1:7441", "::1", ""]
)
def test_a_name_that_is_not_this_machine_is_refused(client: Any, host: str) -> None:
    answer = client.get("/", headers={"host": host})
    assert answer.status_code == 421
    assert "content-security-policy" in answer.headers


@pytest.mark.parametrize("host", ["127.0.0.1", "127.0.0.1:9999", "localhost:7441", "LOCALHOST", "[::1]:7441"])
def test_this_machine_may_have_any_port_for_a_tunnel(client: Any, host: str) -> None:
    assert client.get("/", headers={"host": host}).status_code == 200


def test_insecure_permits_addresses_and_still_no_names() -> None:
    assert is_allowed_host("192.0.2.1:7441", insecure=True)
    assert not is_allowed_host("server.example:7441", insecure=True)
    assert not is_allowed_host("127.0.0.1:x", insecure=True)


@pytest.mark.parametrize("method", ["POST", "PUT", "DELETE", "OPTIONS", "PATCH", "TRACE"])
def test_nothing_but_reading(client: Any, method: str) -> None:
    answer = client.request(method, "/api/sessions", headers={"origin": "http://evil.example"})
    assert (answer.status_code, answer.headers["allow"]) == (405, "GET, HEAD")


def test_other_sites_get_nothing(client: Any) -> None:
    answer = client.get("/api/sessions", headers={"sec-fetch-site": "cross-site", "origin": "http://evil.example"})
    assert answer.status_code == 403
    assert client.get("/", headers={"sec-fetch-site": "cross-site"}).status_code == 200
    allowed = client.get("/api/sessions", headers={"origin": "http://evil.example"})
    assert not [name for name in allowed.headers if name.startswith("access-control")]
    assert allowed.headers["cross-origin-resource-policy"] == "same-origin"


def test_the_page_needs_nothing_from_elsewhere_and_no_inline_scripts(client: Any) -> None:
    answer = client.get("/")
    policy = answer.headers["content-security-policy"]
    assert "default-src 'none'" in policy
    assert "unsafe" not in policy
    assert "<script>" not in answer.text
    assert "style=" not in answer.text
    assert "://" not in answer.text
    for name in ("page.js", "page.css", "vendor/uplot/uPlot.iife.min.js"):
        head = client.head(f"/static/{name}")
        assert head.status_code == 200
        assert head.headers["content-type"].startswith(("text/javascript", "text/css"))


def test_shipped_files_have_the_sums_of_vendor_toml() -> None:
    vendor = STATIC / "vendor"
    for entry in tomllib.loads((vendor / "vendor.toml").read_text())["vendored"]:
        for name, digest in entry["files"].items():
            content = (vendor / entry["package"] / Path(name).name).read_bytes()
            assert hashlib.sha256(content).hexdigest() == digest, name
        assert (vendor / entry["package"] / "LICENSE").exists()


def test_columns_are_short_and_without_nan() -> None:
    values = plain_column(np.array([1.0, math.nan, 0.123456789, 123456.7891, -math.inf, 0.0, 1795890721.2703536]))
    assert values == [1.0, None, 0.12346, 123456.789, None, 0.0, 1795890721.27]  # a time is not moved by hours
    assert json.loads(json.dumps(values, allow_nan=False)) == values


def test_a_mesh_that_is_too_large_is_refused_in_words(
    client: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    stored(tmp_path, 1)
    monkeypatch.setattr("mesh_motion_server.watch.page.drawing._MESH_BYTES", 10)
    answer = asking(tmp_path).get(f"/api/sessions/{SESSION}/mesh.png")
    assert (answer.status_code, answer.json()["code"].partition(".")[0]) == (400, "INVALID_ARGUMENT")
    (tmp_path / "sessions" / SESSION / "mesh.bin").unlink()
    assert asking(tmp_path).get(f"/api/sessions/{SESSION}/mesh.png").status_code == 503


def test_an_answer_that_a_stop_cuts_off_says_so_and_is_no_defect(tmp_path: Path) -> None:
    page, go = Page(tmp_path, {}), threading.Event()

    async def cut_off() -> None:
        answer = asyncio.ensure_future(page._made(page._archive.lists, lambda: go.wait(5.0)))
        await asyncio.sleep(0.05)
        answer.cancel()
        with pytest.raises(HTTPException, match="the server stops") as caught:
            await answer
        assert caught.value.status_code == 503

    try:
        asyncio.run(cut_off())
    finally:
        go.set()
