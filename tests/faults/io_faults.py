"""A disk that fails at each call that a session makes: the session becomes FROZEN, loses nothing, and afterwards
continues with the same bits.

A session runs (create, build, some steps) again and again; each time the disk fails one file operation later: full or
broken, once or for ever. Reads must still work and no further step may be accepted. On a healthy disk another process
must continue from the acknowledged steps, to the same coordinates, bit for bit, as a run without faults. Writes of
fewer bytes than requested are no fault.

This is done at each level of durability. With "relaxed" a disk failure after a commit's reply must show in the next
request, and steps that a reply called durable before must exist.
"""

import errno
import time
from collections import Counter
from pathlib import Path
from random import Random
from typing import Any

from mesh_motion_protocol.errors import MeshMotionError
from mesh_motion_protocol.messages import Build, Close, Commit, Fetch, Move, Status

from mesh_motion_server.session.store import SessionStore
from mesh_motion_server.settings import DURABILITY_LEVELS, ServerSettings
from tests.faults.check import Budget, Check, Result, require
from tests.faults.driver import Driver, make_driver, resume
from tests.faults.in_process import quiet
from tests.faults.model_files import FailingFiles, ModelFiles, ShortFiles
from tests.faults.stand_in import grid_mesh

ROOT = Path("/model")
STEPS = 4
_DISK = "RESOURCE_EXHAUSTED.DISK"
#: Seconds in which a disk that works has taken a state.
_PATIENCE = 60.0
#: The errors that a call may fail with, by name.
ERRORS = {name: getattr(errno, name) for name in ("ENOSPC", "EIO", "EDQUOT", "EROFS")}

#: Error, and whether it is for ever: what the levels "replay" and "relaxed" are tried with.
_OTHER_LEVELS = ((errno.EIO, False), (errno.ENOSPC, True))

Digests = dict[int, bytes]


class _Ended(Exception):
    """An error reply with this code ended the run."""


def fail_each_call(error: int, *, for_ever: bool, level: str = "full") -> Counter[str]:
    """Run once for each operation that can fail.

    ``error``: error number of errno; ``for_ever``: whether every later operation fails too; ``level``: level of
    durability. Returns how the runs ended: "not created", "not built", "FROZEN", "not rested" (with "replay": the state
    at the end, stored to save a later computation, was not written), and once "whole". Raises BrokenPromise,
    MeshMotionError if an acknowledged step or reply is lost or differs; a note names the place.
    """
    expected = _undisturbed()
    endings: Counter[str] = Counter()
    failed = True
    while failed:
        raw = ModelFiles()
        files = FailingFiles(raw, error=error, for_ever=for_ever)
        files.fail_at = 1 + endings.total()
        acknowledged: Digests = {}
        try:
            ending = _life(files, acknowledged, level)
            failed = bool(files.failed)
            require((ending == "whole") != failed, f"a failed {files.failed} was not reported")
            endings[ending] += 1
            raw.handles.clear()
            _continue(raw, acknowledged, expected)
        except Exception as wrong:
            wrong.add_note(f"(operation {files.fail_at}, {files.failed}, failed with {errno.errorcode[error]})")
            raise
    return endings


def short_writes(most: int, level: str = "full") -> None:
    """A run whose writes take at most this number of bytes.

    Raises BrokenPromise if anything differs from a run with complete writes.
    """
    raw, acknowledged = ModelFiles(), dict[int, bytes]()
    driver = _new(ShortFiles(raw, most), level)
    driver.open()
    _live(driver, acknowledged)
    driver.host.close()
    require(acknowledged == _undisturbed(), f"steps differ when writes take {most} bytes")
    require(resume(SessionStore(ROOT, files=raw)).step == STEPS, f"steps are lost when writes take {most} bytes")


def _undisturbed() -> Digests:
    driver = _new(ModelFiles(), "full")
    driver.open()
    digests: Digests = {}
    _live(driver, digests)
    return digests


def _new(files: Any, level: str) -> Driver:
    """A new session; with "replay" every third state is stored."""
    limits = ServerSettings(snapshot_steps=3)
    return make_driver(SessionStore(ROOT, files=files), [grid_mesh()], spec={"durability": level}, limits=limits)


def _live(driver: Driver, acknowledged: Digests) -> None:
    """Move and commit to the last step; raises _Ended at the first error reply."""
    while driver.host.step < STEPS:
        step = driver.host.step + 1
        moved = driver.move(step)[0]
        require(moved.type == "MOVED", f"MOVE was answered {moved}")
        (reply,) = driver.all(Commit, step=step)
        if reply.type == "ERROR":
            raise _Ended(reply.code)
        _await_durable(driver, reply.step)
        acknowledged[reply.step] = reply.digest


def _await_durable(driver: Driver, step: int) -> None:
    """Send requests until a step is durable; raises _Ended if the disk has failed after the commit's reply.

    With only one commit in progress, every run does the same operations.
    """
    deadline = time.monotonic() + _PATIENCE
    while (status := driver.ask(Status)).durable_step < step:
        require(time.monotonic() < deadline, f"step {step} does not become durable, and no reply says why")
        if status.state == "FROZEN":
            raise _Ended(driver.move(step + 1)[0].code)
        time.sleep(1e-4)


def _life(files: Any, acknowledged: Digests, level: str) -> str:
    """Run on a failing disk; return how the run ended."""
    try:
        driver = _new(files, level)
    except MeshMotionError as error:
        require(error.code == _DISK, f"OPEN was refused by {error.code}")
        return "not created"
    driver.join()
    driver.upload()
    (built,) = driver.all(Build)
    if built.type == "ERROR":
        require((built.code, built.state) == (_DISK, "OPENING"), f"BUILD was answered {built}")
        return "not built"
    try:
        _live(driver, acknowledged)
    except _Ended as ended:
        require(str(ended) == _DISK, f"COMMIT was refused by {ended}")
        _require_frozen(driver, acknowledged, relaxed=level == "relaxed")
        return "FROZEN"
    whole = not files.failed
    with quiet():  # what a session logs where no client waits for an answer is expected here
        driver.host.close()
    return "not rested" if whole and files.failed else "whole"


def _require_frozen(driver: Driver, acknowledged: Digests, *, relaxed: bool) -> None:
    """Reads still work, nothing is written any more, and the replies give the last committed step and the last durable
    step.
    """
    status = driver.ask(Status)
    last = max(acknowledged, default=0)
    steps = (status.step - relaxed, status.durable_step) if relaxed else (status.step, last)
    require((status.state, *steps) == ("FROZEN", last, last), f"{status.state} at step {status.step}, not {last}")
    require(driver.ask(Fetch).type == "FETCHED", "FETCH is refused")
    refused = driver.all(Move, driver.displacement(1), step=status.step + 1)[0]
    require(refused.type == "ERROR", "a frozen session moves")
    require((refused.code, refused.state) == (_DISK, "FROZEN"), f"MOVE was answered {refused}")
    require(driver.ask(Close).type == "CLOSED", "CLOSE is refused")


def _continue(raw: ModelFiles, acknowledged: Digests, expected: Digests) -> None:
    """Continue in another process on a healthy disk: the session exists and continues bit for bit, or it was never
    built.
    """
    try:
        host = resume(SessionStore(ROOT, files=raw))
    except MeshMotionError as error:
        require(error.code == "NOT_FOUND" and not acknowledged, f"RESUME is refused by {error.code}")
        return
    last = max(acknowledged, default=0)
    require(host.step in (last, last + 1), f"step {host.step} is resumed, {last} was acknowledged")
    driver = Driver(host, [grid_mesh()])
    driver.sequences = [1000]
    driver.join()
    _live(driver, acknowledged)
    host.close()
    differing = [step for step, digest in acknowledged.items() if expected[step] != digest]
    require(not differing, f"steps {differing} differ from an undisturbed life")


def run(seed: int, budget: Budget) -> Result:
    """Test every error at every call, once and for ever, some of them at the other levels, and short writes of random
    lengths.
    """
    random = Random(f"I/O faults {seed}")
    endings: Counter[str] = Counter()
    faults = [("full", error, for_ever) for error in ERRORS.values() for for_ever in (False, True)]
    faults += [(level, *fault) for level in ("replay", "relaxed") for fault in _OTHER_LEVELS]
    for level, error, for_ever in faults:
        endings += fail_each_call(error, for_ever=for_ever, level=level)
    shortened = 0
    while not shortened or budget.admits(shortened):
        short_writes(1 + int(10 ** random.uniform(0, 3.7)), DURABILITY_LEVELS[shortened % len(DURABILITY_LEVELS)])
        shortened += 1
    count = endings.total() - endings["whole"]
    calls = count // len(faults)
    got = f"{count} faults at {calls} calls, {endings['FROZEN']} FROZEN, all bitwise"
    details = {"faults": count, "calls": calls, "endings": dict(endings), "short_writes": shortened}
    named = {"errors": list(ERRORS), "levels": list(DURABILITY_LEVELS)}
    return Result(got, endings["FROZEN"] > 0, details | named)


CHECK = Check(
    "io-faults",
    "errors at every call, 3 levels, {count} lives of short writes: bitwise",
    short=10,
    full=300,
    seconds=16,
    run=run,
)
