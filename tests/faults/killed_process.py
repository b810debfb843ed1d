"""Commits for ever and is killed, again and again: ``python -m tests.faults.killed_process FOLDER LEVEL``.

For each line of standard input, a number of seconds, a process is forked that resumes the session in FOLDER (or opens
it) and commits step after step, until it is killed by SIGKILL that long after the fork. What it was answered goes to
standard output, a line each, as soon as it is known::

    resumed STEP SECONDS     the session is there, so long after the fork
    reply STEP DURABLE HEX   the COMMITTED frame of a step, and its durable step, which in the frame is the step; for
                             the step resumed at it is asked for once more
    killed
    failed WHY               instead of any of these, and then
    ended STATUS             it was not killed, but ended by itself

Forking keeps the time for imports out of each life; the process is killed as any other would be.
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
    """The stored session, or a new one of this level of durability where none was built yet."""
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
    """Ask for the commit of a step, which may be committed already; the line that says so.

    How far the disk has got when a commit is answered is another matter in each life: the frame is that of a reply
    which says that the step itself is durable.
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
    """Whole at once: a killed process leaves a part of a line at most if the pipe is full."""
    os.write(1, line.encode() + b"\n")


def main(folder: str, level: str) -> None:
    """Fork, wait, kill; whatever a life would load first has been loaded by then."""
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
