"""A session whose ranks are the workers of a Dask cluster, for users without MPI.

Each worker reads the file of its partition, moves its nodes and judges its cells, as a solver's rank does
(``evaluation = "client"``); no process holds the whole mesh::

    from dask.distributed import Client
    from mesh_motion_client.dask_ranks import open_on_workers

    with Client("tcp://scheduler:8786") as cluster:
        roles = {"flag": "moving", "walls": "fixed"}
        with open_on_workers("tcp://server:7440", cluster, files, roles, settings) as session:
            moved = session.move(motion)        # moved.quality, moved.correction
            session.commit()
            session.write("out/step_0001")

``mesh-motion convert mesh.msh parts --partitions 4`` writes the files. Each worker needs
``pip install 'mesh-motion-client[dask]'``, and reaches files and server by the same names. For a server that requires
keys, the environment of each worker names the key files (:mod:`.keys`).

**If a worker dies**, nothing is lost. Another worker reads its partition and joins the session; all ranks drop the
trial and make it again. The result has the same bits, because a move depends only on the committed state and the
motion.
"""

from __future__ import annotations

import contextlib
import os
import time
import uuid
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import FIRST_EXCEPTION, Future, ThreadPoolExecutor, wait
from types import TracebackType
from typing import Any, Literal, Self

import numpy as np
from mesh_motion_protocol.errors import InvalidInput, MeshMotionError, SessionError, StepsLost, Unavailable
from numpy.typing import ArrayLike, NDArray

from mesh_motion_client.credentials import Credentials
from mesh_motion_client.dask_worker import Answer, Motion, perform
from mesh_motion_client.mesh import finite_rows

__all__ = ["DaskSession", "open_on_workers"]

#: Number of failures that one call survives: a partition that makes one worker crash will make the next crash too.
_ATTEMPTS = 5
#: Interval at which the scheduler is asked whether the workers of busy ranks are alive.
_LOOK_SECONDS = 1.0


class _WorkerLost(Exception):
    """A rank is lost, with its worker."""


class DaskSession:
    """A session whose ranks are on Dask workers; made by :func:`open_on_workers`. Used by one thread.

    Attributes
    ----------
    credentials : Credentials
    step : int
        The last committed step.
    moving_ids : (k,) int64 array
        Global ids of the moving nodes, ascending.
    workers : list of str
        Address of the worker of each partition.
    """

    def __init__(
        self, endpoint: str, cluster: Any, files: Sequence[str], roles: Mapping[str, str], patience: float
    ) -> None:
        self.credentials: Credentials | None = None
        self.step = 0
        self.moving_ids: NDArray[np.int64] = np.empty(0, dtype=np.int64)
        self.workers = [""] * len(files)
        self._cluster, self._endpoint, self._files, self._roles = cluster, endpoint, files, dict(roles)
        self._name, self._patience, self._everyone = uuid.uuid4().hex, patience, range(len(files))
        self._threads = ThreadPoolExecutor(2 * _ATTEMPTS * len(files) + 1, "mesh-motion-ranks")
        self._lost, self._unreachable = set[int](), set[str]()
        self._rows_of: list[NDArray[np.int64]] = []
        self._motions: Sequence[Motion] | None = None
        self._is_trial = self._is_joined = self._is_settled = False

    def move(self, motion: Motion) -> Answer:
        """Make a trial: one coupling iteration. Nothing is final yet.

        Parameters
        ----------
        motion : callable or (k, d) array, mesh length unit
            Total displacement of the moving nodes since the reference mesh, in the order of :attr:`moving_ids`. Or a
            function that returns it for points (m, d) of the reference mesh: each worker calls the function with its
            own moving nodes. The function must depend on the points alone, and Dask must be able to pickle it.

        Raises
        ------
        QualityRefused
            If no acceptable mesh was found; there is no trial then.
        InvalidInput, SessionError, Unavailable, Timeout
            Errors of the function are passed on.
        """
        motions = [motion] * len(self._files) if callable(motion) else self._divided(motion)
        self._motions = None
        answer: Answer = self._repeated(lambda: self._made(motions))
        self._motions = motions
        return answer

    def commit(self) -> int:
        """Make the trial the committed state; return its step."""
        motions, step = self._motions, self.step + 1
        if motions is None:
            raise SessionError("there is no trial to commit", hint="make one with session.move(motion)")

        def attempt() -> int:
            if self.step < step:  # otherwise the commit succeeded before a worker died
                if not self._is_trial:
                    self._made(motions)
                self._all("commit")
                self.step, self._is_trial = step, False
            return step

        self._repeated(attempt)
        self._motions = None
        return step

    def rollback(self) -> None:
        """Drop the trial."""
        self._motions, self._is_settled = None, False
        self._repeated(lambda: None)

    def write(self, folder: str | os.PathLike[str]) -> list[str]:
        """Write the committed coordinates (n, d) on each worker; return the files, in the order of the partitions.

        ``partition-000.npy`` has them in the order of the nodes of ``partition-000.npz``; ``mesh-motion convert`` joins
        the two files to a mesh.
        """
        written: list[str] = self._repeated(lambda: self._all("write", os.fspath(folder)))
        return written

    def close(self, outcome: Literal["keep", "discard"] = "keep") -> None:
        """End the use of the session. ``keep`` leaves it resumable, ``discard`` deletes it. Idempotent."""
        if self._is_joined:
            with contextlib.suppress(MeshMotionError, _WorkerLost):
                self._settle()  # no rank may wait for one that is gone
        wait(self._dismissed(outcome))
        self._threads.shutdown(wait=False)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: type[BaseException] | BaseException | TracebackType | None) -> None:
        self.close()

    # --- all ranks ---------------------------------------------------------------------------------------------------

    def open(self, settings: Mapping[str, Any], options: Mapping[str, Any]) -> Self:
        """Let the workers read their partitions; the first opens the session, and the others join it."""
        for _ in range(_ATTEMPTS):
            try:
                self._place()
                first = self._call(0, "open", dict(settings), dict(options) | {"partitions": len(self._files)})
                (credentials,) = self._results([self._call(0, "announced")])
                self._enter(credentials, first)
                return self
            except _WorkerLost:
                self._dismissed("discard")  # a session that was never built cannot be joined again
            except BaseException:
                self._dismissed("discard")
                raise
        raise self._too_many()

    def resume(self, credentials: Credentials) -> Self:
        """Let the workers read their partitions and resume a session that was kept."""
        self.credentials = credentials
        try:
            self._repeated(lambda: None)
        except BaseException:
            self._dismissed("keep")
            raise
        return self

    def _enter(self, credentials: Credentials, first: Future[Any]) -> None:
        """Let all ranks but the first join, and store the session's data."""
        places = self._results([first, *self._calls(self._everyone[1:], "join", credentials)])
        known, self.step = self.step, max(step for _, step in places)
        self.credentials, self._is_joined, self._is_settled = credentials, True, True
        self.moving_ids = np.unique(np.concatenate([ids for ids, _ in places]))
        self._rows_of = [np.searchsorted(self.moving_ids, ids) for ids, _ in places]
        if self.step < known:
            self._motions = None
            raise StepsLost(
                f"step {known} was committed, but after a restart the session stands at step {self.step}",
                hint="continue from session.step: the same moves and commits give the same coordinates again",
                details={"expected": self.step + 1, "got": known + 1},
            )

    def _repeated(self, attempt: Callable[[], Any]) -> Any:
        """Call ``attempt``; repeat it if a worker of the cluster or of the server dies."""
        for _ in range(_ATTEMPTS):
            try:
                self._settle()
                return attempt()
            except _WorkerLost:
                self._is_settled = False
            except Exception as error:
                self._is_settled = False
                if not isinstance(error, Unavailable) or error.code != "UNAVAILABLE.WORKER":
                    raise
                self._is_joined = False
        raise self._too_many()

    def _settle(self) -> None:
        """After a failure, put each rank on a worker and into the session, with no trial and no waiting call."""
        if self._is_settled and set(self.workers) <= set(self._present()):
            return
        self._is_trial = False
        self._place()
        if not self._is_joined and self.credentials is not None:  # the server's worker died, or the session was kept
            first = self._call(0, "resume", self.credentials)
            self._results([first])
            self._enter(self.credentials, first)
        self.step = max(self._all("rest", self.credentials))
        self._is_settled = True

    def _place(self) -> None:
        """Put each rank whose worker is gone on another one: it reads its partition, and joins if the others have."""
        present = self._present()
        lost = sorted(self._lost | {number for number, worker in enumerate(self.workers) if worker not in present})
        kept = [worker for number, worker in enumerate(self.workers) if number not in lost]
        for number in lost:
            self.workers[number] = min(present, key=kept.count)
            kept.append(self.workers[number])
        self._lost.update(lost)
        self._results([self._call(n, "read", self._endpoint, self._files[n], n, self._roles) for n in lost])
        if self._is_joined:
            self._results(self._calls(lost, "join", self.credentials))
        self._lost.difference_update(lost)

    def _present(self) -> list[str]:
        """Return the addresses of the cluster's workers.

        Raises
        ------
        Unavailable
            If there is no worker for a while, or the scheduler does not answer.
        """
        deadline = time.monotonic() + self._patience
        while True:
            listed = self._listed()
            if found := listed - self._unreachable:  # the scheduler notices a worker's death a little later
                return sorted(found)
            if time.monotonic() > deadline:
                if listed:  # a worker was started again at its old address
                    self._unreachable.clear()
                    return sorted(listed)
                raise Unavailable(
                    f"the Dask cluster has had no worker for {self._patience:g} s",
                    hint="start workers (dask worker tcp://HOST:8786) and repeat the call: committed steps are kept",
                )
            time.sleep(min(0.1, self._patience))

    def _listed(self) -> set[str]:
        """Addresses of the workers that the scheduler knows; none if it does not answer."""
        try:
            return set(self._cluster.nthreads())
        except OSError:
            return set()

    def _made(self, motions: Sequence[Motion]) -> Answer:
        """Make a trial with the motion of each rank."""
        first: Answer = self._results([self._call(number, "move", motion) for number, motion in enumerate(motions)])[0]
        self._is_trial = True
        return first

    def _all(self, verb: str, *given: Any) -> list[Any]:
        """Let all ranks do the same; return their answers."""
        return self._results(self._calls(self._everyone, verb, *given))

    def _results(self, calls: Sequence[Future[Any]]) -> list[Any]:
        """Return all results when they are complete; raise the first failure at once, a lost worker first."""
        while True:
            ended, waiting = wait(calls, _LOOK_SECONDS, return_when=FIRST_EXCEPTION)
            failed = [error for call in calls if call in ended and (error := call.exception()) is not None]
            if failed:
                raise min(failed, key=lambda error: not isinstance(error, _WorkerLost))
            if not waiting:
                return [call.result() for call in calls]
            gone = set(self.workers) - self._listed()
            if gone:  # Dask tries for half a minute to reach a lost worker
                raise _WorkerLost(", ".join(sorted(gone)))

    def _calls(self, numbers: Iterable[int], verb: str, *given: Any) -> list[Future[Any]]:
        return [self._call(number, verb, *given) for number in numbers]

    def _dismissed(self, outcome: Literal["keep", "discard"]) -> list[Future[Any]]:
        """End the ranks; the next call starts new ones."""
        here = [number for number, worker in enumerate(self.workers) if worker and worker not in self._unreachable]
        ending = self._calls(here, "close", outcome)
        self.workers, self._name, self._is_joined = [""] * len(self._files), uuid.uuid4().hex, False
        return ending

    def _too_many(self) -> Unavailable:
        return Unavailable(
            f"one call has lost {_ATTEMPTS} workers, the last at {self.workers}",
            hint="look at the workers' logs, and whether a partition takes more memory than a worker has",
        )

    # --- one rank ----------------------------------------------------------------------------------------------------

    def _call(self, number: int, verb: str, *given: Any) -> Future[Any]:
        """Let one rank do something, in a thread that waits for its answer."""
        return self._threads.submit(self._asked, number, self.workers[number], f"{self._name}-{number}", verb, *given)

    def _asked(self, number: int, worker: str, name: str, verb: str, *given: Any) -> Any:
        try:
            ended, found = self._cluster.run(perform, name, verb, *given, workers=[worker])[worker]
        except OSError as error:
            self._unreachable.add(worker)
            ended, found = "lost", error
        except Exception as error:  # the worker cannot unpickle the argument, which Dask reports in several ways
            raise InvalidInput(
                f"worker {worker} cannot be asked: {error}",
                hint="pip install 'mesh-motion-client[dask]' for the workers, in the version that is here; a "
                "motion may use what can be pickled, and modules that the workers have",
            ) from error
        if ended == "lost":
            self._lost.update(other for other, place in enumerate(self.workers) if place == worker)
            raise _WorkerLost(f"partition {number} on worker {worker}: {found}")
        if ended == "failed":
            found.add_note(f"partition {number}, {self._files[number]}, worker {worker}")
            raise found
        return found

    def _divided(self, motion: ArrayLike) -> list[Motion]:
        """The rows (m, d) of each rank."""
        rows = finite_rows(motion, "motion")
        if len(rows) != len(self.moving_ids):
            raise InvalidInput(
                f"motion must have {len(self.moving_ids)} rows, one a moving node, got {len(rows)}",
                code="INVALID_ARGUMENT.SHAPE",
                hint="session.moving_ids has the order of the rows",
            )
        return [rows[own] for own in self._rows_of]


def open_on_workers(
    endpoint: str,
    cluster: Any,
    files: Sequence[str | os.PathLike[str]],
    roles: Mapping[str, str],
    settings: Mapping[str, Any] | None = None,
    *,
    label: str = "",
    durability: str = "",
    credentials: Credentials | None = None,
    patience: float = 30.0,
) -> DaskSession:
    """Open a session whose ranks are the workers of a cluster.

    Parameters
    ----------
    endpoint : str
        The server's endpoint, as the workers reach it.
    cluster : dask.distributed.Client
    files : sequence of path
        One file for each partition, by the paths that the workers use: ``mesh-motion convert MESH FOLDER --partitions
        N`` writes them. One worker may have several partitions.
    roles : dict
        Name of each patch → its role, as in :class:`.Patch`.
    settings, label, durability
        As for :meth:`.server.Server.open`; settings as ``evaluation = "client"`` takes them.
    credentials : Credentials, optional
        Credentials of a session that was kept, with the same files: the session goes on at its last committed step.
    patience : float
        Seconds to wait for a worker if the cluster has none.

    Raises
    ------
    InvalidInput
        Naming the file and the worker, if a partition cannot be read; or as :meth:`.server.Server.open` does.
    Unavailable
        If there is no worker, or no server.
    """
    if not files:
        raise InvalidInput("expected the file of one partition at least, got none", hint="sorted(folder.glob('*.npz'))")
    session = DaskSession(endpoint, cluster, [os.fspath(file) for file in files], roles, patience)
    if credentials is not None:
        return session.resume(credentials)
    return session.open(settings or {}, {"label": label, "durability": durability})
