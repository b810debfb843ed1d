"""Results of a run of rows: a line for each finished row, and all measured figures in proof.json."""

import faulthandler
import json
import os
import platform
import signal
import time
import traceback
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

import zmq
from mesh_motion_protocol import PROTOCOL_VERSION

from mesh_motion_server.session.replay import maker
from tests.faults.check import Budget, Check, Result

_ROW = "{check:<15} {target:<63} {got:<63} {seed:>6} {seconds:>8} {verdict}"
#: The first line of the table.
HEADING = _ROW.format(check="check", target="target", got="got", seed="seed", seconds="seconds", verdict="").rstrip()
#: The second try to end a row that hangs comes so much later, seconds.
_AGAIN_SECONDS = 60.0


@dataclass(frozen=True)
class Plan:
    """How much is done.

    ``scale``: "short" or "full", the counts of each check.
    """

    scale: str = "short"
    seed: int = 1


class Proof:
    """The rows of one run: each finished row prints its line and rewrites proof.json.

    ``checks``: all checks of the run; ``out``: folder for proof.json; made if missing; ``report``: called with each
    line; ``progress``: called often with the current work.
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
        self._outcomes: list[dict[str, Any]] = []
        self._about = {**asdict(plan), "started": _now(), "versions": versions(), "machine": machine()}
        out.mkdir(parents=True, exist_ok=True)
        report(HEADING)

    def run(self, check: Check) -> dict[str, Any]:
        """Run one of the rows; any exception is its failure, with a traceback, and the next row can run."""
        count = check.count(self._plan.scale)
        budget = Budget(count, lambda done: self._progress(f"{check.name}: {done} of {count}"))
        start, trace = time.monotonic(), ""
        try:
            with _limited(check.limit(count)):
                result = check.run(self._plan.seed, budget)
        except (Exception, _Hangs) as error:
            trace, result = traceback.format_exc(), Result(_one_line(error), False, {})
        taken = time.monotonic() - start
        outcome = {"check": check.name, "target": check.target_of(count), "seed": self._plan.seed}
        outcome |= {"seconds": round(taken, 3)} | vars(result) | {"traceback": trace}
        self._outcomes.append(outcome)
        shown = outcome | {"seconds": f"{taken:.1f}", "verdict": "PASS" if result.passed else "FAIL"}
        self._report(_ROW.format(**shown))
        self._write()
        return outcome

    def _write(self) -> None:
        finished = len(self._outcomes) == len(self._checks)
        proof = self._about | {
            "finished": _now() if finished else None,
            "passed": finished and all(outcome["passed"] for outcome in self._outcomes),
            "checks": self._outcomes,
        }
        part = self._out / "proof.json.part"
        part.write_text(json.dumps(proof, indent=2, ensure_ascii=False) + "\n", encoding="utf-8")
        part.replace(self._out / "proof.json")


class _Hangs(BaseException):
    """A row has exceeded its time limit; no error handler in a row catches this exception."""


@contextmanager
def _limited(seconds: float) -> Iterator[None]:
    """Raise :class:`_Hangs` in any waiting call after this time, and again each minute if the end of the row waits too.

    A loop without signal checks ends with the process, which writes the places of its threads.
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
    words = " ".join([f"{type(error).__name__.lstrip('_')}: {error}", *getattr(error, "__notes__", ())])
    return " ".join(words.split())[:400]


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="seconds")


def versions() -> dict[str, str]:
    """Versions of the program, its protocol, and its libraries."""
    found = {name: version(name) for name in ("msgpack", "pyzmq")}
    found |= {"python": platform.python_version(), "libzmq": zmq.zmq_version()}
    return found | {"protocol": ".".join(map(str, PROTOCOL_VERSION))}


def machine() -> dict[str, Any]:
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    return {"system": platform.platform(), "computes": maker(), "cores": os.cpu_count(), "memory_bytes": memory}
