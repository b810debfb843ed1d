"""The row of authorisation: all requests once, and detection of servers that answer wrongly or reveal data to
strangers.
"""

import time
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from random import Random

import pytest
from mesh_motion_protocol.messages import Ping

from mesh_motion_server.security.authorisation import Verdict, decide
from tests.faults import authorisation_matrix as row
from tests.faults.authorisation_matrix import Stage
from tests.faults.check import BrokenPromise
from tests.faults.expected_rights import COMBINATIONS, REQUESTS, Cell, expected, role_cells
from tests.faults.hidden_sessions import require_alike, require_same_time, time_differences, times
from tests.faults.wire import Wire

Seed = Callable[..., None]


def test_the_expected_rights_and_the_servers_table_agree_but_are_separate() -> None:
    said = {Verdict.USE: "use", Verdict.OVERSEE: "oversee"}
    cells = list(role_cells())
    assert len(cells) == len(set(cells)) == (len(COMBINATIONS) + 1) * 2 * len(REQUESTS)
    for cell in cells:
        verdict = decide(cell.roles, cell.request, own=cell.own)
        assert expected(cell.roles, cell.request, own=cell.own) == said.get(verdict, verdict.value), str(cell)
    source = Path(row.__file__).with_name("expected_rights.py").read_text(encoding="utf-8")
    assert "import mesh_motion" not in source
    assert "from mesh_motion" not in source


def found(stage: Stage, cell: Cell) -> str:
    with pytest.raises(BrokenPromise) as raised:
        row.judge(cell, row.outcome(stage, cell))
    return str(raised.value)


def test_requests_after_the_refusal_do_not_wait_for_a_peer(tmp_path: Path) -> None:
    with closing(Stage(tmp_path)) as made, Wire(made.server.endpoint, made.unknown) as wire:
        assert wire._events.poll(30_000), "refused"
        time.sleep(0.2)  # libzmq takes the only peer away
        begun = time.monotonic()
        assert wire.is_refused([wire.request(Ping)] * 2)
        assert time.monotonic() - begun < 20


@pytest.mark.nightly
def test_wrong_cells_are_found(seed: Seed, tmp_path: Path) -> None:
    seed(
        "a monitor may close",
        "an owner may probe others sessions",
        "an admin may not list",
        "an allow list that is read once",
    )
    with closing(Stage(tmp_path)) as made:
        # this server never reads the list again, so the subject has the roles of its start
        assert "UNAUTHENTICATED, got PONG" in found(made, Cell((), "PING", "control", True))
        assert "expected NOT_FOUND, got PROBED" in found(made, Cell(("owner",), "PROBE", "control", False))
    seed("a monitor may close", "an admin may not list", "statuses show places")
    (tmp_path / "second").mkdir()
    with closing(Stage(tmp_path / "second")) as made:
        assert "PERMISSION_DENIED, got CLOSED" in found(made, Cell(("monitor",), "CLOSE", "data", False))
        assert "expected LISTED, got PERMISSION_DENIED" in found(made, Cell(("admin",), "LIST", "control", True))
        row.judge(cell := Cell(("owner",), "COMMIT", "data", True), row.outcome(made, cell))
        assert "shows places" in found(made, Cell(("monitor",), "STATUS", "data", True))


@pytest.mark.nightly
def test_an_answer_that_reveals_a_session_is_found(seed: Seed, tmp_path: Path) -> None:
    seed("no delay of not found", "another hint where there is a session")
    with closing(Stage(tmp_path)) as made, Wire(made.server.endpoint, made.subject) as control:
        existing = {"open": row.known(made.held(False))}
        with pytest.raises(BrokenPromise, match="PROBE of another's session, which is open, is answered"):
            require_alike(control, existing)
        with pytest.raises(BrokenPromise, match="it is to wait for 50 ms"):
            require_same_time(times(control, existing, Random(1), 3))


@pytest.mark.nightly
def test_a_delay_that_begins_after_the_lookup_is_found(seed: Seed, tmp_path: Path) -> None:
    seed("a lookup that takes its time after the delay began")
    with closing(Stage(tmp_path)) as made, Wire(made.server.endpoint, made.subject) as control:
        seconds = times(control, {"open": row.known(made.held(False))}, Random(1), 40)
    with pytest.raises(BrokenPromise, match="that is open comes"):
        require_same_time(seconds)


@pytest.mark.nightly
def test_a_user_who_names_himself_is_found(seed: Seed, tmp_path: Path) -> None:
    seed("users who name themselves")
    made = Stage(tmp_path)
    wrong = [(what, got) for what, wanted, got in row._without_keys(made) if got != wanted]
    assert wrong
    assert all("under a name from ZMTP metadata" in what for what, _ in wrong)


def test_times_are_compared_by_rank() -> None:
    random = Random(1)
    none = [0.051 + 1e-4 * random.random() + 0.1 * (n % 5 == 0) for n in range(200)]
    same = [0.051 + 1e-4 * random.random() + 0.1 * (n % 5 == 0) for n in range(200)]
    later = [seconds + 2e-4 for seconds in same]
    assert abs(time_differences({"none": none, "open": same})["open"][1]) < 4
    difference, deviation = time_differences({"none": none, "open": later})["open"]
    assert difference == pytest.approx(2e-4, abs=5e-5)
    assert deviation > 10
    with pytest.raises(BrokenPromise, match="that is open comes"):
        require_same_time({"none": none, "open": later})
