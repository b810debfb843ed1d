"""A private server for one client: a subprocess that ends with it."""

from __future__ import annotations

import contextlib
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

from mesh_motion_client.errors import Unavailable

__all__ = ["EmbeddedServer"]

#: The server drains when this inherited file descriptor reads as ended: it never outlives its client.
_LIFELINE = "MESH_MOTION_LIFELINE_FD"


class EmbeddedServer:
    """Starts ``python -m mesh_motion_server serve`` on an ipc endpoint in a private folder.

    Parameters
    ----------
    state : path or None
        Where sessions are stored; None: with the endpoint, and deleted at the end.
    timeout : float
        Seconds to become ready, and to stop.
    options : sequence of str
        Further options of ``mesh-motion serve``.

    Raises
    ------
    Unavailable
        If the server does not become ready; the message has its last words.
    """

    def __init__(self, state: str | os.PathLike[str] | None, timeout: float, options: Sequence[str] = ()) -> None:
        self._timeout = timeout
        self._folder = tempfile.TemporaryDirectory(prefix="mesh-motion-", ignore_cleanup_errors=True)
        folder = Path(self._folder.name)
        self._log = folder / "log"
        self.endpoint = f"ipc://{folder}/control"
        ready = folder / "ready.json"
        arguments = ["--endpoint", self.endpoint, "--ready-file", str(ready)]
        arguments += ["--state", str(state if state is not None else folder / "state")]
        reader, self._lifeline = os.pipe()
        with open(self._log, "wb") as log:
            self.process = subprocess.Popen(
                [sys.executable, "-m", "mesh_motion_server", "serve", *arguments, *options],
                env=os.environ | {_LIFELINE: str(reader)},
                pass_fds=[reader],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=log,
                start_new_session=True,  # Ctrl-C is for the client, which then stops the server in order
            )
        os.close(reader)
        self._await(ready)

    def _await(self, ready: Path) -> None:
        deadline = time.monotonic() + self._timeout
        while not ready.exists():
            if self.process.poll() is not None or time.monotonic() > deadline:
                words = self._last_words()
                self.stop()
                raise Unavailable(
                    f"the embedded server did not become ready: {words}",
                    hint="install the server beside the client (mesh-motion-server[server]), or give an endpoint",
                )
            time.sleep(0.01)
        self.endpoint = json.loads(ready.read_text(encoding="utf-8"))["endpoint"]

    def _last_words(self) -> str:
        lines = self._log.read_text(encoding="utf-8", errors="replace").strip().splitlines()
        if not lines:
            return f"no output within {self._timeout} s"
        try:
            return str(json.loads(lines[-1])["reason"])
        except (ValueError, KeyError, TypeError):
            return lines[-1]

    def stop(self) -> None:
        """Drain and end it; idempotent."""
        if self._lifeline >= 0:
            os.close(self._lifeline)
            self._lifeline = -1
        if self.process.poll() is None:
            self.process.terminate()
        try:
            self.process.wait(self._timeout)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        with contextlib.suppress(OSError):
            self._folder.cleanup()
