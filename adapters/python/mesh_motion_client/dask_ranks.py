"""A session whose ranks are the workers of a Dask cluster, for who has no MPI.

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
``pip install 'mesh-motion-client[dask]'``, and sees files and server by the same names; for a server that asks
for keys, their files are named in its environment (:mod:`.keys`).

**A worker that dies** takes nothing with it. Another worker reads its partition and joins the session; all ranks drop
the trial and make it again, which gives the same bits: a move depends on the committed state and the motion alone.
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

#: Failures that one call may get over: a partition that takes one worker after the other with it takes the next too.
_ATTEMPTS = 5
#: While ranks are at work: how often the scheduler is asked whether their workers live.
_LOOK_SECONDS = 1.0


class _WorkerLost(Exception):
    """A rank is gone with its worker."""


class DaskSession:
    """A session whose ranks are on Dask workers; made by :func:`open_on_workers`. Used by one thread.

    Attributes
    ----------
    credentials : Credentials
    step : int
        The last committed step.
    moving_ids : (k,) int64 array
        Numbers of the moving nodes in the whole mesh, ascending.
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
            function that gives it for points (m, d) of the reference mesh: each worker calls it with its own moving
            nodes. It must depend on the points alone, and Dask must be able to pickle it.

        Raises
        ------
        QualityRefused
            If no acceptable mesh was found; there is no trial then.
        InvalidInput, SessionError, Unavailable, Timeout
            And what the function raises.
        """
        motions = [motion] * len(self._files) if callable(motion) else self._divided(motion)
        self._motions = None
        answer: Answer = self._repeated(lambda: self._made(motions))
        self._motions = motions
        return answer

    def commit(self) -> int:
        """Make the trial the committed state; its step."""
        motions, step = self._motions, self.step + 1
        if motions is None:
            raise SessionError("there is no trial to commit", hint="session.move(motion) makes one")

        def attempt() -> int:
            if self.step < step:  # otherwise it was done before a worker died
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
        """Have each worker write the committed coordinates (n, d) of its nodes; the files, by partition.

        ``partition-000.npy`` has them in the order of the nodes of ``partition-000.npz``; ``mesh-motion convert`` makes
        a mesh of the two.
        """
        written: list[str] = self._repeated(lambda: self._all("write", os.fspath(folder)))
        return written

    def close(self, outcome: Literal["keep", "discard"] = "keep") -> None:
        """End this use. ``keep`` leaves the session resumable, ``discard`` deletes it. Idempotent."""
        if self._is_joined:
            with contextlib.suppress(MeshMotionError, _WorkerLost):
                self._settle()  # none must wait for one that is gone
        wait(self._dismissed(outcome))
        self._threads.shutdown(wait=False)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: type[BaseException] | BaseException | TracebackType | None) -> None:
        self.close()

    # --- all ranks ---------------------------------------------------------------------------------------------------

    def open(self, settings: Mapping[str, Any], options: Mapping[str, Any]) -> Self:
        """Have the workers read their partitions, the first open the session, and the others join it."""
        for _ in range(_ATTEMPTS):
            try:
                self._place()
                first = self._call(0, "open", dict(settings), dict(options) | {"partitions": len(self._files)})
                (credentials,) = self._results([self._call(0, "announced")])
                self._enter(credentials, first)
                return self
            except _WorkerLost:
                self._dismissed("discard")  # one that was never built cannot be joined again
            except BaseException:
                self._dismissed("discard")
                raise
        raise self._too_many()

    def resume(self, credentials: Credentials) -> Self:
        """Have the workers read their partitions and take up a session that was kept."""
        self.credentials = credentials
        try:
            self._repeated(lambda: None)
        except BaseException:
            self._dismissed("keep")
            raise
        return self

    def _enter(self, credentials: Credentials, first: Future[Any]) -> None:
        """Have all ranks but the first join, and know the session."""
        places = self._results([first, *self._calls(self._everyone[1:], "join", credentials)])
        known, self.step = self.step, max(step for _, step in places)
        self.credentials, self._is_joined, self._is_settled = credentials, True, True
        self.moving_ids = np.unique(np.concatenate([ids for ids, _ in places]))
        self._rows_of = [np.searchsorted(self.moving_ids, ids) for ids, _ in places]
        if self.step < known:
            self._motions = None
            raise StepsLost(
                f"step {known} was committed, but after a restart the session stands at step {self.step}",
                hint="go on from session.step: the same moves and commits give the same coordinates again",
                details={"expected": self.step + 1, "got": known + 1},
            )

    def _repeated(self, attempt: Callable[[], Any]) -> Any:
        """Carry something out; again, if a worker of the cluster or of the server dies."""
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
        """After a failure: have each rank on a worker, in the session and without a trial, and none waiting."""
        if self._is_settled and set(self.workers) <= set(self._present()):
            return
        self._is_trial = False
        self._place()
        if not self._is_joined and self.credentials is not None:  # its worker in the server died, or it was kept
            first = self._call(0, "resume", self.credentials)
            self._results([first])
            self._enter(self.credentials, first)
        self.step = max(self._all("rest", self.credentials))
        self._is_settled = True

    def _place(self) -> None:
        """Put each rank whose worker is gone on another one: it reads its partition, and joins if others have."""
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
        """Addresses of the cluster's workers.

        Raises
        ------
        Unavailable
            If there is none for a while, or the scheduler does not answer.
        """
        deadline = time.monotonic() + self._patience
        while True:
            listed = self._listed()
            if found := listed - self._unreachable:  # the scheduler learns of a death a little later
                return sorted(found)
            if time.monotonic() > deadline:
                if listed:  # started again at the address that it had
                    self._unreachable.clear()
                    return sorted(listed)
                raise Unavailable(
                    f"the Dask cluster has had no worker for {self._patience:g} s",
                    hint="start workers (dask worker tcp://HOST:8786) and repeat the call: what is committed stays",
                )
            time.sleep(min(0.1, self._patience))

    def _listed(self) -> set[str]:
        """Addresses of the workers that the scheduler knows; none if it does not answer."""
        try:
            return set(self._cluster.nthreads())
        except OSError:
            return set()

    def _made(self, motions: Sequence[Motion]) -> Answer:
        """A trial."""
        first: Answer = self._results([self._call(number, "move", motion) for number, motion in enumerate(motions)])[0]
        self._is_trial = True
        return first

    def _all(self, verb: str, *given: Any) -> list[Any]:
        """Have all ranks do the same; their answers."""
        return self._results(self._calls(self._everyone, verb, *given))

    def _results(self, calls: Sequence[Future[Any]]) -> list[Any]:
        """What calls answer, when all have; the first failure as soon as there is one, a lost worker before others."""
        while True:
            ended, waiting = wait(calls, _LOOK_SECONDS, return_when=FIRST_EXCEPTION)
            failed = [error for call in calls if call in ended and (error := call.exception()) is not None]
            if failed:
                raise min(failed, key=lambda error: not isinstance(error, _WorkerLost))
            if not waiting:
                return [call.result() for call in calls]
            gone = set(self.workers) - self._listed()
            if gone:  # Dask tries for half a minute to reach one
                raise _WorkerLost(", ".join(sorted(gone)))

    def _calls(self, numbers: Iterable[int], verb: str, *given: Any) -> list[Future[Any]]:
        return [self._call(number, verb, *given) for number in numbers]

    def _dismissed(self, outcome: Literal["keep", "discard"]) -> list[Future[Any]]:
        """The ranks end; what comes next begins with new ones."""
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
        """Have one rank do something, in a thread that waits for its answer."""
        return self._threads.submit(self._asked, number, self.workers[number], f"{self._name}-{number}", verb, *given)

    def _asked(self, number: int, worker: str, name: str, verb: str, *given: Any) -> Any:
        try:
            ended, found = self._cluster.run(perform, name, verb, *given, workers=[worker])[worker]
        except OSError as error:
            self._unreachable.add(worker)
            ended, found = "lost", error
        except Exception as error:  # what was sent cannot be read there, which Dask reports in several ways
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
        Of the server, as the workers reach it.
    cluster : dask.distributed.Client
    files : sequence of path
        One of each partition, as the workers see them: ``mesh-motion convert MESH FOLDER --partitions N`` writes them.
        Several may be on one worker.
    roles : dict
        Name of each patch → its role, as in :class:`.Patch`.
    settings, label, durability
        As for :meth:`.server.Server.open`; settings as ``evaluation = "client"`` takes them.
    credentials : Credentials, optional
        Of a session that was kept, with the same files: it goes on at its last committed step.
    patience : float
        Seconds to wait for a worker where there is none.

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
