"""Requests gone wrong for a whole server in process, in any state of its session: a typed error that changes nothing.

Each scene is a server with two sessions, one of them led to a state by valid requests; then come valid requests of
every type with one to three mutations, at the endpoint where they belong or at the other one, from its owner and from
others. Every reply must be one that can be decoded, answers this request, is of the request's reply type or an error,
and has a code that this request may have. A refused request changes nothing: neither where the session stands, nor a
file, nor the other session. Nothing is INTERNAL, nothing takes long, nothing is kept.
"""

from __future__ import annotations

import gc
import tempfile
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import count
from pathlib import Path
from random import Random
from typing import Any

import msgpack
import numpy as np
from mesh_motion_protocol.codec import decode
from mesh_motion_protocol.errors import ERROR_CODES
from mesh_motion_protocol.messages import COLLECTIVE, MESSAGES, REPLIES

from mesh_motion_server.settings import ServerSettings
from mesh_motion_server.transport.protection import Protection
from tests.faults.accidents import ACCIDENTS, Accident
from tests.faults.allowed_codes import allowed_codes
from tests.faults.check import Budget, Check, Result, require
from tests.faults.decoder_fuzz import memory_in_use
from tests.faults.in_process import USERS, InProcessServer, allow_everybody_listed, quiet, standing_of
from tests.faults.in_process_parts import Replies
from tests.faults.request_mutations import frames_of, gone_wrong
from tests.faults.stand_in import StandIn
from tests.faults.valid_requests import CONTROL, DATA, Known, Request, upload_of, valid_request

STATES = ("NEW", "OPENING", "READY", "TRIAL", "SUSPENDED", "FROZEN", "FAILED")
_OWNER = "owner"
_WITH_NUMBERS = ("UPLOAD", "MOVE")
#: State → what gets furthest there.
_ADMITTED = {"NEW": ("UPLOAD",), "OPENING": ("UPLOAD", "UPLOAD", "UPLOAD", "BUILD"), "READY": ("MOVE",),
             "TRIAL": ("MOVE", "MOVE", "COMMIT", "ROLLBACK")}  # fmt: skip
#: Seldom what changes the state for long: OPEN, RESUME, CLOSE.
_CONTROL_WEIGHTS = (4, 1, 1, 4, 4, 2)
_DATA_WEIGHTS = (*(6,) * 12, 1, 2)
#: Messages of a scene.
_MESSAGES = 250
#: Before memory is looked at, every other scene with the numerics themselves: what is made once is made then.
_LEAST_WARM_UP = 3000
_MOST_GROWTH = 5 << 20
#: Scenes from one look at the memory to the next, some 290 000 messages: proof.json shows whether it still grows.
_SCENES_BETWEEN_LOOKS = 2000
#: Seconds of processor time that one message may take: ten thousand times the usual.
_MOST_SECONDS = 2.0
_SETTINGS = ServerSettings(stored_replies=4, max_sessions=4)


@dataclass
class Scene:
    """A server whose session is in a state, and what came of the messages."""

    server: InProcessServer
    known: Known
    random: Random
    aim: str
    outcomes: Counter[str] = field(default_factory=Counter)
    states: Counter[str] = field(default_factory=Counter)
    slowest: float = 0.0
    bystander: str = ""

    @classmethod
    def set(cls, protection: Protection, state: str, random: Random, *, real: bool = False) -> Scene:
        """A new server, and one or two partitions' session in this state."""
        server = InProcessServer(protection, None if real else StandIn, _SETTINGS)
        partitions = random.choice((1, 1, 2))
        scene = cls(server, cls._open(server, _OWNER, partitions), random, state)
        bystander = cls(server, cls._open(server, "stranger", 1), random, "TRIAL")
        bystander.lead("stranger")
        scene.lead(_OWNER)
        scene.bystander = bystander.known.session
        return scene

    @staticmethod
    def _open(server: InProcessServer, user: str, partitions: int) -> Known:
        request = valid_request("OPEN", Known("", b"", 1, 1), 0, Random(0))
        request.header["fields"] |= {"dimension": 2, "partitions": partitions, "settings": {}}
        ((_, frames),) = server.control(user, b"control", [msgpack.packb(request.header)])
        opened: Any = decode(frames)
        return Known(opened.session, opened.token, opened.epoch, partitions)

    def lead(self, user: str) -> None:
        """By valid requests from NEW to the state that it is about."""
        order = STATES.index(self.aim)
        self._all("JOIN", user)
        if order >= 1:
            self._upload(user)
        if order >= 2:
            self._all("BUILD", user)
        if order >= 3:
            self._all("MOVE", user)
        self._arrive(user)

    def _arrive(self, user: str) -> None:
        """From TRIAL."""
        state = self.aim
        if state == "SUSPENDED":
            self.server.end_lease(self.known.session)
        elif state in ("FROZEN", "FAILED"):
            accident = Accident(ACCIDENTS["disk" if state == "FROZEN" else "defect"], 0)
            accident.over(self.server.files, lambda: self._all("COMMIT", user))

    def _all(self, kind: str, user: str) -> None:
        for partition in range(self.known.partitions):
            self._valid(valid_request(kind, self.known, partition, Random(1)), user, partition)

    def _valid(self, request: Request, user: str, partition: int) -> None:
        frames = [msgpack.packb(request.header), *request.frames]
        self.server.data(self.known.session, user, b"peer %d" % partition, frames)

    def _upload(self, user: str) -> None:
        for partition, parts in enumerate(self.known.uploads):
            for part in parts:
                self._valid(upload_of(self.known, partition, part), user, partition)

    def _lead_back(self) -> None:
        """Now and then, to the state that the scene is about, and to connections that have joined."""
        state = self._state()
        if self.random.random() > 0.2:
            return
        if state != "SUSPENDED":
            self._all("JOIN", _OWNER)
        if self.aim in ("TRIAL", "SUSPENDED", "FROZEN", "FAILED") and state == "READY":
            self._learn()
            self._all("MOVE", _OWNER)
            self._arrive(_OWNER)

    # --- one message -------------------------------------------------------------------------------------------------

    def next(self) -> None:
        """Send one message and judge what comes of it."""
        random, known = self.random, self.known
        self._lead_back()
        at_data = random.random() < 0.8
        right = random.random() < 0.97
        kind = random.choices(*((DATA, _DATA_WEIGHTS) if at_data == right else (CONTROL, _CONTROL_WEIGHTS)))[0]
        if at_data and random.random() < 0.4:
            kind = random.choice(_ADMITTED.get(self._state(), DATA))
        partition = random.randrange(known.partitions)
        user = _OWNER if random.random() < 0.9 else random.choice(tuple(USERS))
        self._learn()
        request = valid_request(kind, known, partition, random)
        gone_wrong(request, known, random)
        frames = frames_of(request, random)
        try:
            self._send(frames, user, partition if at_data else None)
        except Exception as error:
            error.add_note(f"(to the {'data' if at_data else 'control'} endpoint, as {user}, in state {self._state()}: "
                           f"{[frame[:300].hex() for frame in frames]})")  # fmt: skip
            raise

    def _send(self, frames: list[bytes], user: str, partition: int | None) -> None:
        known, server = self.known, self.server
        before, entries, touched = self._standings(), self._entries(), len(server.files.operations)
        self.states[self._state()] += 1
        peer = b"control" if partition is None else b"peer %d" % partition
        start = time.thread_time()
        if partition is None:
            replies = server.control(user, peer, frames)
        else:
            replies = server.data(known.session, user, peer, frames)
        taken = time.thread_time() - start
        self.slowest = max(self.slowest, taken)
        require(taken < _MOST_SECONDS, f"a message took {taken:.1f} s")
        refused = self._judge(frames, replies, peer, "control" if partition is None else "data")
        after = self._standings()
        require(before[1] == after[1], "a session has been changed by what was sent to another one")
        if refused:
            require(before == after, "a refused request has changed where the session stands")
            done = server.files.operations[touched:]
            tried = _sent(frames)[0] == "BUILD" and done[:1] == ["create mesh.bin"]  # written while it is checked
            require((not done or tried) and entries == self._entries(), "a refused request has changed a file")

    def _entries(self) -> dict[Path, int]:
        """Which files there are."""
        return {path: id(file) for path, file in self.server.files.entries.items()}

    def _judge(self, frames: Sequence[bytes], replies: Replies, peer: bytes, endpoint: str) -> bool:
        """Look at the replies; whether all of them are refusals."""
        kind, number = _sent(frames)
        answers = [(to, decode(back)) for to, back in replies]
        for _, answer in answers:
            self._check(kind, answer)
        own = [answer for to, answer in answers if to == peer and answer.sequence in (number, 0)]
        fitting = [answer for answer in own if _fits(kind, answer)]
        waits = not own and kind in COLLECTIVE and self.known.partitions > 1
        came = [f"{answer.type} {getattr(answer, 'code', '')}" for _, answer in answers]
        require(fitting or waits, f"a {kind or 'message'} was answered {came}, which SPEC.md does not have for it")
        if kind in _WITH_NUMBERS and any(answer.type != "ERROR" for answer in fitting):
            require(_is_finite(decode(frames)), f"{kind} with a number that is none is taken")
        require(endpoint == "data" or len(answers) == 1, f"a {kind} has {len(answers)} replies")
        # the others are for requests that waited
        require(all(_ends_wait(a) for _, a in answers if a not in fitting), f"came {came}")
        return all(answer.type == "ERROR" for _, answer in answers) and bool(answers)

    def _check(self, kind: str, answer: Any) -> None:
        """A code that there is, and never INTERNAL."""
        code = getattr(answer, "code", "")
        self.outcomes[code or answer.type] += 1
        require(not code or (code in ERROR_CODES and code != "INTERNAL"),
                f"{kind} was answered {code}: {getattr(answer, 'message', '')}")  # fmt: skip

    def _standings(self) -> tuple[Any, Any]:
        found = []
        for session in (self.known.session, self.bystander):
            host = self.server.host(session)
            found.append(standing_of(host) if host is not None else None)
        return found[0], found[1]

    def _state(self) -> str:
        host = self.server.host(self.known.session)
        return str(host.state) if host is not None else "none"

    def _learn(self) -> None:
        """What a client would have read from replies."""
        host = self.server.host(self.known.session)
        if host is not None:
            self.known.epoch, self.known.step = host.epoch, host.step

    @property
    def is_over(self) -> bool:
        """Whether there is no session any more that could be asked."""
        return self.server.host(self.known.session) is None


def _fits(kind: str, answer: Any) -> bool:
    """Whether SPEC.md has this reply for a request of this type."""
    if answer.type == "ERROR":
        return answer.code in allowed_codes(kind)
    return bool(REPLIES.get(kind) == answer.type)


def _is_finite(message: Any) -> bool:
    """Whether all its arrays are."""
    arrays = [value for value in vars(message).values() if isinstance(value, np.ndarray)]
    return all(bool(np.isfinite(array).all()) for array in arrays)


def _ends_wait(answer: Any) -> bool:
    """Whether a collective request that waited may have this reply."""
    return any(_fits(kind, answer) for kind in COLLECTIVE)


def _sent(frames: Sequence[bytes]) -> tuple[str, int]:
    """Type and number of what was sent, as far as they can be read; the rest is passed over, not made and interned."""
    reader = msgpack.Unpacker(strict_map_key=True)
    found: dict[str, Any] = {"type": None, "sequence": None}
    try:
        reader.feed(frames[0])
        for _ in range(reader.read_map_header()):
            key = reader.unpack()
            if key in found:
                found[key] = reader.unpack()
            else:
                reader.skip()
    except Exception:
        return "", 0
    if reader.tell() != len(frames[0]):
        return "", 0
    kind, number = found["type"], found["sequence"]
    good = type(number) is int and 0 < number < 2**63
    return kind if isinstance(kind, str) and kind in MESSAGES else "", number if good else 0


def run(seed: int, budget: Budget) -> Result:
    """So many messages, after some that are not counted."""
    with tempfile.TemporaryDirectory() as folder, quiet() as found:
        protection = allow_everybody_listed(Path(folder))
        try:
            return _run(protection, seed, budget)
        except Exception as error:
            for inner in list(found)[-1:]:
                error.add_note(f"(in the server: {inner})")
            raise


def _run(protection: Protection, seed: int, budget: Budget) -> Result:
    first = Totals()
    for number in count(1):
        if not budget.warms_up(first.messages, _LEAST_WARM_UP):
            break
        play(protection, seed, -number, first)
    with _quick_collections():
        return _counted(protection, seed, budget)


@contextmanager
def _quick_collections() -> Iterator[None]:
    """Leave out of garbage collections what is there by now: modules and kernels, some 300 000 objects."""
    gc.collect()
    gc.freeze()
    try:
        yield
    finally:
        gc.unfreeze()


def _counted(protection: Protection, seed: int, budget: Budget) -> Result:
    totals = Totals()
    before, start = memory_in_use(), time.monotonic()
    growth: list[tuple[int, int]] = []
    for number in count():
        if not budget.admits(totals.messages):
            break
        if number % _SCENES_BETWEEN_LOOKS == 0:
            growth.append((totals.messages, memory_in_use() - before))
        play(protection, seed, number, totals)
    rate = totals.messages / (time.monotonic() - start)
    growth.append((totals.messages, memory_in_use() - before))
    return totals.result(rate, growth)


def play(protection: Protection, seed: int, number: int, totals: Totals) -> None:
    """One scene."""
    random = Random(f"handler fuzz {seed} {number}")
    state = STATES[number % len(STATES)]
    real = number < 0 and bool(number % 2)  # the numerics load their kernels one by one, when they are first needed
    scene = Scene.set(protection, state, random, real=real)
    for message in range(_MESSAGES):
        if scene.is_over:
            break
        try:
            scene.next()
        except Exception as error:
            error.add_note(f"(scene {number}, message {message})")
            raise
        totals.messages += 1
    totals.add(scene)
    # A server and its sessions refer to each other, and the collector by itself comes after some hundred of them. What
    # outlives such a heap holds its pages: 10 MB in 200 000 messages, with no more of Python's blocks in use.
    del scene
    gc.collect()


@dataclass
class Totals:
    """What scenes came to."""

    messages: int = 0
    outcomes: Counter[str] = field(default_factory=Counter)
    states: Counter[str] = field(default_factory=Counter)
    slowest: float = 0.0

    def add(self, scene: Scene) -> None:
        """One more."""
        self.outcomes += scene.outcomes
        self.states += scene.states
        self.slowest = max(self.slowest, scene.slowest)

    def result(self, rate: float, growths: Sequence[tuple[int, int]]) -> Result:
        """With the messages of a second, and the bytes that the process had grown by after so many messages."""
        growth = growths[-1][1]
        taken = sum(count for name, count in self.outcomes.items() if name not in ERROR_CODES)
        details = {
            "messages": self.messages,
            "taken": taken,
            "per_second": round(rate),
            "growth_bytes": growth,
            "growth_bytes_by_messages": growths,
            "slowest_seconds": round(self.slowest, 4),
            "states": dict(sorted(self.states.items())),
            "outcomes": dict(sorted(self.outcomes.items())),
        }
        got = f"{self.messages} requests, 0 INTERNAL, {growth / 2**20:+.1f} MB, {rate:.0f} a second"
        return Result(got, growth < _MOST_GROWTH and 0 < taken < self.messages, details)


CHECK = Check(
    "handler-fuzz",
    "{count} requests in any state: a typed reply, nothing changed",
    short=30_000,
    full=10_000_000,
    seconds=20,
    run=run,
)
