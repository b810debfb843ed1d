"""Many sessions at once, live and at rest: sessions do not influence each other, and sessions at rest keep no process
or memory.

Every session has its own mesh, and all holders use the same client id and the same request numbers. Several threads
choose a session at random and use it: each answer must be, bit for bit, that of an undisturbed twin of this session in
this process. Sometimes one session is suspended and another one at rest takes its place.
"""

import os
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
import psutil  # type: ignore[import-untyped]
from mesh_motion_protocol import messages as m

from mesh_motion_server.session.spec import SessionSpec
from mesh_motion_server.session.store import SessionStore
from tests.faults.check import Budget, Check, Result, require
from tests.faults.driver import Driver
from tests.faults.holder import SeededHolder, seeded_mesh, seeded_rows, twin_of
from tests.faults.processes import Usage, usage_of
from tests.faults.server_process import memory_folder
from tests.faults.stand_in_server import StandInServer
from tests.faults.stand_in_service import SessionHost
from tests.faults.wire import Wire

_THREADS = 4
#: Of all sessions one in so many is live, 64 at most; the others rest on disk.
_LIVE_SHARE, _MOST_LIVE = 9, 64
#: Things done with each live session before the row ends.
_DONE_EACH = 25
#: One in so many of them is that another session takes its place.
_SWAPS = 25
#: Seconds until what has ended is gone.
_PATIENCE = 60.0
#: Bytes by which the supervisor may grow: once, and for each session at rest, whose mesh it does not keep.
_ONCE_BYTES, _EACH_BYTES = 4 << 20, 1 << 10
_SETTINGS: dict[str, Any] = {"lease_seconds": 1.0, "idle_seconds": 6.0}


class Member:
    """A session of the fleet: its holder, and its twin while it is live; the twin of a session at rest is made
    again.
    """

    def __init__(self, holder: SeededHolder) -> None:
        self.holder = holder

    @cached_property
    def twin(self) -> Driver:
        return twin_of(self.holder.seed, self.holder.step)


class Fleet:
    """A server with sessions live and at rest.

    ``first_seed``: seeds of the meshes count from here.
    """

    def __init__(self, folder: Path, live: int, resting: int, first_seed: int = 0) -> None:
        self.folder, self.live_count = folder, live
        self._seeds = iter(range(first_seed, first_seed + live + resting))
        self.stored = [self._store(next(self._seeds)) for _ in range(resting)]
        start = time.monotonic()
        self.server = StandInServer(folder, max_sessions=live, **_SETTINGS).start()
        self.start_seconds = time.monotonic() - start
        self.resting = [
            Member(SeededHolder(self.server, seed).known_as(session, token, 1)) for seed, session, token in self.stored
        ]
        self.live: list[Member] = []
        self.places = [threading.Lock() for _ in range(live)]
        self.lock = threading.Lock()
        self.calm = self.usage()

    def _store(self, seed: int) -> tuple[int, str, bytes]:
        """A session of one step that another server has left on disk."""
        session, token = os.urandom(16).hex(), os.urandom(32)
        spec = SessionSpec(session=session, token=token, dimension=2, label=f"session {seed}")
        driver = Driver(SessionHost.create(spec, SessionStore(self.folder / "state")), [seeded_mesh(seed)])
        driver.ask(m.Join, token=token)
        driver.upload()
        driver.all(m.Build)
        driver.all(m.Move, [seeded_rows(seed, 1, 1, len(driver.moving[0]))], step=1)
        driver.all(m.Commit, step=1)
        driver.host.close()
        return seed, session, token

    def open(self) -> None:
        while len(self.live) < self.live_count:
            member = Member(SeededHolder(self.server, next(self._seeds)))
            member.holder.open(label=f"session {member.holder.seed}")
            self.live.append(member)

    def usage(self) -> dict[int, Usage]:
        """Open files and memory of supervisor and gateway, the processes that stay."""
        return {pid: usage_of(pid) for pid in (self.server.process.pid, self.server.gateway())}

    def put_to_rest(self, member: Member, *, politely: bool) -> None:
        """Close a live session, or leave it without a message: it rests when its lease and its idle time have ended."""
        if politely:
            member.holder.leave()
        else:
            member.holder.disconnect()
        vars(member).pop("twin", None)
        with self.lock:
            self.resting.append(member)

    def listed(self) -> dict[str, dict[str, Any]]:
        found: dict[str, dict[str, Any]] = {}
        with Wire(self.server.endpoint) as wire:
            more = True
            while more:
                page = wire.ask(m.List, after=max(found, default=""))
                found |= {entry["session"]: entry for entry in page.sessions}
                more = page.more
        return found

    def close(self) -> None:
        for member in self.live:
            member.holder.disconnect()
        self.server.stop()


# --- what is done with a session ---


def advance(member: Member, random: Random) -> None:
    """Move, sometimes more than once or with repeated requests, and commit; all answers are bitwise those of the
    twin.
    """
    holder, twin = member.holder, member.twin
    for iteration in range(1, random.choice((1, 1, 2)) + 1):
        rows = seeded_rows(holder.seed, holder.step + 1, iteration, holder.moving)
        (expected,) = twin.all(m.Move, [rows], step=holder.step + 1)
        moved = holder.move(repeats=random.choice((0, 0, 1)))
        _require_same(moved.displacement, expected.displacement, f"session {holder.seed}: MOVED")
        if iteration > 1:
            holder.rollback()
            twin.all(m.Rollback, step=holder.step + 1)
    if holder.iteration:
        (expected,) = twin.all(m.Commit, step=holder.step + 1)
        committed = holder.commit(repeats=random.choice((0, 0, 1)))
        require(
            (committed.step, committed.digest) == (expected.step, expected.digest),
            f"session {holder.seed}: COMMITTED step {committed.step} has the digest of another state",
        )


def fetch(member: Member, _random: Random) -> None:
    expected = member.twin.ask(m.Fetch).points
    _require_same(member.holder.request(m.Fetch).points, expected, f"session {member.holder.seed}: FETCHED")


def ask_status(member: Member, _random: Random) -> None:
    holder, report = member.holder, member.holder.request(m.Status)
    shown = (report.step, report.report["label"], report.report["epoch"])
    require(
        shown == (holder.step, f"session {holder.seed}", holder.epoch), f"session {holder.seed}: STATUS says {shown}"
    )


def rejoin(member: Member, _random: Random) -> None:
    member.holder.join()


_DEEDS: tuple[tuple[Callable[[Member, Random], None], int], ...] = (
    (advance, 6),
    (fetch, 2),
    (ask_status, 1),
    (rejoin, 1),
)


def _require_same(got: Any, expected: Any, what: str) -> None:
    require(np.array_equal(got, expected), f"{what} is not that of an undisturbed run")


# --- the whole ---


def swap(fleet: Fleet, slot: int, random: Random) -> None:
    """Replace a live session by one at rest; the live one is closed, or its holder leaves it without a message."""
    old = fleet.live[slot]
    with fleet.lock:
        new = fleet.resting.pop(random.randrange(len(fleet.resting)))
    fleet.put_to_rest(old, politely=random.random() < 0.75)
    new.holder.come_back()
    fleet.live[slot] = new
    fetch(new, random)


def sail(fleet: Fleet, random: Random, budget: Budget) -> Counter[str]:
    """Use randomly chosen sessions in several threads until the budget is spent; return the counts of the uses.

    Raises BrokenPromise of one of the threads.
    """
    done: Counter[str] = Counter()
    over = threading.Event()

    def work(seed: int) -> None:
        own = Random(seed)
        try:
            while not over.is_set() and budget.admits(done.total()):
                slot = own.randrange(len(fleet.live))
                with fleet.places[slot]:
                    name = _do_something(fleet, slot, own)
                with fleet.lock:
                    done[name] += 1
        finally:
            over.set()

    with ThreadPoolExecutor(_THREADS) as pool:
        for future in [pool.submit(work, random.randrange(1 << 30)) for _ in range(_THREADS)]:
            future.result()
    return done


def _do_something(fleet: Fleet, slot: int, random: Random) -> str:
    """Use the session in a slot; return the name of the use."""
    if fleet.resting and random.randrange(_SWAPS) == 0:
        swap(fleet, slot, random)
        return "swap"
    (deed,) = random.choices([deed for deed, _ in _DEEDS], [weight for _, weight in _DEEDS])
    deed(fleet.live[slot], random)
    return deed.__name__


def require_full(fleet: Fleet) -> None:
    asked: dict[str, dict[str, Any]] = {"OPEN": {"dimension": 2}}
    if fleet.resting:
        resting = fleet.resting[0].holder
        asked["RESUME"] = {"session": resting.session, "token": resting.token}
    with Wire(fleet.server.endpoint) as wire:
        for request, fields in asked.items():
            reply = wire.ask(m.MESSAGES[request], **fields)
            code = getattr(reply, "code", reply.type)
            require(code == "RESOURCE_EXHAUSTED.SESSIONS", f"{request} to a server that is full is answered {code}")


def require_own_tokens(control: str, one: Member, other: Member) -> int:
    """Check that a session's token opens no other session, and that its worker knows no other session; return the
    number of tries.
    """
    a, b = one.holder, other.holder
    crossed = {"session": a.session, "token": b.token}
    tries: list[tuple[str, str, dict[str, Any]]] = [("PROBE", control, crossed), ("RESUME", control, crossed)]
    if a.endpoint:
        tries += [("JOIN", a.endpoint, crossed | {"epoch": a.epoch})]
        tries += [("JOIN", a.endpoint, {"session": b.session, "token": b.token, "epoch": b.epoch})]
    for request, endpoint, fields in tries:
        with Wire(endpoint) as wire:
            reply = wire.ask(m.MESSAGES[request], **fields)
            code = getattr(reply, "code", reply.type)
            require(code == "NOT_FOUND", f"{request} of a session with another one's token is answered {code}")
    return len(tries)


def require_listed(fleet: Fleet) -> None:
    """Check that LIST has each session once, with its step and label, and says which sessions have a worker.

    A session whose holder left without a message has a worker until its idle time ends.
    """
    deadline = time.monotonic() + _PATIENCE
    while wrong := _wrongly_listed(fleet):
        require(time.monotonic() < deadline, wrong)
        time.sleep(0.2)


def _wrongly_listed(fleet: Fleet) -> str:
    """The first difference between LIST and the expected sessions; empty if there is none."""
    listed = fleet.listed()
    members = {member.holder.session: (member.holder, "alive") for member in fleet.live}
    members |= {member.holder.session: (member.holder, "none") for member in fleet.resting}
    if listed.keys() != members.keys():
        return f"LIST has {len(listed)} sessions of {len(members)}"
    for session, (holder, worker) in members.items():
        entry = listed[session]
        shown = (entry["label"], entry["step"], entry["worker"])
        wanted = (f"session {holder.seed}", holder.step, worker)
        if shown != wanted:
            return f"LIST says {shown} of a session that is {wanted}"
    return ""


def require_calm(fleet: Fleet) -> int:
    """Check that all workers have ended and files are closed; return the growth of the supervisor in bytes."""
    for member in fleet.live:
        fleet.put_to_rest(member, politely=member.holder.seed % 2 == 0)
    fleet.live.clear()
    deadline = time.monotonic() + _PATIENCE
    while (left := len(fleet.server.workers())) > 1 or _kept_files(fleet):
        kept = f"{left - 1} workers and {_kept_files(fleet)} open files"
        require(time.monotonic() < deadline, f"{kept} are left of sessions at rest")
        time.sleep(0.05)
    supervisor = fleet.server.process.pid
    return usage_of(supervisor).resident_bytes - fleet.calm[supervisor].resident_bytes


def _kept_files(fleet: Fleet) -> int:
    """Open files of supervisor and gateway beyond those at the start."""
    return sum(max(0, usage.files - fleet.calm[pid].files) for pid, usage in fleet.usage().items())


def run(seed: int, budget: Budget) -> Result:
    random = Random(f"many sessions {seed}")
    live = min(_MOST_LIVE, max(2, budget.count // _LIVE_SHARE))
    resting = budget.count - live
    with tempfile.TemporaryDirectory(prefix="mesh-motion-prove-", dir=memory_folder()) as folder:
        fleet = Fleet(Path(folder), live, resting, 1000 * seed)
        try:
            details = _voyage(fleet, random, budget)
        finally:
            fleet.close()
    growth, allowed = details["supervisor_growth_bytes"], _ONCE_BYTES + _EACH_BYTES * resting
    got = f"{live} + {resting}, {sum(details['done'].values())} deeds, 0 cross-talk, supervisor {growth / 1e6:+.1f} MB"
    return Result(got, growth < allowed, details)


def _voyage(fleet: Fleet, random: Random, budget: Budget) -> dict[str, Any]:
    start = time.monotonic()
    require_listed(fleet)
    list_seconds = time.monotonic() - start
    fleet.open()
    require_full(fleet)
    ring = [*fleet.live, *random.sample(fleet.resting, min(5, len(fleet.resting)))]
    tries = sum(require_own_tokens(fleet.server.endpoint, one, other) for one, other in pairwise([*ring, ring[0]]))
    memory = [psutil.Process(pid).memory_full_info().pss for pid in fleet.server.workers()]
    deeds = Budget(_DONE_EACH * len(fleet.live), budget.report)
    done = sail(fleet, random, deeds)
    require_listed(fleet)
    live = len(fleet.live)
    growth = require_calm(fleet)
    require_listed(fleet)
    return {
        "live": live,
        "at_rest": len(fleet.resting) - live,
        "start_seconds": fleet.start_seconds,
        "list_seconds": list_seconds,
        "worker_pss_bytes": max(memory),
        "workers_pss_bytes": sum(memory),
        "tokens_tried": tries,
        "done": dict(done),
        "supervisor_growth_bytes": growth,
    }


CHECK = Check(
    "many-sessions",
    "{count} sessions, a ninth live (≤ 64): no cross-talk, all given back",
    short=112,
    full=1064,
    seconds=45,
    run=run,
)
