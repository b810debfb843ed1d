"""A server in separate processes that fails at planned points, and is started again whenever it has ended."""

import signal
from pathlib import Path
from typing import Any

from mesh_motion_server.failpoints import VARIABLE
from tests.faults.check import BrokenPromise
from tests.faults.failpoint_plan import PLAN
from tests.faults.stand_in_server import StandInServer

#: Starts in a row that a planned fault may spoil, and a few more.
_STARTS = 5
_SETTINGS: dict[str, Any] = {"lease_seconds": 0.4, "drain_seconds": 10.0, "collective_timeout_seconds": 20.0}


class FailingServer(StandInServer):
    """The server with the tools of its operator.

    ``folder``: a folder for this server only, with a short name. ``starts``: number of starts.
    """

    def __init__(self, folder: Path) -> None:
        folder.chmod(0o700)
        self.starts, self._points = 0, folder / "points"
        self._points.mkdir(mode=0o700)
        super().__init__(folder, environment={VARIABLE: str(self._points)}, endpoint=f"ipc://{folder}/c", **_SETTINGS)

    # --- the process -------------------------------------------------------------------------------------------------

    def launch(self) -> None:
        """See :class:`.server_process.ServerProcess`."""
        self.starts += 1
        super().launch()

    def ensure(self) -> None:
        """Start the server if it does not run, like a service manager."""
        for attempt in range(_STARTS):
            if self.runs:
                return
            try:
                self.start()
            except BrokenPromise:
                if attempt == _STARTS - 1:
                    raise

    def end(self) -> None:
        self.stop(signal.SIGKILL)

    # --- its faults --------------------------------------------------------------------------------------------------

    def plan(self, *faults: str) -> None:
        """Plan these faults from now on; the count of passages starts again."""
        (self._points / PLAN).unlink(missing_ok=True)
        for count in self._points.iterdir():
            count.unlink()
        following = self.folder / "plan.next"
        following.write_text(";".join(faults), encoding="ascii")
        following.replace(self._points / PLAN)

    def passed(self, point: str) -> int:
        try:
            return (self._points / point).stat().st_size
        except FileNotFoundError:
            return 0

    def passages(self) -> dict[str, int]:
        return {path.name: path.stat().st_size for path in self._points.iterdir() if path.name != PLAN}
