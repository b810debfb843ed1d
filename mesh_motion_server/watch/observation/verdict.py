"""One line on the state of a session, from the end of its history: the same in the list, the page and the terminal."""

import math
import time
from collections import deque
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from statistics import median
from typing import Any, Literal

from mesh_motion_server.watch.observation.fold import number_of
from mesh_motion_server.watch.observation.follow import EventTail

Tone = Literal["good", "warn", "bad", ""]

#: Number of commits that are kept, for the usual pause and for the line of minima in a list.
_KEPT = 32
#: A session is stalled after this many usual pauses between commits, but not before this many seconds.
_PAUSES, _PATIENCE = 10.0, 30.0
#: Bytes at the end of a history that are read first.
_TAIL_BYTES = 512 << 10

_ENDS_A_TRIAL = ("committed", "rolled_back", "resumed", "suspended", "closed", "failed")
_BEGINS = ("built", "resumed", "joined")
#: In these states no action of the client is expected.
_RESTS = ("suspended", "closed", "failed", "frozen")
#: With these verdicts steps still arrive at the usual pause.
_GOES_ON = ("running", "degrading")


@dataclass(frozen=True)
class _Commit:
    at: float
    step: int
    minimum: float  # NaN if not recorded


class Recent:
    """The end of one session's history, with bounded size.

    Attributes
    ----------
    events : int
        Number of events added.
    changed_at : float
        Unix time of the latest event; 0 if there is none.
    iteration : int
        Iteration of the current trial; 0 if there is none.
    commits : deque of (at, step, minimum)
        The latest commits, oldest first.
    final_step : int
        The step that the run ends with, as in the last commit; 0: unknown.
    """

    def __init__(self) -> None:
        self.events, self.iteration, self.final_step = 0, 0, 0
        self.changed_at = self.waits_since = 0.0  # for a commit
        self.threshold: float | None = None
        self.commits: deque[_Commit] = deque(maxlen=_KEPT)
        self.refusals, self.refused_at, self.refusal = 0, 0.0, ""
        self.below: _Commit | None = None
        self.rests: dict[str, Any] = {}

    @property
    def pause(self) -> float:
        """The usual seconds from one commit to the next, the median; infinite with fewer than three commits."""
        times = [commit.at for commit in self.commits]
        return median(after - before for before, after in pairwise(times)) if len(times) > 2 else math.inf

    @property
    def hourly(self) -> float | None:
        """Steps per hour at the usual pause; None if unknown."""
        return 3600.0 / self.pause if 0.0 < self.pause < math.inf else None

    @property
    def ends_at(self) -> float:
        """Unix time when the run ends at the usual pause; 0 if unknown, or if the last step is committed."""
        left = self.final_step - self.commits[-1].step if self.commits else 0
        return self.commits[-1].at + left * self.pause if left > 0 and self.pause < math.inf else 0.0

    def take(self, event: Mapping[str, Any]) -> None:
        """Add the next event; skip incomplete events, which another version may have written."""
        with suppress(KeyError, TypeError, ValueError, AttributeError):
            self._take(event)

    def _take(self, event: Mapping[str, Any]) -> None:
        kind, at = event["event"], float(event["at"])
        self.events += 1
        self.changed_at = at
        if kind in _ENDS_A_TRIAL:
            self.iteration = 0
        if kind in _BEGINS or kind == "committed":
            self.waits_since = at  # not the largest time: a clock may be set back
        if kind != "refused":
            self.rests = dict(event) if kind in _RESTS else {}
        if kind in ("moved", "committed", "resumed"):
            self.refusals = 0
        if kind == "built":
            self.threshold = event["settings"].get("quality_threshold")
        elif kind == "moved":
            self.iteration, self.threshold = event["iteration"], event["quality"]["threshold"]
        elif kind == "resumed":
            while self.commits and self.commits[-1].step > event["step"]:
                self.commits.pop()  # these steps were lost in a crash
        elif kind == "refused":
            fraction = event.get("details", {}).get("fraction")
            passes = f"; {math.floor(100.0 * fraction)} % of the motion would pass" if fraction else ""
            request = "" if event["request"] == "MOVE" else f"{event['request']} of "
            self.refusal = f"{request}step {event['step']}: {event['message']}{passes}"
            self.refused_at = self.refused_at if self.refusals else at
            self.refusals += 1 + int(event.get("untold", 0))
        elif kind == "committed":
            self.final_step = event.get("final_step", 0)
            self._commit(_Commit(at, event["step"], number_of(event["quality"].get("metric", {}).get("min"))))

    def _commit(self, commit: _Commit) -> None:
        self.commits.append(commit)
        is_below = self.threshold is not None and commit.minimum < self.threshold
        self.below = (self.below or commit) if is_below else None


class Latest:
    """The end of the history in one session's folder, read while it grows."""

    def __init__(self, folder: Path) -> None:
        self._tail, self._recent = EventTail(folder, last_bytes=_TAIL_BYTES), Recent()

    def read(self) -> Recent:
        """Read new events; return the current summary."""
        while events := self._tail.read():
            for event in events:
                self._recent.take(event)
        return self._recent


@dataclass(frozen=True)
class Verdict:
    """The state of a session in one line."""

    #: running, degrading, refused, stalled, suspended, frozen, failed, closed, at rest, worker fell, server gone or no
    #: mesh yet.
    kind: str
    tone: Tone  # good, warn, bad, or empty if nothing runs
    why: str  # the rest of the line; does not change while nothing happens
    since: float  # unix time when this state began; for a running session, its last commit. 0: unknown
    #: Unix time when a running session will end, from the final step that its client sent. 0: unknown.
    ends_at: float = 0.0

    def line(self, now: float) -> str:
        """The complete line at this time."""
        begin = self.kind
        if self.since:
            passed = duration(now - self.since)
            begin += f", last commit {passed} ago" if self.kind == "running" else f" for {passed}"
        line = f"{begin}: {self.why}" if self.why else begin
        return f"{line}, ends about {_clock(self.ends_at, now)}" if self.ends_at else line


def verdict(recent: Recent, now: float, *, worker: str = "alive") -> Verdict:
    """The verdict on a session at a time.

    Parameters
    ----------
    now : float
        Unix time.
    worker : str
        alive, dead, or none (no process holds the session).
    """
    found = (
        _fell(recent, worker)
        or _refused(recent)
        or _left(recent, worker)
        or _stalled(recent, now)
        or _degrading(recent)
        or Verdict("running", "good", _stands(recent), recent.commits[-1].at if recent.commits else 0.0)
    )
    return replace(found, ends_at=recent.ends_at) if found.kind in _GOES_ON else found


def lost_files(state: str) -> Verdict:
    """The verdict for a session at rest whose files do not verify (FAILED), or cannot be read."""
    what = "cannot be read" if state == "UNREADABLE" else "do not verify"
    return Verdict("failed", "bad", f"its files {what}: mesh-motion inspect says which", 0.0)


def server_gone(since: float) -> Verdict:
    """The verdict for sessions of a server that has not answered since a Unix time."""
    return Verdict("server gone", "bad", "this is the last known state", since)


def _stands(recent: Recent) -> str:
    """Return text with step, minimum and steps per hour."""
    if not recent.commits:
        return f"trial {recent.iteration} of step 1" if recent.iteration else "no step yet"
    latest = recent.commits[-1]
    words = [f"step {latest.step}" + (f" of {recent.final_step}" if recent.final_step >= latest.step else "")]
    if not math.isnan(latest.minimum):
        words.append(f"minimum {latest.minimum:.3f}")
    if recent.hourly is not None:
        words.append(f"{recent.hourly:,.0f} steps an hour".replace(",", "\u202f"))
    return ", ".join(words)


def _fell(recent: Recent, worker: str) -> Verdict | None:
    """The verdict if the worker or the disk failed, or the session was closed."""
    end = recent.rests.get("event", "")
    if end == "closed":
        return Verdict("closed", "", _stands(recent), recent.changed_at)
    if worker == "dead" or end in ("failed", "frozen"):
        words = str(recent.rests.get("message", "")) or _stands(recent)
        return Verdict(end or "worker fell", "bad", words, recent.changed_at)
    return None


def _refused(recent: Recent) -> Verdict | None:
    """The verdict if Moves were refused: how often in a row, and why."""
    if not recent.refusals:
        return None
    often = f"{recent.refusals} times in a row, " if recent.refusals > 1 else ""
    return Verdict("refused", "bad", often + recent.refusal, recent.refused_at)


def _left(recent: Recent, worker: str) -> Verdict | None:
    """The verdict if no client uses the session."""
    if recent.rests.get("event") == "suspended":
        return Verdict("suspended", "warn", f"its client is gone; {_stands(recent)}", recent.changed_at)
    if worker == "none":
        return Verdict("at rest", "", _stands(recent), recent.changed_at)
    return None if recent.events else Verdict("no mesh yet", "", "", 0.0)


def _stalled(recent: Recent, now: float) -> Verdict | None:
    """The verdict if there was no commit for many usual pauses."""
    since = recent.waits_since
    if now - since <= max(_PATIENCE, _PAUSES * recent.pause):
        return None
    why = f"no commit after step {recent.commits[-1].step}, usually one every {duration(recent.pause)}"
    return Verdict("stalled", "bad", why + (f"; trial {recent.iteration} is open" if recent.iteration else ""), since)


def _degrading(recent: Recent) -> Verdict | None:
    """The verdict if the minimum is below the threshold."""
    if recent.below is None:
        return None
    latest = recent.commits[-1]
    why = f"minimum {latest.minimum:.3f} is below the threshold {recent.threshold:g} since step {recent.below.step}"
    return Verdict("degrading", "warn", why, recent.below.at)


def duration(seconds: float) -> str:
    """Return a duration as readable text."""
    if seconds < 1.0:
        return f"{1e3 * max(0.0, seconds):.0f} ms"
    if seconds < 10.0:
        return f"{seconds:.2g} s"
    units = ((120, 1, "s"), (7200, 60, "min"), (172800, 3600, "h"), (math.inf, 86400, "days"))
    size, unit = next((size, unit) for until, size, unit in units if seconds < until)
    return f"{seconds / size:.0f} {unit}"


def _clock(at: float, now: float) -> str:
    """The time of the day here, with the date if that is not today."""
    when, today = time.localtime(at), time.localtime(now)
    return time.strftime("%H:%M" if when[:3] == today[:3] else "%Y-%m-%d %H:%M", when)
