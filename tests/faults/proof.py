"""What a run of rows shows: a line each as it finishes, and everything that was measured in proof.json."""

import faulthandler
import json
import os
import platform
import signal
import time
import traceback
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError
from importlib.metadata import version as installed
from pathlib import Path
from typing import Any

import zmq
from mesh_motion_protocol import PROTOCOL_VERSION

from mesh_motion_server import __version__
from tests.faults.check import Budget, Check, Result

_PACKAGES = ("numpy", "scipy", "msgpack", "pyzmq")
_ROW = "{check:<15} {target:<63} {got:<63} {seed:>6} {seconds:>8} {verdict}"

#: The second try to end a row that hangs comes so much later, seconds.
_AGAIN_SECONDS = 60.0

#: The first line of the table.
HEADING = _ROW.format(check="check", target="target", got="got", seed="seed", seconds="seconds", verdict="").rstrip()


@dataclass(frozen=True)
class Plan:
    """How much is done.

    ``scale``: "short" or "full": each check's own counts; ``minutes`` (float or None): if given, the time for all
    checks, instead of counts.
    """

    scale: str = "short"
    seed: int = 1
    minutes: float | None = None

    def seconds(self, check: Check, checks: Sequence[Check]) -> float | None:
        """The check's share of the time."""
        if self.minutes is None:
            return None
        return 60 * self.minutes * check.seconds / sum(each.seconds for each in checks)


@dataclass(frozen=True)
class Outcome:
    """A check's line, and what proof.json contains of it.

    ``seconds``: wall time; ``traceback``: of the exception that ended the check, if one did.
    """

    check: str
    target: str
    got: str
    seed: int
    seconds: float
    passed: bool
    details: dict[str, Any]
    traceback: str = ""


class Proof:
    """The rows of one run: each has its line as it ends, and proof.json is written again.

    ``checks``: all that will be run; ``out``: receives proof.json; made if missing; ``report``: takes each line;
    ``progress``: takes what is being done, often.
    """

    def __init__(
        self,
        plan: Plan,
        checks: Sequence[Check],
        out: Path,
        *,
        report: Callable[[str], None],
        progress: Callable[[str], None] = lambda _: None,
    ) -> None:
        self._plan, self._checks, self._out, self._report, self._progress = plan, checks, out, report, progress
        self._outcomes: list[Outcome] = []
        self._about = {**asdict(plan), "started": _now(), "versions": versions(), "machine": machine()}
        out.mkdir(parents=True, exist_ok=True)
        report(HEADING)

    def run(self, check: Check) -> Outcome:
        """Run one of the rows; whatever it raises is its failure, and the next one can run."""
        outcome = _outcome(check, self._plan, self._plan.seconds(check, self._checks), self._progress)
        self._outcomes.append(outcome)
        self._report(line_of(outcome))
        finished = len(self._outcomes) == len(self._checks)
        _write(self._out / "proof.json", self._about, self._outcomes, finished=finished)
        return outcome


def line_of(outcome: Outcome) -> str:
    """One line of the table."""
    return _ROW.format(
        check=outcome.check,
        target=outcome.target,
        got=outcome.got,
        seed=outcome.seed,
        seconds=f"{outcome.seconds:.1f}",
        verdict="PASS" if outcome.passed else "FAIL",
    )


def _outcome(check: Check, plan: Plan, seconds: float | None, progress: Callable[[str], None]) -> Outcome:
    """Run one check."""
    count = check.count(plan.scale)
    target = check.target_of(count if seconds is None else None)
    budget = Budget(count, seconds, lambda done: progress(f"{check.name}: {done}" + (f" of {count}" * (not seconds))))
    start = time.monotonic()
    trace = ""
    try:
        with _limited(check.limit(count, seconds)):
            result = check.run(plan.seed, budget)
    except (Exception, _Hangs) as error:
        trace = traceback.format_exc()
        result = Result(_one_line(error), False, {})
    taken = time.monotonic() - start
    return Outcome(check.name, target, result.got, plan.seed, taken, result.passed, result.details, trace)


class _Hangs(BaseException):
    """A row is over its limit; nothing in a row that takes errors takes this one."""


@contextmanager
def _limited(seconds: float) -> Iterator[None]:
    """Raise :class:`_Hangs` in whatever waits after this time, and again each minute if the end of the row waits too.

    A loop that looks for no signal ends with the process, which writes where its threads are.
    """

    def give_up(*_: object) -> None:
        raise _Hangs(f"not done within {seconds:g} s")

    handler = signal.signal(signal.SIGALRM, give_up)
    timer = signal.setitimer(signal.ITIMER_REAL, seconds, _AGAIN_SECONDS)
    faulthandler.dump_traceback_later(seconds + 10 * _AGAIN_SECONDS, exit=True, file=2)
    try:
        yield
    finally:
        faulthandler.cancel_dump_traceback_later()
        signal.setitimer(signal.ITIMER_REAL, *timer)
        signal.signal(signal.SIGALRM, handler)


def _one_line(error: BaseException) -> str:
    """Type, message and notes of an exception."""
    words = " ".join([f"{type(error).__name__.lstrip('_')}: {error}", *getattr(error, "__notes__", ())])
    return " ".join(words.split())[:400]


def _write(path: Path, about: dict[str, Any], outcomes: Sequence[Outcome], *, finished: bool) -> None:
    """proof.json as of now, replaced whole."""
    proof = about | {
        "finished": _now() if finished else None,
        "passed": finished and all(outcome.passed for outcome in outcomes),
        "checks": [asdict(replace(outcome, seconds=round(outcome.seconds, 3))) for outcome in outcomes],
    }
    part = path.with_suffix(".part")
    part.write_text(json.dumps(proof, indent=2, ensure_ascii=False) + "\n", encoding="utf-8")
    part.replace(path)


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="seconds")


def versions() -> dict[str, str]:
    """Of the program, its protocol, and what it stands on."""
    found = {
        "mesh-motion-server": __version__,
        "protocol": ".".join(map(str, PROTOCOL_VERSION)),
        "python": platform.python_version(),
        "libzmq": zmq.zmq_version(),
    }
    for name in _PACKAGES:
        try:
            found[name] = installed(name)
        except PackageNotFoundError:
            found[name] = "not installed"
    return found


def machine() -> dict[str, Any]:
    """What the figures were measured on."""
    return {
        "system": platform.platform(),
        "processor": _processor(),
        "cores": len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count(),
        "memory_bytes": os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"),
    }


def _processor() -> str:
    """Its model where Linux shows it, else its architecture."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.machine()
