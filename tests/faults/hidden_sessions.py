"""Whether a stranger can detect that a session exists: by the text, the size or the time of NOT_FOUND."""

import os
from collections.abc import Mapping, Sequence
from random import Random

import numpy as np
from mesh_motion_protocol.messages import Probe, Resume
from scipy.stats import mannwhitneyu

from tests.faults.check import require
from tests.faults.wire import Wire

#: docs/security.md promises one delay of 50 ms; clocks of two processes and a rounding apart.
_DELAY_SECONDS = 0.049
#: A difference in the medians below this is not looked for: schedulers make as much.
_UNSEEN_SECONDS = 1e-4
#: Standard deviations of the rank sum that chance does not reach in a hundred thousand proofs.
_SIGMAS = 5.0

#: A session's id and a token that somebody asks with.
Asked = tuple[str, bytes]


def no_session() -> Asked:
    return os.urandom(16).hex(), os.urandom(32)


def require_alike(control: Wire, existing: Mapping[str, Asked]) -> int:
    """Send requests for sessions that exist and for one that does not: the answers must be equal except for the id.

    ``control``: connection of a user who owns none of them. Returns answers compared.
    """
    compared = 0
    for kind in (Probe, Resume):
        unknown = _answer(control, kind, no_session())
        for what, (session, token) in existing.items():
            for tried in (token, os.urandom(32)):
                answer = _answer(control, kind, (session, tried))
                require(
                    answer == unknown,
                    f"{kind.type} of another's session, which is {what}, is answered {answer}, of none {unknown}",
                )
                compared += 1
    return compared


def _answer(control: Wire, kind: type[Probe] | type[Resume], asked: Asked) -> tuple[object, ...]:
    session, token = asked
    reply = control.ask(kind, session=session, token=token)
    if reply.type != "ERROR":
        return (reply.type,)
    parts = (reply.code, reply.message, reply.hint, reply.retryable, reply.state, sorted(reply.details.items()))
    words = tuple(str(part).replace(session, "ID") for part in parts)
    return (*words, [len(frame) for frame in control.frames])


def times(control: Wire, existing: Mapping[str, Asked], random: Random, count: int) -> dict[str, list[float]]:
    """Seconds until NOT_FOUND, this number of times for each existing session and for a missing one, in random
    order.
    """
    order = [*existing, "none"] * count
    random.shuffle(order)
    found: dict[str, list[float]] = {what: [] for what in (*existing, "none")}
    for what in order:
        session, token = no_session() if what == "none" else existing[what]
        control.ask(random.choice((Probe, Resume)), session=session, token=token)
        found[what].append(control.seconds)
    return found


def time_differences(found: Mapping[str, Sequence[float]]) -> dict[str, tuple[float, float]]:
    """For each existing session: difference of its median from that of the missing session, seconds, and deviation of
    the rank sum.

    The deviation is that of the Mann–Whitney statistic from its mean for equal distributions, in standard deviations.
    The requests came in random order, so a busy machine disturbs all groups alike.
    """
    none, differences = found["none"], {}
    for what, seconds in found.items():
        if what == "none":
            continue
        n, m = len(seconds), len(none)
        deviation = (mannwhitneyu(seconds, none).statistic - n * m / 2) / np.sqrt(n * m * (n + m + 1) / 12)
        differences[what] = (float(np.median(seconds) - np.median(none)), float(deviation))
    return differences


def require_same_time(found: Mapping[str, Sequence[float]]) -> dict[str, float]:
    """Raise unless NOT_FOUND comes after its delay, at the same time for sessions that exist.

    Returns ``least`` seconds, and the difference of each group's median.
    """
    least = min(min(seconds) for seconds in found.values())
    require(least >= _DELAY_SECONDS, f"NOT_FOUND came after {1000 * least:.1f} ms; it is to wait for 50 ms")
    differences = {"least": least}
    for what, (difference, deviation) in time_differences(found).items():
        require(
            abs(difference) < _UNSEEN_SECONDS or abs(deviation) < _SIGMAS,
            f"NOT_FOUND for a session that is {what} comes {1e6 * difference:+.0f} µs from that for none "
            f"({deviation:+.1f} σ in {len(found[what])} answers)",
        )
        differences[what] = difference
    return differences
