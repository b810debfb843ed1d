"""The row of named failpoints: its former findings stay repaired, and servers with a bug are detected."""

import re
from collections.abc import Callable, Iterator
from contextlib import suppress

import pytest

from tests.faults import holder, named_failpoints, waiting
from tests.faults.check import BrokenPromise, Budget
from tests.faults.failpoint_table import POINTS
from tests.faults.named_failpoints import CHECK, TASKS, NotPassed, Rig, let_fail, passages, rig

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def lasting() -> Iterator[Rig]:
    """One server for all faults that it must survive."""
    with rig() as made:
        yield made


@pytest.mark.parametrize(
    ("task", "point", "fault", "hit"),
    [
        # each of these has once ended the server, hung, or given a wrong reply
        ("look", "store.list", "raise:EMFILE", 1),
        ("open", "supervisor.fork", "raise:EAGAIN", 1),
        ("open", "template.fork", "raise:EAGAIN", 1),
        ("lose the gateway", "supervisor.spawn", "raise:EAGAIN", 1),
        ("open", "store.discard.renamed", "raise:EIO", 1),
        ("return", "store.mesh.read", "raise:EIO", 1),
        ("return", "store.open.locked", "raise:EIO", 1),
        ("lose the lease", "session.suspend", "raise:RuntimeError", 1),
        ("step", "request.committed", "raise:MemoryError", 1),
        ("lose the gateway", "gateway.start", "kill", 1),
        # and some of the others
        ("step", "worker.received", "kill", 7),
        ("step", "journal.record.unsynced", "raise:ENOSPC", 1),
        ("roll back", "request.moved", "sleep:0.4", 2),
    ],
)
def test_a_fault_is_survived(lasting: Rig, task: str, point: str, fault: str, hit: int) -> None:
    let_fail(lasting, task, point, fault, hit)


def test_passages_are_counted_and_a_point_that_is_not_passed_is_reported(lasting: Rig) -> None:
    found = passages(lasting, ["step", "look"])
    assert (found["step"]["journal.commit.start"], found["look"]["store.list"]) == (1, 1)
    assert "journal.commit.start" not in found["look"]
    with pytest.raises(BrokenPromise, match="the point is passed 0 times only"):
        let_fail(lasting, "look", "journal.rotate", "kill", 1)


def test_a_point_that_no_task_passes_fails_the_row(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(named_failpoints, "TASKS", {"step": TASKS["step"]})
    monkeypatch.setattr(named_failpoints, "passages", lambda made: passages(made, ["step"]))
    with pytest.raises(BrokenPromise, match=r"no task passes store\.create\.folder-made"):
        CHECK.run(1, Budget(1))


@pytest.mark.parametrize(
    ("bug", "task", "failing", "said"),
    [
        ("a reply before its record", "step", "worker.received=kill@7", "step 2 was acknowledged"),
        ("an epoch in memory", "take over", "worker.sent=kill@3", "RESUME gives epoch"),
        ("a record without its reply", "step", "worker.received=kill@7", r"COMMIT is answered .*\.STEP"),
        ("an error that is answered as none", "step", "journal.commit.start=raise:EIO@1", "was acknowledged"),
        ("a worker that is given away twice", "look", "worker.received=kill@1", "nothing within|again and again"),
        ("a worker that hangs where it fails", "step", "request.execute=raise:RuntimeError@1", "nothing within"),
    ],
)
def test_a_bug_is_found(
    seed: Callable[..., None], monkeypatch: pytest.MonkeyPatch, bug: str, task: str, failing: str, said: str
) -> None:
    seed(bug)
    hangs = bug.startswith("a worker")
    monkeypatch.setattr(holder, "PATIENCE", 4.0 if hangs else waiting.PATIENCE)
    point, fault, hit = re.split("[=@]", failing)
    with pytest.raises(BrokenPromise, match=said):
        try_several_times(task, point, fault, int(hit))


def try_several_times(task: str, point: str, fault: str, hit: int) -> None:
    """Each test has its own server, because the message of passage number ``hit`` depends on the machine too."""
    for _ in range(4):
        with rig() as made, suppress(NotPassed):
            let_fail(made, task, point, fault, hit)


def test_the_plans_reach_every_point() -> None:
    assert CHECK.short == len(POINTS)
    assert CHECK.full >= 25 * 40
