"""A whole server, in processes of its own, whose workers compute with the stand-in: quick to start, kill and ask.

``python -m mesh_motion_server.prove.stand_in_server SETTINGS_JSON READY_FILE SERVICE`` runs it; :class:`StandInServer`
starts that and knows its processes. Everything but the numerics is what ``mesh-motion serve`` runs.
"""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

from mesh_motion_server.prove.check import require
from mesh_motion_server.prove.processes import descendants
from mesh_motion_server.settings import ServerSettings
from mesh_motion_server.transport.hosting import Hosting
from mesh_motion_server.transport.serve import LIFELINE, serve

__all__ = ["SERVICE", "StandInServer"]

#: Module with the ``SessionHost`` and ``SessionStore`` that workers load.
SERVICE = "mesh_motion_server.prove.stand_in_service"
#: Seconds to become ready, and to stop.
_PATIENCE = 60.0


class StandInServer:
    """A server that may be killed and started again on the same endpoint, with the same sessions.

    Parameters
    ----------
    folder : Path
        Receives the sessions and the log.
    service : str
        Module that workers load.
    settings
        Of :class:`.settings.ServerSettings`, plain values; by default one thread and a free port of 127.0.0.1.

    Attributes
    ----------
    endpoint : str
        Known after the first :meth:`start`.
    """

    def __init__(self, folder: Path, *, service: str = SERVICE, **settings: Any) -> None:
        self.folder, self._service = folder, service
        self._settings = {
            "endpoint": "tcp://127.0.0.1:0",
            "threads": 1,
            "state_folder": str(folder / "state"),
        } | settings
        self.endpoint = ""
        self._process: subprocess.Popen[bytes] | None = None
        self._lifeline = -1

    @property
    def log_path(self) -> Path:
        """The logs of all its lives, JSON lines."""
        return self.folder / "log"

    @property
    def pid(self) -> int:
        """Process id of the supervisor."""
        require(self._process is not None, "the server was not started")
        return self._process.pid  # type: ignore[union-attr]

    def start(self) -> StandInServer:
        """Start and wait until clients may connect."""
        self.folder.mkdir(parents=True, exist_ok=True)
        ready = self.folder / "ready.json"
        ready.unlink(missing_ok=True)
        lifeline, self._lifeline = os.pipe()  # the server ends with this process
        command = [sys.executable, "-m", __name__, json.dumps(self._settings), str(ready), self._service]
        with self.log_path.open("ab") as log:
            self._process = subprocess.Popen(
                command,
                env=os.environ | {LIFELINE: str(lifeline)},
                pass_fds=[lifeline],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=log,
            )
        os.close(lifeline)
        deadline = time.monotonic() + _PATIENCE
        while not ready.exists():
            require(self._process.poll() is None and time.monotonic() < deadline, f"no server started: {self._words()}")
            time.sleep(0.01)
        self.endpoint = self._settings["endpoint"] = json.loads(ready.read_text(encoding="utf-8"))["endpoint"]
        return self

    def _words(self) -> str:
        """The end of its log."""
        return self.log_path.read_text(encoding="utf-8", errors="replace")[-400:]

    def events(self, *names: str) -> list[dict[str, Any]]:
        """What the log says of these events."""
        lines = self.log_path.read_text(encoding="utf-8", errors="replace").splitlines()
        events = [json.loads(line) for line in lines if line.startswith("{") and line.endswith("}")]
        return [event for event in events if event.get("event") in names]

    def worker_of(self, session: str) -> int:
        """Process id of a session's newest worker."""
        at_work = [event for event in self.events("open", "resume", "reclaim") if event.get("session") == session]
        return int(at_work[-1]["worker"])

    def kill(self) -> None:
        """SIGKILL to the supervisor; its children end with it."""
        process = self._process
        if process is None:
            return
        children = descendants(process.pid)
        process.kill()
        process.wait()
        self._let_go()
        deadline = time.monotonic() + _PATIENCE
        while any(Path(f"/proc/{child}/cwd").exists() for child in children - {process.pid}):
            require(time.monotonic() < deadline, "the children of a killed server live on")
            time.sleep(0.01)

    def stop(self) -> None:
        """Drain and end it; idempotent."""
        self._let_go()
        process = self._process
        if process is None or process.poll() is not None:
            return
        process.send_signal(signal.SIGTERM)
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(_PATIENCE)
        if process.poll() is None:
            self.kill()

    def _let_go(self) -> None:
        if self._lifeline >= 0:
            os.close(self._lifeline)
            self._lifeline = -1

    def __enter__(self) -> StandInServer:
        return self.start()

    def __exit__(self, *_: object) -> None:
        self.stop()


def main(arguments: list[str]) -> int:
    """Serve."""
    settings, ready, service = arguments
    hosting = Hosting(service, service, service)
    return serve(ServerSettings.model_validate_json(settings), ready_file=Path(ready), level="info", hosting=hosting)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
