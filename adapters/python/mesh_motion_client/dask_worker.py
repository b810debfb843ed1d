"""A rank on a worker of a Dask cluster: the part of :mod:`.dask_ranks` that runs there."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from mesh_motion_protocol.errors import InvalidInput, ResourceExhausted, SessionError
from numpy.typing import ArrayLike, NDArray

from mesh_motion_client.credentials import Credentials
from mesh_motion_client.mesh import Mesh
from mesh_motion_client.quality import PredictedQuality
from mesh_motion_client.server import Server, connect
from mesh_motion_client.session import Session

__all__ = ["Answer", "Motion", "perform"]

Motion = Callable[[NDArray[np.float64]], ArrayLike] | ArrayLike
Place = tuple[NDArray[np.int64], int]
"""Global ids (k,) of a rank's moving nodes, and the last committed step."""


#: A longer traceback of an error keeps so many calls at its beginning, and at its end.
_CALLS = 20


@dataclass(frozen=True)
class Answer:
    """The result of a trial; the node positions stay on the workers. The fields are those of :class:`.moved.Moved`."""

    step: int
    iteration: int
    quality: PredictedQuality
    correction: dict[str, Any]
    warnings: list[str]


class _Rank:
    """One partition. All its calls run in one thread of its own, in the order in which they were made.

    The thread is not one of Dask's: two ranks on a worker with a single Dask thread would block each other.
    """

    session: Session | None = None
    server: Server | None = None

    def __init__(self, endpoint: str, path: str, partition: int) -> None:
        self.thread = ThreadPoolExecutor(1, "mesh-motion-rank")
        self.announced: Future[Credentials] = Future()
        self._endpoint, self._path, self._partition = endpoint, path, partition

    def read(self, roles: Mapping[str, str]) -> None:
        """Read the partition, and connect to the server."""
        self.mesh = Mesh.load(self._path, roles)
        if self.mesh.global_ids is None:
            raise InvalidInput(
                f"{self._path}: expected a partition, with global_ids",
                hint="mesh-motion convert MESH FOLDER --partitions N writes partitions",
            )
        self._ids = self.mesh.global_ids
        self.server = connect(self._endpoint)

    def open(self, settings: Mapping[str, Any], options: Mapping[str, Any]) -> Place:
        """Open the session; the other ranks join as soon as its credentials are announced."""
        announce = self.announced.set_result
        try:
            opened = self._connected.open(self.mesh, settings, evaluation="client", announce=announce, **options)
            return self._entered(opened)
        except Exception as error:
            if not self.announced.done():
                self.announced.set_exception(error)
            raise

    def resume(self, credentials: Credentials) -> Place:
        """Resume a session that was kept, or whose worker in the server died; the other ranks join afterwards."""
        return self._entered(self._connected.resume(credentials, self.mesh, partition=self._partition))

    def join(self, credentials: Credentials) -> Place:
        """Join the session, for the first time or in the place of a rank that is gone."""
        return self._entered(self._connected.join(credentials, self.mesh, partition=self._partition))

    def rest(self, credentials: Credentials) -> int:
        """Drop the trial together with all other ranks, whatever they are doing; return the last committed step."""
        while True:
            try:
                self._entered_session.rollback()
            except (InvalidInput, SessionError) as error:
                if error.code == "FAILED_PRECONDITION.STEP":  # the others have committed since this one joined
                    self.join(credentials)
                elif error.code != "INVALID_ARGUMENT.PARTITION":  # another partition's wait ended
                    raise
            else:
                self._entered_session.forget_correction()  # a new rank does not know it: all ask again
                return self._entered_session.step

    def move(self, motion: Motion) -> Answer:
        """Make a trial."""
        session = self._entered_session
        moved = session.move(motion(self.mesh.points[session.moving_nodes]) if callable(motion) else motion)
        return Answer(moved.step, moved.iteration, moved.quality, moved.correction, list(moved.warnings))

    def commit(self) -> None:
        """Make the trial the committed state."""
        self._entered_session.commit()

    def write(self, folder: str) -> str:
        """Write the committed coordinates (n, d) of all nodes to a file named like the partition's file."""
        points, path = self._entered_session.points(), Path(folder) / f"{Path(self._path).stem}.npy"
        partial = path.with_suffix(".part")
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            with partial.open("wb") as file:
                np.save(file, points)
            partial.replace(path)
        except OSError as error:
            raise ResourceExhausted(f"{path}: cannot be written: {error.strerror or error}") from error
        return str(path)

    def close(self, outcome: Literal["keep", "discard"]) -> None:
        """End this rank's use of the session."""
        if self.session is not None:
            self.session.close(outcome)
        if self.server is not None:
            self.server.close()

    def _entered(self, session: Session) -> Place:
        if self.session is not None:
            self.session.leave()
        self.session = session
        return self._ids[session.moving_nodes], session.step

    @property
    def _connected(self) -> Server:
        if self.server is None:
            raise SessionError("the partition is not read")
        return self.server

    @property
    def _entered_session(self) -> Session:
        if self.session is None:
            raise SessionError("the rank has not joined")
        return self.session


def _shorten(error: BaseException | None) -> None:
    """Leave the middle of long tracebacks out: pickle follows them call by call, until that is too deep as well."""
    while error is not None:
        calls = [error.__traceback__]
        while (call := calls[-1]) is not None:
            calls.append(call.tb_next)
        if len(calls) > 2 * _CALLS and (last := calls[_CALLS - 1]) is not None:
            last.tb_next = calls[-_CALLS]
        error = error.__cause__ or error.__context__


#: The ranks of this process, by session and partition.
_RANKS: dict[str, _Rank] = {}


async def perform(name: str, verb: str, *given: Any) -> tuple[Literal["done", "failed", "lost"], Any]:
    """Let the rank of this name do something; return its answer, or the error.

    ("read", endpoint, path, partition, roles) makes the rank. "lost": this process has no such rank, because the
    process was started later.
    """
    if verb == "read":
        _RANKS[name], given = _Rank(*given[:3]), given[3:]
    rank = _RANKS.pop(name, None) if verb == "close" else _RANKS.get(name)
    if rank is None:
        return "lost", None
    try:
        if verb == "announced":  # not in the rank's thread: that thread is opening the session
            return "done", await asyncio.wrap_future(rank.announced)
        return "done", await asyncio.get_running_loop().run_in_executor(rank.thread, getattr(rank, verb), *given)
    except Exception as error:  # includes every error of a user's motion
        _shorten(error)
        return "failed", error
    finally:
        if verb == "close":
            rank.thread.shutdown(wait=False)
