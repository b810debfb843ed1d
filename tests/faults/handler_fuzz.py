"""Mutated requests for a whole server in this process, in any state of its session: each gives a typed error and
changes nothing.

Each scene is a server with two sessions; valid requests lead one of them to a state. Then come valid requests of every
type with one to three mutations, at the correct endpoint or at the other one, from its owner and from others. Every
reply must be decodable, answer this request, have the request's reply type or be an error, and have a code that is
allowed for this request. A refused request changes nothing: neither the state of the session, nor a file, nor the other
session. No reply is INTERNAL or slow, and no memory is kept.
"""

from __future__ import annotations

import gc
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from random import Random
from typing import Any

import msgpack
import numpy as np
from mesh_motion_protocol.codec import decode, encode
from mesh_motion_protocol.errors import ERROR_CODES
from mesh_motion_protocol.messages import COLLECTIVE, MESSAGES, REPLIES

from mesh_motion_server.settings import ServerSettings
from mesh_motion_server.transport.protection import Protection
from tests.faults.accidents import ACCIDENTS, Accident
from tests.faults.allowed_codes import allowed_codes
from tests.faults.check import Budget, Check, Result, require
from tests.faults.decoder_fuzz import Totals, campaign
from tests.faults.in_process import USERS, InProcessServer, allow_everybody_listed, quiet, standing_of
from tests.faults.in_process_parts import Replies
from tests.faults.mutations import CHANGES, VALUES, Change, Draft, gone_wrong
from tests.faults.stand_in import StandIn
from tests.faults.valid_requests import CONTROL, DATA, Known, valid_request

STATES = ("NEW", "OPENING", "READY", "TRIAL", "SUSPENDED", "FROZEN", "FAILED")
_OWNER = "owner"
_WITH_NUMBERS = ("UPLOAD", "MOVE")
#: State → what gets furthest there.
_ADMITTED = {"NEW": ("UPLOAD",), "OPENING": ("UPLOAD", "UPLOAD", "UPLOAD", "BUILD"), "READY": ("MOVE",),
             "TRIAL": ("MOVE", "MOVE", "COMMIT", "ROLLBACK")}  # fmt: skip
#: Requests that change the state for long are rare: OPEN, RESUME, CLOSE.
_CONTROL_WEIGHTS = (4, 1, 1, 4, 4, 2)
_DATA_WEIGHTS = (*(6,) * 12, 1, 2)
#: Number of messages of a scene, and the share of messages whose bytes are changed too.
_MESSAGES, _RAW = 250, 0.01
#: Number of first scenes, every other one with the real numerics: objects that are made once exist after them.
_LEAST_WARM_UP = 3000
#: Seconds of processor time that one message may take: ten thousand times the usual.
_MOST_SECONDS = 2.0
_SETTINGS = ServerSettings(stored_replies=4, max_sessions=4)


def changes_for(known: Known) -> Mapping[Change, int]:
    """All mutations of a message, and those that use the session: address, request id, valid words."""

    def address(draft: Draft, random: Random) -> None:
        others: dict[str, Any] = {
            "session": random.choice(("f" * 32, known.session.upper(), known.session[:-1], known.session + " ")),
            "epoch": random.choice((known.epoch - 1, known.epoch + 1, 0)),
            "partition": random.choice((known.partitions, 255, 0, 1)),
            "step": random.choice((known.step, known.step + 2, 0, 2**62)),
            "token": known.token[:-1] + b"\0",
        }
        fields = draft.header.get("fields")
        if isinstance(fields, dict) and (mine := [name for name in others if name in fields]):
            name = random.choice(mine)
            fields[name] = others[name]

    def repeated(draft: Draft, random: Random) -> None:
        draft.header["sequence"] = max(1, known.sequence - random.randrange(12))
        if random.random() < 0.2:
            draft.header["sequence"] = random.choice([value for value in VALUES if type(value) is int])
        if random.random() < 0.3:
            draft.header["client"] = bytes([random.randrange(5)]) * random.choice((16, 16, 16, 15, 0))

    def words(draft: Draft, random: Random) -> None:
        kind, fields = draft.header.get("type"), draft.header.get("fields")
        if kind == "UPLOAD" and isinstance(fields, dict):
            fields["item"] = random.choice(("nodes", "global_ids", "cells", "facets", "near_cells", "patch"))
            fields["name"] = random.choice(("", "triangle", "quad", "tetra", "line", "left", "x" * 256, "\0"))
            fields["role"] = random.choice(("", "moving", "fixed", "slip", "symmetry", "periodic"))
        if kind == "OPEN" and isinstance(fields, dict):
            setting = random.choice(("basis", "support_radius", "max_enrichment_points", "sub_steps", "displacement"))
            fields["settings"] = {setting: random.choice(VALUES)}

    return {**CHANGES, address: 5, repeated: 5, words: 4}


@dataclass
class Scene:
    """A server whose session is in a state, ``aim``; results of the messages are added to ``totals``."""

    server: InProcessServer
    known: Known
    random: Random
    aim: str
    totals: Totals
    bystander: str = ""

    @classmethod
    def set(cls, protection: Protection, state: str, random: Random, totals: Totals, *, real: bool = False) -> Scene:
        """A new server, and a session of one or two partitions in this state."""
        server = InProcessServer(protection, None if real else StandIn, _SETTINGS)
        scene = cls(server, cls._open(server, _OWNER, random.choice((1, 1, 2))), random, state, totals)
        other = cls(server, cls._open(server, "stranger", 1), random, "TRIAL", totals)
        other.lead("stranger")
        scene.lead(_OWNER)
        scene.bystander = other.known.session
        return scene

    @staticmethod
    def _open(server: InProcessServer, user: str, partitions: int) -> Known:
        fields = {"dimension": 2, "partitions": partitions, "settings": {}}
        request = valid_request("OPEN", Known("", b"", 1, 1), 0, Random(0), **fields)
        ((_, frames),) = server.control(user, b"control", encode(request))
        opened: Any = decode(frames)
        require(opened.type == "OPENED", f"OPEN was answered {opened}")
        return Known(opened.session, opened.token, opened.epoch, partitions)

    def lead(self, user: str) -> None:
        """Bring the session with valid requests from NEW to the state of the scene."""
        order = STATES.index(self.aim)
        self._all("JOIN", user)
        for part in range(len(self.known.uploads(0)) if order >= 1 else 0):
            self._all("UPLOAD", user, part)
        if order >= 2:
            self._all("BUILD", user)
        if order >= 3:
            self._all("MOVE", user)
        self._arrive(user)

    def _arrive(self, user: str) -> None:
        if self.aim == "SUSPENDED":
            self.server.end_lease(self.known.session)
        elif self.aim in ("FROZEN", "FAILED"):
            accident = Accident(ACCIDENTS["disk" if self.aim == "FROZEN" else "defect"], 0)
            accident.over(self.server.files, lambda: self._all("COMMIT", user))

    def _all(self, kind: str, user: str, part: int = 0) -> None:
        for partition in range(self.known.partitions):
            fields = self.known.uploads(partition)[part] if kind == "UPLOAD" else {}
            request = valid_request(kind, self.known, partition, Random(1), **fields)
            self.server.data(self.known.session, user, b"peer %d" % partition, encode(request))

    def _lead_back(self) -> None:
        """Sometimes bring the session back to the state of the scene, and join its connections again."""
        state = self._state()
        if self.random.random() > 0.2:
            return
        if state != "SUSPENDED":
            self._all("JOIN", _OWNER)
        if self.aim in ("TRIAL", "SUSPENDED", "FROZEN", "FAILED") and state == "READY":
            self._learn()
            self._all("MOVE", _OWNER)
            self._arrive(_OWNER)

    def next(self) -> None:
        random, known = self.random, self.known
        self._lead_back()
        at_data, right = random.random() < 0.8, random.random() < 0.97
        kind = random.choices(*((DATA, _DATA_WEIGHTS) if at_data == right else (CONTROL, _CONTROL_WEIGHTS)))[0]
        if at_data and random.random() < 0.4:
            kind = random.choice(_ADMITTED.get(self._state(), DATA))
        partition = random.randrange(known.partitions)
        user = _OWNER if random.random() < 0.9 else random.choice(tuple(USERS))
        self._learn()
        request = Draft.of(encode(valid_request(kind, known, partition, random)))
        frames = gone_wrong(request, random, changes_for(known), _RAW)
        try:
            self._send(frames, user, partition if at_data else None)
        except Exception as error:
            error.add_note(f"(to the {'data' if at_data else 'control'} endpoint, as {user}, in state {self._state()}: "
                           f"{[frame[:300].hex() for frame in frames]})")  # fmt: skip
            raise

    def _send(self, frames: list[bytes], user: str, partition: int | None) -> None:
        server, touched = self.server, len(self.server.files.operations)
        before, entries = self._standings(), self._entries()
        self.totals.states[self._state()] += 1
        peer = b"control" if partition is None else b"peer %d" % partition
        start = time.thread_time()
        if partition is None:
            replies = server.control(user, peer, frames)
        else:
            replies = server.data(self.known.session, user, peer, frames)
        taken = time.thread_time() - start
        self.totals.slowest = max(self.totals.slowest, taken)
        require(taken < _MOST_SECONDS, f"a message took {taken:.1f} s")
        refused = self._judge(frames, replies, peer)
        require(partition is not None or len(replies) == 1, f"a message to control has {len(replies)} replies")
        after = self._standings()
        require(before[1] == after[1], "a session has been changed by a message to another one")
        if refused:
            require(before == after, "a refused request has changed where the session stands")
            done = server.files.operations[touched:]
            tried = _sent(frames)[0] == "BUILD" and done[:1] == ["create mesh.bin"]  # written while it is checked
            require((not done or tried) and entries == self._entries(), "a refused request has changed a file")

    def _entries(self) -> dict[Path, int]:
        return {path: id(file) for path, file in self.server.files.entries.items()}

    def _judge(self, frames: Sequence[bytes], replies: Replies, peer: bytes) -> bool:
        """Check the replies; return whether all of them are refusals."""
        kind, number = _sent(frames)
        answers: list[tuple[bytes, Any]] = [(to, decode(back)) for to, back in replies]
        for _, answer in answers:
            code = getattr(answer, "code", "")
            self.totals.outcomes[code or answer.type] += 1
            require(not code or (code in ERROR_CODES and code != "INTERNAL"),
                    f"{kind} was answered {code}: {getattr(answer, 'message', '')}")  # fmt: skip
        own = [answer for to, answer in answers if to == peer and answer.sequence in (number, 0)]
        fitting = [answer for answer in own if _fits(kind, answer)]
        waits = not own and kind in COLLECTIVE and self.known.partitions > 1
        came = [f"{answer.type} {getattr(answer, 'code', '')}" for _, answer in answers]
        require(fitting or waits, f"a {kind or 'message'} was answered {came}, which SPEC.md does not have for it")
        if kind in _WITH_NUMBERS and any(answer.type != "ERROR" for answer in fitting):
            arrays = [value for value in vars(decode(frames)).values() if isinstance(value, np.ndarray)]
            finite = all(bool(np.isfinite(array).all()) for array in arrays)
            require(finite, f"{kind} with a number that is none is taken")
        others = [answer for _, answer in answers if answer not in fitting]  # for requests that waited
        require(all(any(_fits(each, answer) for each in COLLECTIVE) for answer in others), f"came {came}")
        return all(answer.type == "ERROR" for _, answer in answers) and bool(answers)

    def _standings(self) -> tuple[Any, Any]:
        mine, other = (self.server.host(session) for session in (self.known.session, self.bystander))
        return mine and standing_of(mine), other and standing_of(other)

    def _state(self) -> str:
        host = self.server.host(self.known.session)
        return str(host.state) if host is not None else "none"

    def _learn(self) -> None:
        host = self.server.host(self.known.session)
        if host is not None:
            self.known.epoch, self.known.step = host.epoch, host.step


def _fits(kind: str, answer: Any) -> bool:
    """Whether SPEC.md allows this reply to a request of this type."""
    if answer.type == "ERROR":
        return answer.code in allowed_codes(kind)
    return bool(REPLIES.get(kind) == answer.type)


def _sent(frames: Sequence[bytes]) -> tuple[str, int]:
    """Type and number of the request, if they can be read; other values are skipped, not built and interned."""
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


def play(protection: Protection, seed: int, number: int, totals: Totals) -> None:
    random = Random(f"handler fuzz {seed} {number}")
    real = number < 0 and bool(number % 2)  # the numerics load their kernels one by one, when they are first needed
    scene = Scene.set(protection, STATES[number % len(STATES)], random, totals, real=real)
    for message in range(_MESSAGES):
        if scene.server.host(scene.known.session) is None:
            break
        try:
            scene.next()
        except Exception as error:
            error.add_note(f"(scene {number}, message {message})")
            raise
        totals.messages += 1
    # A server and its sessions refer to each other, and the garbage collector runs only after some hundred of them.
    # Surviving objects hold the pages of such a heap: 10 MB in 200 000 messages, with no more of Python's blocks in
    # use.
    del scene
    gc.collect()


def run(seed: int, budget: Budget) -> Result:
    """Play this number of messages, after some that are not counted."""
    with tempfile.TemporaryDirectory() as folder, quiet() as found:
        protection = allow_everybody_listed(Path(folder))
        try:
            return campaign(lambda *given: play(protection, seed, *given), _LEAST_WARM_UP, "requests", budget)
        except Exception as error:
            for inner in list(found)[-1:]:
                error.add_note(f"(in the server: {inner})")
            raise


CHECK = Check(
    "handler-fuzz",
    "{count} requests in any state: a typed reply, nothing changed",
    short=30_000,
    full=10_000_000,
    seconds=20,
    run=run,
)
