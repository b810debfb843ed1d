"""Accidents at a chosen file operation of a server in this process, and requests that come while a commit is
written.
"""

import errno
import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NoReturn

from mesh_motion_protocol.errors import MeshMotionError

from mesh_motion_server.service.envelope import Envelope
from tests.faults.actions import Action
from tests.faults.check import require
from tests.faults.expected import Asked
from tests.faults.in_process import standing_of
from tests.faults.model_files import ModelFiles, PowerLoss
from tests.faults.ranks import Ranks
from tests.faults.session_model import SessionModel
from tests.faults.session_table import OPERATIONS

_COLLECTIVE = ("BUILD", "MOVE", "COMMIT", "ROLLBACK")


def _fail() -> NoReturn:
    raise OSError(errno.EIO, "injected")


def _stop() -> NoReturn:
    raise PowerLoss


def _break_down() -> NoReturn:
    raise RuntimeError("injected")


#: By name: the disk takes nothing more, the process is killed, power is lost, the server has a defect.
ACCIDENTS: dict[str, Callable[[], None]] = {"disk": _fail, "crash": _stop, "power": _stop, "defect": _break_down}


@dataclass
class Accident:
    """An accident at file operation number ``at`` and, unless ``once``, at all later ones; it records whether it
    happened.
    """

    happen: Callable[[], None]
    at: int
    once: bool = False
    count: int = 0
    fired: bool = False

    def __call__(self, _operation: str) -> None:
        self.count += 1
        if self.count > self.at and not (self.once and self.fired):
            self.fired = True
            self.happen()

    def over(self, files: ModelFiles, do: Callable[[], Any]) -> Any:
        """Return the result of ``do`` with the planned accident; afterwards the disk works again."""
        before, files.before = files.before, self
        try:
            return do()
        finally:
            files.before = before


class Stall:
    """A slow disk: every other thread waits at it until this thread continues, or the process is killed."""

    def __init__(self) -> None:
        self._here = threading.current_thread()
        self._over = threading.Event()
        self._killed = False

    def __call__(self, _operation: str) -> None:
        if threading.current_thread() is not self._here:
            self._over.wait()
            if self._killed:
                raise PowerLoss

    def end(self, *, killed: bool) -> None:
        """Each waiting request continues, or is dropped."""
        self._killed = killed
        self._over.set()


def ask_inside(host: Any, model: SessionModel, ranks: Ranks, commit: Asked, number: int) -> None:
    """Send a request while a commit is written: only STATUS and the end of the lease are admitted.

    A server answers one request after the other, so no client sees COMMITTING over a network; requests for this row of
    the table come from inside the commit.
    """
    state, model.state = model.state, "COMMITTING"
    before, operation = standing_of(host), OPERATIONS[number % len(OPERATIONS)]
    model.admits(operation)
    if operation == "LEASE_END":
        require(host.suspend() == [], "the lease's end is answered while a commit is written")
    elif operation == "RESUME":
        refused_resume(host, model)
    else:
        _request_inside(host, model, ranks.request(Action(operation, commit.message.partition), model))
    require(standing_of(host) == before, f"{operation} has changed something while a commit was written")
    model.state = state


def _request_inside(host: Any, model: SessionModel, asked: Any) -> None:
    (envelope,) = host.handle(Envelope(asked.peer, asked.message))
    if asked.kind in ("UPLOAD", *_COLLECTIVE):
        model.refuse_all([asked])
    reply, good = envelope.message, "STATUS_REPORT" if asked.kind == "STATUS" else "ERROR"
    message = f"inside a commit {asked.kind} was answered {reply}"
    require((reply.type, reply.state) == (good, "COMMITTING"), message)
    require(good != "ERROR" or reply.code == "FAILED_PRECONDITION.STATE", message)


def refused_resume(host: Any, model: SessionModel) -> None:
    """Send RESUME to a worker in a state that refuses it; control would replace this worker."""
    try:
        host.reclaim(model.token)
    except MeshMotionError as error:
        code = "RESOURCE_EXHAUSTED.DISK" if model.state == "FROZEN" else "FAILED_PRECONDITION.STATE"
        require(error.code == code, f"RESUME was refused by {error.code} in state {model.state}")
        return
    require(False, f"RESUME was taken in state {model.state}")
