"""Commits without end and is killed, again and again: ``python -m tests.faults.killed_process FOLDER LEVEL``.

For each line of standard input, a number of seconds, the program forks a process that resumes the session in FOLDER (or
opens it) and commits step after step, until SIGKILL ends it that long after the fork. Each reply is written at once to
standard output, one line for each::

    resumed STEP SECONDS     the session is there, so long after the fork
    reply STEP DURABLE HEX   the COMMITTED frame of a step, and its durable step, which in the frame is the step; for
                             the step resumed at it is asked for once more
    killed
    failed WHY               instead of any of these, and then
    ended STATUS             it was not killed, but ended by itself

The fork keeps the time for imports out of each life; the process is killed like any other process.
"""

import os
import signal
import sys
import time
from dataclasses import replace

from mesh_motion_protocol.errors import SessionError
from mesh_motion_protocol.messages import Commit, Move

from mesh_motion_server.session.store import SessionStore
from mesh_motion_server.settings import ServerSettings
from tests.faults.check import require
from tests.faults.driver import Driver, make_driver, resume
from tests.faults.stand_in import grid_mesh
from tests.faults.undisturbed import Undisturbed, committer, frames_of, to_and_fro

#: States are stored so often that many lives end on either side of one.
_LIMITS = ServerSettings(snapshot_steps=8)


def open_session(store: SessionStore, life: int, level: str = "full") -> Driver:
    """The stored session, or a new one of this level of durability if none was built yet."""
    store.sweep()
    try:
        driver = Driver(resume(store, limits=_LIMITS), [grid_mesh()])
    except SessionError as error:
        if error.code != "NOT_FOUND":
            raise
        driver = make_driver(store, [grid_mesh()], spec={"durability": level}, limits=_LIMITS)
        driver.open()
        return driver
    driver.sequences = [1_000_000_000 * (life + 1)]
    driver.join()
    return driver


def _commit(driver: Driver, step: int) -> str:
    """Request the commit of a step, which may be committed already; return the output line.

    The durable step in a reply differs between lives, so the frame is that of a reply which says that the step itself
    is durable.
    """
    (reply,) = driver.send(driver.request(Commit, client=committer(0), sequence=step, step=step))
    require(reply.type == "COMMITTED", f"COMMIT of step {step} was answered {reply}")
    return f"reply {step} {reply.durable_step} {frames_of(replace(reply, durable_step=reply.step)).hex()}"


def live(folder: str, life: int, level: str) -> None:
    start = time.monotonic()
    driver = open_session(SessionStore(folder), life, level)
    step = driver.host.step
    _say(f"resumed {step} {time.monotonic() - start:.6f}")
    if step:
        _say(_commit(driver, step))
    while True:
        step = driver.host.step + 1
        (moved,) = driver.all(Move, to_and_fro(driver, step), step=step)
        require(moved.type == "MOVED", f"MOVE of step {step} was answered {moved}")
        _say(_commit(driver, step))


def _say(line: str) -> None:
    """Write the line in one piece: a killed process leaves a part of a line only if the pipe is full."""
    os.write(1, line.encode() + b"\n")


def main(folder: str, level: str) -> None:
    """Fork, wait, kill; all modules of a life are loaded before."""
    Undisturbed([grid_mesh()]).step(3)
    for life, seconds in enumerate(sys.stdin):
        child = os.fork()
        if not child:
            try:
                live(folder, life, level)
            except Exception as error:
                _say(f"failed {type(error).__name__}: {error}")
            finally:
                os._exit(1)
        time.sleep(float(seconds))
        os.kill(child, signal.SIGKILL)
        _, status = os.waitpid(child, 0)
        _say("killed" if os.WIFSIGNALED(status) and os.WTERMSIG(status) == signal.SIGKILL else f"ended {status}")


if __name__ == "__main__":
    main(*sys.argv[1:])
