"""A private server for one client: a subprocess that ends with it."""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
import subprocess
import sys
import tempfile
import time
import weakref
from collections.abc import Sequence
from functools import partial
from pathlib import Path

from mesh_motion_client.errors import Unavailable

__all__ = ["EmbeddedServer"]

_PREFIX = "mesh-motion-"
_SOCKET_PATH_BYTES = 107  # of sockaddr_un, without its final zero
#: The server drains when this inherited file descriptor reads as ended: it never outlives its client.
_LIFELINE = "MESH_MOTION_LIFELINE_FD"


def _short_folder() -> str:
    """A folder whose sockets have paths that the kernel takes: TMPDIR, or where that is too long, another one."""
    longest = _SOCKET_PATH_BYTES - len(f"/{_PREFIX}12345678/w4194304.ipc")
    for folder in (tempfile.gettempdir(), os.environ.get("XDG_RUNTIME_DIR", ""), "/tmp"):
        if folder and len(os.fsencode(folder)) <= longest and os.access(folder, os.W_OK | os.X_OK):
            return folder
    return tempfile.gettempdir()


def _hint(words: str) -> str:
    if "not installed" in words or "No module named" in words:
        return "install the server beside the client (mesh-motion-server[server]), or give an endpoint"
    if "ipc path" in words:
        return "set TMPDIR to a folder with a shorter path"
    return "`python -m mesh_motion_server serve` in this environment shows more"


def _above_standard(descriptor: int) -> int:
    """The same pipe at a descriptor above 2: where 0, 1 or 2 is closed, the server's own standard files replace it."""
    if descriptor > 2:
        return descriptor
    higher = fcntl.fcntl(descriptor, fcntl.F_DUPFD_CLOEXEC, 3)
    os.close(descriptor)
    return higher


def _forget(server: weakref.ref[EmbeddedServer]) -> None:
    if (own := server()) is not None:
        own.forget()


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
        self._timeout, self._forgotten = timeout, False
        self._folder = tempfile.TemporaryDirectory(prefix=_PREFIX, dir=_short_folder(), ignore_cleanup_errors=True)
        folder = Path(self._folder.name)
        self._log = folder / "log"
        self.endpoint = f"ipc://{folder}/control"
        ready = folder / "ready.json"
        arguments = ["--endpoint", self.endpoint, "--ready-file", str(ready)]
        arguments += ["--state", str(state if state is not None else folder / "state")]
        reader, self._lifeline = (_above_standard(descriptor) for descriptor in os.pipe())
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
        os.register_at_fork(after_in_child=partial(_forget, weakref.ref(self)))
        self._await(ready)

    def _await(self, ready: Path) -> None:
        deadline = time.monotonic() + self._timeout
        while not ready.exists():
            if self.process.poll() is not None or time.monotonic() > deadline:
                words = self._last_words()
                self.stop()
                raise Unavailable(
                    f"the embedded server did not become ready: {words}",
                    hint=_hint(words),
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

    def forget(self) -> None:
        """Leave the server and its folder to the parent: this is a forked child."""
        if self._lifeline >= 0:
            os.close(self._lifeline)
        self._lifeline = -1
        self._forgotten = True
        self._folder._finalizer.detach()  # type: ignore[attr-defined]  # it would delete the folder at the child's end

    def stop(self) -> None:
        """Drain and end it; idempotent, and without effect in a forked child."""
        if self._forgotten:
            return
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
