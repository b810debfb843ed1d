"""A fault at every named failpoint of a real server, under a solver that must finish its tasks.

The solver's tasks run once without a fault, which shows the points that each task passes, and how often; a point that
no task passes fails the check. Then, for each point, a task runs with one fault at one of its passages: the process is
killed, the operation fails, or it is late. The task must end in time; afterwards no acknowledged step is lost, all
replies and coordinates are bitwise those of an undisturbed run, also those on the disk, and another session takes its
next step. The server continues, unless the killed process was its own.
"""

import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from random import Random

from mesh_motion_server.session.journal.files import read_journal, read_stored_state
from mesh_motion_server.session.journal.filesystem import PosixFileSystem
from tests.faults.check import BrokenPromise, Budget, Check, Result, require
from tests.faults.failing_server import FailingServer
from tests.faults.failpoint_table import POINTS
from tests.faults.persistent_user import PARTITIONS, PersistentUser
from tests.faults.stand_in import grid_mesh, split_mesh
from tests.faults.undisturbed import Undisturbed
from tests.faults.waiting import PATIENCE, wait_until

#: A manifest of two partitions is full after some 250 commits.
_MOST_COMMITS = 400
#: How often a task is done until the planned passage comes: work in the background comes at its own time.
_TRIES = 4
#: Points in the server's own process: after a kill at one of them the check must start the server again.
_SUPERVISOR = ("supervisor.", "store.list", "store.sweep")


@dataclass
class Rig:
    """A server, the solver whose tasks get faults, and another solver that only continues.

    ``stops``: number of planned stops of the server.
    """

    server: FailingServer
    undisturbed: Undisturbed
    user: PersistentUser
    bystander: PersistentUser
    stops: int = 0

    def visit(self) -> None:
        """Another user opens a session, takes a step, and discards it."""
        visitor = PersistentUser(self.server, self.undisturbed)
        try:
            visitor.open()
            visitor.advance()
            visitor.leave("discard")
        finally:
            visitor.disconnect()
            self.user.refusals += visitor.refusals
        gone = self.server.state / "sessions" / visitor.session
        wait_until(lambda: not gone.exists(), "the discarded session is gone")

    def return_later(self) -> None:
        self.user.leave()
        self.user.connect()

    def lose_lease(self) -> None:
        before = self.server.passed("worker.lease-end")
        self.user.connect()
        self.user.disconnect()
        wait_until(lambda: self.server.passed("worker.lease-end") > before, "the lease ends")
        self.user.advance()

    def fill_manifest(self) -> None:
        """Commit until the journal continues with another manifest."""
        before = self.server.passed("journal.rotate")
        for _ in range(_MOST_COMMITS):
            self.user.begin()
            self.user.advance()
            if self.server.passed("journal.rotate") > before:
                return
        raise BrokenPromise(f"no manifest was full after {_MOST_COMMITS} commits")

    def restart(self) -> None:
        """Stop the server with SIGTERM, and start a new one for the same sessions."""
        self.server.stop()
        self.stops += 1
        self.server.ensure()
        self.user.look()

    def settle(self, enough: Callable[[], bool] = lambda: False) -> None:
        """Wait until all started processes are ready, or the condition holds."""
        passed = self.server.passed
        wait_until(
            lambda: (
                enough()
                or (
                    passed("template.start") + passed("gateway.start") >= passed("supervisor.spawn")
                    and passed("template.ready") >= passed("template.start")
                )
            ),
            "the template is ready",
        )

    def require_whole(self) -> None:
        """Raise unless both sessions continue, and the disk has the acknowledged steps."""
        for user in (self.user, self.bystander):
            user.begin()
            user.look()
            user.advance()
            folder, files = self.server.state / "sessions" / user.session, PosixFileSystem()
            ledger = read_journal(folder, files).ledger
            require(ledger.step == user.step, f"step {ledger.step} is on the disk, {user.step} was acknowledged")
            read_stored_state(folder, files, ledger)


@dataclass(frozen=True)
class _Task:
    """A task of the solver, and faults that belong to it."""

    do: Callable[[Rig], None]
    always: tuple[str, ...] = field(default=())


#: The quickest task comes first: each failpoint is tried in the first task that reaches it.
TASKS: Mapping[str, _Task] = {
    "look": _Task(lambda rig: rig.user.look()),
    "step": _Task(lambda rig: rig.user.advance()),
    "roll back": _Task(lambda rig: rig.user.change_its_mind()),
    "take over": _Task(lambda rig: rig.user.take_over()),
    "lose the lease": _Task(Rig.lose_lease),
    "open": _Task(Rig.visit),
    "return": _Task(Rig.return_later),
    "lose the worker": _Task(lambda rig: rig.user.advance(), ("worker.received=kill@1",)),
    "lose the gateway": _Task(lambda rig: rig.user.look(), ("gateway.received=kill@1",)),
    "restart": _Task(Rig.restart),
    "fill the manifest": _Task(Rig.fill_manifest),
}


@contextmanager
def rig() -> Iterator[Rig]:
    with tempfile.TemporaryDirectory(prefix="mm-") as folder:
        server, undisturbed = FailingServer(Path(folder)), Undisturbed(split_mesh(grid_mesh(), PARTITIONS))
        user, bystander = PersistentUser(server, undisturbed), PersistentUser(server, undisturbed)
        try:
            for each in (user, bystander):
                each.open()
                each.advance()
            yield Rig(server, undisturbed, user, bystander)
        finally:
            user.disconnect()
            bystander.disconnect()
            server.end()


def passages(rig: Rig, tasks: Sequence[str] = tuple(TASKS)) -> dict[str, dict[str, int]]:
    """Task → point → number of passages, without a fault except the task's own."""
    found = {}
    for name in tasks:
        rig.settle()
        rig.server.plan(*TASKS[name].always)
        rig.user.begin()
        TASKS[name].do(rig)
        rig.settle()
        found[name] = rig.server.passages()
    rig.server.plan()
    return found


class NotPassed(BrokenPromise):
    """A task did not pass the point often enough for its fault."""


def let_fail(rig: Rig, task: str, point: str, fault: str, hit: int) -> None:
    """Run a task with a fault at passage number ``hit`` of a point.

    Raises BrokenPromise if the point is not passed, or if a promise of :mod:`this module <.named_failpoints>` is
    broken.
    """
    rig.server.plan(*TASKS[task].always, f"{point}={fault}@{hit}")
    starts = rig.server.starts - rig.stops
    for _ in range(_TRIES):
        rig.user.begin()
        TASKS[task].do(rig)
        if _struck(rig, point, hit):
            break
    if not _struck(rig, point, hit):
        raise NotPassed(f"the point is passed {rig.server.passed(point)} times only")
    rig.server.plan()
    rig.require_whole()
    fell = rig.server.starts - rig.stops > starts
    may_fall = fault == "kill" and point.startswith(_SUPERVISOR)
    require(not fell or may_fall, f"the server ended: {rig.server.last_words()}")


def _struck(rig: Rig, point: str, hit: int) -> bool:
    """Whether the fault has happened, after all background work has ended."""
    rig.settle(lambda: rig.server.passed(point) >= hit)  # a process that it kills will never be ready
    return rig.server.passed(point) >= hit


def run(seed: int, budget: Budget) -> Result:
    """Plan a fault at each point in turn, each time at another passage and of another kind."""
    random, faults, start = Random(f"failpoints {seed}"), Counter[str](), time.monotonic()
    with rig() as made:
        found = passages(made)
        where = {point: [task for task in TASKS if point in found[task]] for point in POINTS}
        missed = [point for point in POINTS if not where[point]]
        require(not missed, f"no task passes {', '.join(missed)}")
        while budget.admits(done := faults.total()):
            point = list(POINTS)[done % len(POINTS)]
            kinds = POINTS[point]
            fault = kinds[(done // len(POINTS) + random.randrange(len(kinds))) % len(kinds)]
            hits = [random.randint(1, found[task][point]) for task in where[point]]
            _try_point(made, dict(zip(where[point], hits, strict=True)), point, fault)
            faults[fault.partition(":")[0]] += 1
        refusals = made.user.refusals + made.bystander.refusals
        details = {"points": len(POINTS), "faults": dict(faults), "refusals": dict(refusals),
                   "server_starts": made.server.starts, "steps": made.user.step + made.bystander.step}  # fmt: skip
    seconds = (time.monotonic() - start) / max(1, faults.total())
    got = f"{len(POINTS)} points, {faults.total()} faults ({faults['kill']} kills), 0 lost, {seconds:.1f} s each"
    return Result(got, True, details)


def _try_point(made: Rig, hits: dict[str, int], point: str, fault: str) -> None:
    """Cause one fault, in the first task that reaches the passage: some tasks pass a point only sometimes.

    Whatever goes wrong says where.
    """
    for task, hit in hits.items():
        try:
            let_fail(made, task, point, fault, hit)
        except Exception as error:
            if isinstance(error, NotPassed) and task != list(hits)[-1]:
                continue
            error.add_note(f"task {task!r} with {point}={fault}@{hit}, after at most {PATIENCE:.0f} s")
            raise
        return


CHECK = Check(
    "failpoints",
    "{count} faults at named points: no step lost, all bitwise, no hang",
    short=len(POINTS),
    full=25 * len(POINTS),
    seconds=80,
    run=run,
)
