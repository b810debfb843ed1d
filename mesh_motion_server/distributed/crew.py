"""Asks all partitions of a mesh the same question, and restores the partitions of a lost worker.

A partition is placed on a worker as data that only this session uses; when the worker dies, Dask reports that its data
and every task on it are gone. Then the partition is cut out of the mesh again (or read again from its file), placed on
another worker, and asked again; the answers of the others stay valid.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

from mesh_motion_server.distributed.connection import Connection, no_workers, require_dask
from mesh_motion_server.distributed.held import Answer, HeldPartition, perform
from mesh_motion_server.distributed.traffic import Traffic, size_of
from mesh_motion_server.errors import ResourceError

__all__ = ["Crew", "Question"]

#: Seconds between checks whether the awaited workers still live.
_LOOK = 0.5
#: How often one question is repeated before it fails: each time a worker was lost.
_ATTEMPTS = 5


@dataclass(frozen=True)
class Question:
    """The question to every partition.

    Attributes
    ----------
    task : callable
        A function of :mod:`~mesh_motion_server.distributed.held`.
    kind_sent, kind_received : str
        For the byte counts.
    arguments : callable
        (partition, whether it may have lost its versions) → arguments of the task.
    """

    task: Callable[..., Any]
    kind_sent: str
    kind_received: str
    arguments: Callable[[int, bool], tuple[Any, ...]]


class Crew:
    """The partitions of one mesh on the workers of one cluster.

    Parameters
    ----------
    connection : Connection
    name : str
        Names the data on the workers; unique among all sessions.
    count : int
        Number of partitions.
    make : callable
        (number) → a :class:`HeldPartition`, or a function without arguments that makes it on the worker.

    Attributes
    ----------
    traffic : Traffic
    seconds, longest_seconds : float
        Processor time of the workers so far: all partitions together, and of each question the longest.
    """

    def __init__(self, connection: Connection, name: str, count: int, make: Callable[[int], Any]) -> None:
        self._connection = connection
        self._name = name
        self._make = make
        self._placed: dict[int, Any] = {}
        self._where: dict[int, str] = {}
        self._generation = 0
        self.count = count
        self.traffic = Traffic()
        self.seconds = 0.0
        self.longest_seconds = 0.0

    def ask(self, question: Question) -> list[Any]:
        """Return the answers of all partitions, in their order.

        Raises
        ------
        ResourceError
            UNAVAILABLE when there is no worker for the connection's patience, or workers keep dying.
        MeshMotionError
            What a task raises.
        """
        self.traffic.rounds += 1
        answers: dict[int, Any] = {}
        fresh: set[int] = set()
        losses = 0
        while len(answers) < self.count:
            open_now = [number for number in range(self.count) if number not in answers]
            fresh |= self._place([number for number in open_now if number not in self._placed])
            found, lost = self._round(question, open_now, fresh)
            answers |= {number: answer.value for number, answer in found.items()}
            self.longest_seconds += max((answer.seconds for answer in found.values()), default=0.0)
            losses += bool(lost)
            if losses > _ATTEMPTS:
                raise ResourceError(
                    f"workers were lost {losses} times while partition {min(lost)} was computed",
                    code="UNAVAILABLE",
                    hint="look at the workers' logs: most often their memory is too small for a partition",
                )
        return [answers[number] for number in range(self.count)]

    def close(self) -> None:
        """Free the partitions. Idempotent."""
        self._placed.clear()
        self._where.clear()

    def _round(
        self, question: Question, numbers: Sequence[int], fresh: set[int]
    ) -> tuple[dict[int, Answer], list[int]]:
        """Ask some partitions: the answers, and the lost ones; those that lack a version are added to ``fresh``."""
        futures = {number: self._submit(question, number, number in fresh) for number in numbers}
        self._wait(futures)
        answers: dict[int, Answer] = {}
        lost = []
        for number, answer in self._gathered(futures).items():
            if answer is None:
                lost.append(number)
                self._forget(number)
            elif answer.value is None:
                fresh.add(number)
            else:
                answers[number] = answer
                self.seconds += answer.seconds
                self.traffic.received[question.kind_received] += size_of(answer.value)
        return answers, lost

    def _submit(self, question: Question, number: int, fresh: bool) -> Any:
        """Start one task on the worker that has the partition; None if the worker is gone."""
        arguments = question.arguments(number, fresh)
        self.traffic.sent[question.kind_sent] += size_of(arguments)
        try:
            return self._connection.client().submit(
                perform,
                self._placed[number],
                question.task,
                *arguments,
                workers=[self._where[number]],
                pure=False,
                retries=0,
                key=f"{self._name}-{question.task.__name__}-{number}-{self._next()}",
            )
        except require_dask().client.FutureCancelledError:
            return None

    def _wait(self, futures: dict[int, Any]) -> None:
        """Wait until every task has ended, is cancelled, or has lost its worker."""
        distributed = require_dask()
        silent_since: float | None = None
        while True:
            waiting = {n: f for n, f in futures.items() if f is not None and f.status == "pending"}
            if not waiting:
                return
            try:
                with self._connection.client().as_current():
                    distributed.wait(list(waiting.values()), timeout=_LOOK)
            except distributed.client.FuturesCancelledError:
                continue
            except TimeoutError:
                alive = set(self._connection.workers())
                silent_since = None if alive else silent_since or time.monotonic()
                if silent_since is not None and time.monotonic() - silent_since > self._connection.patience:
                    raise no_workers(self._connection.address, self._connection.patience) from None
                for number, future in waiting.items():
                    if alive and self._where.get(number) not in alive:
                        future.cancel()

    def _gathered(self, futures: dict[int, Any]) -> dict[int, Answer | None]:
        """Collect the answers of ended tasks: all at once, or one by one if some are lost."""
        if all(future is not None and future.status == "finished" for future in futures.values()):
            with suppress(*self._losses()):
                return dict(zip(futures, self._connection.client().gather(list(futures.values())), strict=True))
        return {number: self._answer(future) for number, future in futures.items()}

    @staticmethod
    def _losses() -> tuple[type[Exception], ...]:
        """Return the exceptions that Dask raises when a result is lost with its worker."""
        distributed = require_dask()
        return distributed.client.FutureCancelledError, distributed.KilledWorker, OSError, TimeoutError

    def _answer(self, future: Any) -> Answer | None:
        """Return the answer of an ended task; None if it is lost with its worker."""
        if future is None or future.status in ("cancelled", "lost", "pending"):
            return None
        try:
            answer: Answer = future.result(timeout=self._connection.patience)
        except self._losses():
            return None
        return answer

    # --- where partitions are ----------------------------------------------------------------------------------------

    def _place(self, numbers: Sequence[int]) -> set[int]:
        """Put partitions on the workers that have the fewest."""
        for number in numbers:
            self._place_one(number)
        return set(numbers)

    def _place_one(self, number: int) -> None:
        made = self._make(number)
        begin = time.monotonic()
        while True:
            worker = self._idlest()
            if worker is not None and self._put(number, made, worker):
                return
            if time.monotonic() - begin > self._connection.patience:
                raise no_workers(self._connection.address, self._connection.patience)
            time.sleep(min(_LOOK, self._connection.patience / 10.0))

    def _idlest(self) -> str | None:
        alive = self._connection.workers()
        load = Counter(self._where.values())
        return min(alive, key=lambda worker: (load[worker], worker), default=None)

    def _put(self, number: int, made: Any, worker: str) -> bool:
        """Place a partition on a worker; False if the worker is gone."""
        client = self._connection.client()
        key = f"{self._name}-{number}-{self._next()}"
        try:
            if isinstance(made, HeldPartition):
                placed = client.scatter({key: made}, workers=[worker], hash=False, direct=True)[key]
            else:
                placed = client.submit(made, workers=[worker], key=key, pure=False, retries=0)
        except (OSError, TimeoutError):
            return False
        self._placed[number], self._where[number] = placed, worker
        self.traffic.sent["mesh"] += made.mesh.nbytes if isinstance(made, HeldPartition) else 0
        return True

    def _forget(self, number: int) -> None:
        self._placed.pop(number, None)
        self._where.pop(number, None)
        self.traffic.rebuilt += 1

    def _next(self) -> int:
        """Return a number that no key has had."""
        self._generation += 1
        return self._generation
