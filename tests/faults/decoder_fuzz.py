"""Damaged golden vectors for the decoder: each gives a message or a typed error, and no memory is kept.

An accepted message must be one that can be sent: encoding and decoding it again gives the same frames. An error has a
code that SPEC.md lists (never INTERNAL) and fits into its reply.
"""

import ctypes
import gc
import time
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from itertools import count
from random import Random

import psutil  # type: ignore[import-untyped]
from mesh_motion_protocol.codec import decode, encode
from mesh_motion_protocol.errors import ERROR_CODES, ProtocolError

from mesh_motion_server.transport.replies import undecodable
from tests.faults.check import Budget, Check, Result, require
from tests.faults.mutations import Draft, golden_frames, gone_wrong

#: Bytes by which the memory of the process may grow.
_MOST_GROWTH = 5 << 20
#: Messages before the memory is looked at: what is made once is made then, and the allocator has seen the largest.
_LEAST_WARM_UP = 1000
#: Bytes of an error's reply, whatever it repeats of the request.
_LARGEST_ERROR = 6000


@dataclass
class Totals:
    """Results of messages: types of replies and codes, states of the session, the longest time in seconds."""

    messages: int = 0
    outcomes: Counter[str] = field(default_factory=Counter)
    states: Counter[str] = field(default_factory=Counter)
    slowest: float = 0.0


def campaign(play: Callable[[int, Totals], None], least: int, what: str, budget: Budget) -> Result:
    """Play messages 0, 1, … until the budget is spent, after messages −1, −2, … (at least ``least``) that are not
    counted.
    """
    first, totals = Totals(), Totals()
    for number in count(1):
        if not budget.warms_up(first.messages, least):
            break
        play(-number, first)
    gc.collect()
    gc.freeze()  # modules and kernels, some 300 000 objects, are left out of collections
    try:
        before, start = memory_in_use(), time.monotonic()
        for number in count():
            if not budget.admits(totals.messages):
                break
            play(number, totals)
        rate, growth = totals.messages / (time.monotonic() - start), memory_in_use() - before
    finally:
        gc.unfreeze()
    taken = sum(many for name, many in totals.outcomes.items() if name not in ERROR_CODES)
    details = {"taken": taken, "per_second": round(rate), "growth_bytes": growth} | vars(totals)
    got = f"{totals.messages} {what}, 0 INTERNAL, {growth / 2**20:+.1f} MB, {rate:.0f} a second"
    return Result(got, growth < _MOST_GROWTH and 0 < taken < totals.messages, details)


def memory_in_use() -> int:
    """Memory of this process without file pages, after the allocator has returned unused memory (glibc), bytes."""
    gc.collect()
    with suppress(OSError, AttributeError):
        ctypes.CDLL(None).malloc_trim(0)
    memory = psutil.Process().memory_info()
    return int(memory.rss - memory.shared)


def outcome_of(frames: list[bytes]) -> str:
    """Decode frames: return a message's type, or an error's code.

    Raises BrokenPromise if message or error is not correct. Any other exception is the decoder's defect.
    """
    try:
        message = decode(frames)
    except ProtocolError as error:
        require(error.code in ERROR_CODES and not error.code.startswith("INTERNAL"), f"the code {error.code}")
        size = len(encode(undecodable(error))[0])
        require(size <= _LARGEST_ERROR, f"the answer to an error takes {size} bytes: {error!s:.80}")
        return error.code
    again = [bytes(frame) for frame in encode(message)]
    twice = [bytes(frame) for frame in encode(decode(again))]
    require(again == twice, f"a {message.type} that is read otherwise than it was sent")
    return message.type


def run(seed: int, budget: Budget) -> Result:
    """Play this number of messages, after some that are not counted."""
    golden = golden_frames()

    def play(number: int, totals: Totals) -> None:
        random = Random(f"fuzz {seed} {number}")
        frames = gone_wrong(Draft.of(random.choice(golden)), random)
        frames = frames if random.random() > 1e-3 else []
        try:
            totals.outcomes[outcome_of(frames)] += 1
        except Exception as error:
            error.add_note(f"(message {number}, frames {[frame[:200].hex() for frame in frames]})")
            raise
        totals.messages += 1

    return campaign(play, _LEAST_WARM_UP, "messages", budget)


CHECK = Check(
    "fuzz",
    "{count} messages: decoded or a typed error, memory < +5 MB",
    short=200_000,
    full=10_000_000,
    seconds=40,
    run=run,
)
