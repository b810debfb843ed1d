"""A server in processes of its own that fails where it is told to, and is started again whenever it has ended."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from mesh_motion_server.failpoints import PLAN, VARIABLE
from mesh_motion_server.prove.check import BrokenPromise, require
from mesh_motion_server.prove.served import Served

__all__ = ["PATIENCE", "FailingServer", "wait_until"]

#: Whatever is asked for has come, or was refused, by then; seconds.
PATIENCE = 60.0
#: Starts in a row that a planned fault may spoil, and a few more.
_STARTS = 5
_SETTINGS: dict[str, Any] = {"lease_seconds": 0.4, "drain_seconds": 10.0, "collective_timeout_seconds": 20.0}


def wait_until(condition: Callable[[], object], what: str) -> None:
    """Poll; raises BrokenPromise if it does not come true in time."""
    deadline = time.monotonic() + PATIENCE
    while not condition():
        require(time.monotonic() < deadline, f"{what}: not within {PATIENCE:.0f} s")
        time.sleep(0.01)


class FailingServer:
    """The server, as its operator has it.

    Parameters
    ----------
    folder : Path
        Of its own, and with a short name.

    Attributes
    ----------
    endpoint : str
    state : Path
        The state folder.
    starts : int
        How often it was started.
    """

    def __init__(self, folder: Path) -> None:
        folder.chmod(0o700)
        self.endpoint, self.state, self.starts = f"ipc://{folder}/c", folder / "state", 0
        self._folder, self._points = folder, folder / "points"
        self._points.mkdir(mode=0o700)
        self._served: Served | None = None

    # --- the process -------------------------------------------------------------------------------------------------

    @property
    def runs(self) -> bool:
        """Whether its process has not ended."""
        return self._served is not None and self._served.process.poll() is None

    def ensure(self) -> None:
        """Start it if it does not run, as whatever watches over services does."""
        for attempt in range(_STARTS):
            if self.runs:
                return
            try:
                self._start()
            except BrokenPromise:
                if attempt == _STARTS - 1:
                    raise

    def _start(self) -> None:
        self._let_go()
        self.starts += 1
        environment = {VARIABLE: str(self._points)}
        self._served = Served(self._folder, environment=environment, endpoint=self.endpoint, **_SETTINGS)

    def stop(self) -> None:
        """SIGTERM, and wait for the end of the drain."""
        if self._served is not None:
            self._served.process.terminate()
        self._let_go()

    def end(self) -> None:
        """At once, whatever it does."""
        if self._served is not None:
            self._served.process.kill()
        self._let_go()

    def _let_go(self) -> None:
        if self._served is not None:
            self._served.stop()
            self._served = None

    def last_words(self) -> str:
        """The end of its log."""
        return (self._folder / "log").read_text(encoding="utf-8", errors="replace")[-800:]

    # --- its faults --------------------------------------------------------------------------------------------------

    def plan(self, *faults: str) -> None:
        """Let these happen from now on, as a plan names them; passages are counted anew."""
        (self._points / PLAN).unlink(missing_ok=True)
        for count in self._points.iterdir():
            count.unlink()
        following = self._folder / "plan.next"
        following.write_text(";".join(faults), encoding="ascii")
        following.replace(self._points / PLAN)

    def passed(self, point: str) -> int:
        """How often the point was passed."""
        try:
            return (self._points / point).stat().st_size
        except FileNotFoundError:
            return 0

    def passages(self) -> dict[str, int]:
        """All points that were passed."""
        return {path.name: path.stat().st_size for path in self._points.iterdir() if path.name != PLAN}
