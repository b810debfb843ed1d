"""Nonsense for the decoder: golden vectors gone wrong come out as a message or as a typed error, and nothing is kept.

A message that is accepted must be one that can be sent: encoded again it is decoded to the same frames. An error has a
code that SPEC.md lists (never INTERNAL) and fits into its reply.
"""

import ctypes
import gc
import os
import time
from collections import Counter
from contextlib import suppress
from pathlib import Path
from random import Random

from mesh_motion_protocol.codec import decode, encode
from mesh_motion_protocol.errors import ERROR_CODES, ProtocolError

from mesh_motion_server.transport.replies import undecodable
from tests.faults.check import Budget, Check, Result, require
from tests.faults.mutations import golden_frames, mutated

#: What the process may grow by.
_MOST_GROWTH = 5 << 20
#: Messages before the memory is looked at: what is made once is made then, and the allocator has seen the largest.
_WARM_UP = 50_000
#: Bytes of an error's reply, whatever it repeats of the request.
_LARGEST_ERROR = 6000


def outcome_of(frames: list[bytes]) -> str:
    """What comes of frames: a message's type, or an error's code.

    Raises BrokenPromise if it is neither as it should be. Any other exception is the decoder's defect.
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


def memory_in_use() -> int:
    """Bytes of this process that no file backs, after the allocator has given back what is no longer used (glibc)."""
    gc.collect()
    with suppress(OSError, AttributeError):
        ctypes.CDLL(None).malloc_trim(0)
    _, resident, of_files, *_ = Path("/proc/self/statm").read_text().split()
    return (int(resident) - int(of_files)) * os.sysconf("SC_PAGE_SIZE")


def _one(golden: list[list[bytes]], random: Random, number: int) -> str:
    """What comes of the next message."""
    frames = mutated(random.choice(golden), random)
    try:
        return outcome_of(frames)
    except Exception as error:
        error.add_note(f"(message {number}, frames {[frame[:200].hex() for frame in frames]})")
        raise


def run(seed: int, budget: Budget) -> Result:
    """So many messages, after some that are not counted."""
    random, golden = Random(f"fuzz {seed}"), golden_frames()
    for number in range(min(_WARM_UP, budget.count // 4)):
        _one(golden, random, -number)
    outcomes: Counter[str] = Counter()
    before, done, start = memory_in_use(), 0, time.monotonic()
    while done % 1000 or budget.admits(done):
        outcomes[_one(golden, random, done)] += 1
        done += 1
    rate = done / (time.monotonic() - start)
    growth = memory_in_use() - before
    accepted = sum(count for name, count in outcomes.items() if name not in ERROR_CODES)
    details = {
        "messages": done,
        "accepted": accepted,
        "per_second": round(rate),
        "growth_bytes": growth,
        "outcomes": dict(sorted(outcomes.items())),
    }
    got = f"{done} messages, 0 INTERNAL, {growth / 2**20:+.1f} MB, {rate:.0f} a second"
    return Result(got, growth < _MOST_GROWTH and 0 < accepted < done, details)


CHECK = Check(
    "fuzz",
    "{count} messages: decoded or a typed error, memory < +5 MB",
    short=200_000,
    full=10_000_000,
    seconds=30,
    run=run,
)
