"""Random action sequences of a session, played on the server and on a model of it made from SPEC.md: the two never
differ.

A sequence consists of actions (:mod:`.actions`): requests of one to three partitions, correct and wrong ones, repeats,
other users, ends of leases, kills, power cuts, failing disks. Actions are drawn so that the session makes progress,
with a preference for unvisited cells of the state × operation table. A failing sequence is shortened until no action
can be removed, and can be played again: ``replay("partitions=2 level=full …")``.

The module has its own generator: it prefers cells that no earlier sequence has visited. Hypothesis cannot do this,
because its examples depend only on their draws; a hundred sequences visit all cells.
"""

from __future__ import annotations

import tempfile
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from random import Random
from typing import Any

from mesh_motion_server.settings import ServerSettings
from mesh_motion_server.transport.protection import Protection
from tests.faults.actions import ALL, EVENTS, REQUESTS, TWISTS, Action, read_story, story
from tests.faults.check import Budget, Check, Result
from tests.faults.in_process import InProcessServer, allow_everybody_listed, quiet
from tests.faults.played import Played
from tests.faults.ranks import Ranks
from tests.faults.session_table import ADMITTED, OPERATIONS
from tests.faults.stand_in import StandIn

Visited = set[tuple[str, str]]

#: All cells of SPEC.md's table.
CELLS = frozenset((state, operation) for state in ADMITTED for operation in OPERATIONS)
#: ``stored_replies`` of the servers: so few that sequences reach beyond them.
KEPT = 4
#: Of durability. What "relaxed" writes after its replies is waited for after each, unless the disk stalls.
LEVELS = ("full", "replay", "relaxed")
#: Actions of a sequence.
_LENGTH = 60
#: One sequence in so many is played with the numerics themselves.
_REAL_EVERY = 10
#: Requests that bring a session to its next state.
_ONWARD = {
    "": "RESUME", "CLOSED": "RESUME", "NEW": "UPLOAD", "OPENING": "UPLOAD", "READY": "MOVE",
    "TRIAL": "COMMIT COMMIT MOVE ROLLBACK", "SUSPENDED": "JOIN JOIN COMMIT",
    "FROZEN": "CLOSE RESUME COMMIT MOVE", "FAILED": "CLOSE RESUME COMMIT",
}  # fmt: skip
_TWISTED = [(kind, twist) for kind in REQUESTS for twist in TWISTS[kind]]
_SETTINGS = ServerSettings(stored_replies=KEPT, snapshot_steps=3)


def begin(protection: Protection, partitions: int, level: str = "full", *, real: bool = False) -> Played:
    """A new server with a new session of a level of durability; the stand-in unless the numerics are asked for."""
    build_model: Any = None if real else StandIn
    return Played(InProcessServer(protection, build_model, _SETTINGS), Ranks(partitions, level), KEPT)


def replay(text: str) -> None:
    """Play a story, for example one from proof.json.

    Raises BrokenPromise as when it was found.
    """
    with tempfile.TemporaryDirectory() as folder, quiet():
        Life.of(text).play(allow_everybody_listed(Path(folder)))


@dataclass
class Life:
    """A sequence and its parameters: partitions, level of durability, the numerics or the stand-in."""

    partitions: int
    level: str
    real: bool
    actions: list[Action] = field(default_factory=list)

    @classmethod
    def of(cls, text: str) -> Life:
        """The inverse of ``str``."""
        about, words = text.split()[:3], text.split()[3:]
        partitions, level, numerics = (word.partition("=")[2] for word in about)
        return cls(int(partitions), level, numerics == "real", read_story(" ".join(words)))

    def __str__(self) -> str:
        numerics = "real" if self.real else "stand-in"
        return f"partitions={self.partitions} level={self.level} numerics={numerics} {story(self.actions)}"

    def play(self, protection: Protection) -> None:
        played = begin(protection, self.partitions, self.level, real=self.real)
        for action in self.actions:
            played.act(action)
        played.finish()

    def fails(self, protection: Protection) -> bool:
        try:
            self.play(protection)
        except Exception:
            return True
        return False

    def grow(self, protection: Protection, random: Random, visited: Visited) -> int:
        """Draw actions, and play each; return the number of requests and accidents."""
        played = begin(protection, self.partitions, self.level, real=self.real)
        played.visited = played.model.visited = visited
        for _ in range(_LENGTH):
            self.actions.append(next_action(played, random))
            played.act(self.actions[-1])
        played.finish()
        return played.operations

    def shortened(self, protection: Protection, *, tries: int = 400) -> Life:
        """Remove all actions that are not needed for the failure, in ever smaller pieces."""
        life, piece = self, len(self.actions)
        while piece:
            start = 0
            while start < len(life.actions) and tries:
                without = replace(life, actions=[*life.actions[:start], *life.actions[start + piece :]])
                tries -= 1
                if without.fails(protection):
                    life = without
                else:
                    start += piece
            piece //= 2
        return life


def nth_life(seed: int, number: int) -> tuple[Life, Random]:
    """The sequence of this number, not begun, and the source of its actions."""
    random = Random(f"state machine {seed} {number}")
    real = number % _REAL_EVERY == _REAL_EVERY - 1
    return Life(random.choice((1, 1, 2, 2, 3)), random.choice(LEVELS), real=real), random


def next_action(played: Played, random: Random) -> Action:
    """Choose an action that makes progress, or visits a new cell, or any action."""
    model = played.model
    dice, value = random.random(), random.randrange(33)
    if dice < 0.45:
        return _onward(played, random, value)
    if dice < 0.6:
        new = [operation for operation in OPERATIONS if (model.state, operation) not in model.visited]
        if new:
            return _visiting(model.state, random.choice(new), value)
        return _towards(model, random) or _onward(played, random, value)
    if dice < 0.62 and model.level == "relaxed":
        return Action("STALL")
    if dice < 0.64:
        return Action(random.choice(EVENTS), random.randrange(3), "", value)
    kind, twist = random.choice(_TWISTED)
    return Action(kind, random.choice((ALL, 0, 1, 2)), twist, value)


def _onward(played: Played, random: Random, value: int) -> Action:
    model = played.model
    if model.gone:
        return Action("OPEN")
    if model.worker == "alive" and len(model.joined) < played.partitions:
        return Action("JOIN", ALL)
    if played.is_disconnected():
        return Action("JOIN", ALL)
    kind = random.choice(_ONWARD[model.state if model.worker == "alive" else ""].split())
    if model.state == "OPENING":
        kind = "CLOSE" if model.spoilt else "BUILD" if model.complete else "UPLOAD"
    twist = "far" if kind == "MOVE" and random.random() < 0.15 else ""
    return Action(kind, ALL if kind != "RESUME" else 0, twist, value)


def _towards(model: Any, random: Random) -> Action | None:
    """An accident that leads to a state in which not all requests were tested."""
    ways = {"SUSPENDED": Action("LEASE_END"), "CLOSED": Action("STOP")} if model.worker == "alive" else {}
    if model.state == "TRIAL":
        ways |= {"FROZEN": Action("COMMIT", ALL, "disk", random.randrange(4))}
        ways |= {"FAILED": Action("COMMIT", ALL, "defect", random.randrange(4))}
        asked = [number for number, what in enumerate(OPERATIONS) if ("COMMITTING", what) not in model.visited]
        ways |= {"COMMITTING": Action("COMMIT", ALL, "inside", random.choice(asked))} if asked else {}
    wanted = [state for state in ways if any((state, what) not in model.visited for what in OPERATIONS)]
    return ways[random.choice(wanted)] if wanted else None


def _visiting(state: str, operation: str, value: int) -> Action:
    """A request of all partitions: the last one decides."""
    if operation == "RESUME":
        return Action("RESUME", 0, "host" if state in ("CLOSED", "FROZEN", "FAILED") else "", value)
    return Action(operation, 0 if operation in ("LEASE_END", "CLOSE") else ALL, "", value)


def _with_story(life: Life, protection: Protection, error: Exception, found: Sequence[str]) -> Exception:
    """The error of the shortest failing sequence; it names this sequence."""
    short = life.shortened(protection)
    try:
        short.play(protection)
    except Exception as again:
        error = again
    for inner in found[-1:]:
        error.add_note(f"(in the server: {inner})")
    error.add_note(f"(replay: {short})")
    return error


def run(seed: int, budget: Budget) -> Result:
    visited: Visited = set()
    done, operations, kinds = 0, 0, Counter[str]()
    with tempfile.TemporaryDirectory() as folder, quiet() as found:
        protection = allow_everybody_listed(Path(folder))
        while budget.admits(done):
            life, random = nth_life(seed, done)
            try:
                operations += life.grow(protection, random, visited)
            except Exception as error:
                raise _with_story(life, protection, error, list(found)) from None
            kinds.update([f"{life.partitions} partitions", "the numerics" if life.real else "the stand-in", life.level])
            done += 1
    cells = visited & CELLS
    details = {
        "sequences": done,
        "operations": operations,
        "cells": len(cells),
        "cells_of": len(CELLS),
        "not_visited": sorted(map(list, CELLS - visited)),
        "sequences_with": dict(sorted(kinds.items())),
    }
    got = f"{done} sequences, {operations} actions, {len(cells)} of {len(CELLS)} cells, 0 differ"
    return Result(got, cells == CELLS, details)


CHECK = Check(
    "state-machine",
    "{count} lives go as SPEC.md says, every state × operation",
    short=100,
    full=2000,
    seconds=20,
    run=run,
)
