"""A private server for one client: a subprocess that ends with the client."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
import weakref
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any, BinaryIO

from mesh_motion_protocol.errors import Unavailable
from mesh_motion_protocol.ipc_paths import PREFIX, folder_for_sockets
from mesh_motion_protocol.lacks import way_out_of

__all__ = ["EmbeddedServer"]

#: The server drains when this inherited file descriptor reaches its end: the server never outlives its client.
_LIFELINE = "MESH_MOTION_LIFELINE_FD"
#: A JSON list of folders that the server removes at its end, because a killed client cannot remove them.
_PRIVATE_FOLDERS = "MESH_MOTION_PRIVATE_FOLDERS"
#: Longest name of a worker's socket.
_WORKER_SOCKET = "w4194304.ipc"
#: Servers that this process started: a forked child is not their client.
_RUNNING: weakref.WeakSet[EmbeddedServer] = weakref.WeakSet()


class EmbeddedServer:
    """Starts ``python -m mesh_motion_server serve`` on an ipc endpoint in a private folder.

    Parameters
    ----------
    state : path or None
        Where sessions are stored; None: in the endpoint's folder, which is deleted at the end.
    timeout : float
        Seconds for the start, and for the stop.
    options : sequence of str
        Further options of ``mesh-motion serve``.

    Raises
    ------
    Unavailable
        If the server cannot be started, or does not become ready: the message has the server's last output.
    """

    def __init__(self, state: str | os.PathLike[str] | None, timeout: float, options: Sequence[str] = ()) -> None:
        self._timeout = timeout
        folders: list[Path] = []
        self._cleanup = weakref.finalize(self, _remove, folders)
        with ExitStack() as opened:
            try:
                for parent in (None, folder_for_sockets(_WORKER_SOCKET)):
                    folders.append(Path(tempfile.mkdtemp(prefix=PREFIX, dir=parent)))
                log = opened.enter_context(open(folders[0] / "log", "w+b", buffering=0))
                ready = self._launch(folders, log, state, options)
            except OSError as error:
                self._cleanup()
                raise Unavailable(
                    f"the embedded server cannot be started: {error}",
                    hint=way_out_of(error, "set TMPDIR to a folder that can be written and has some megabytes left"),
                ) from error
            _RUNNING.add(self)
            self._await(ready, log)

    def _launch(
        self, folders: list[Path], log: BinaryIO, state: str | os.PathLike[str] | None, options: Sequence[str]
    ) -> Path:
        """Start the process; returns the file that it writes when it is ready."""
        folder, sockets = folders
        self.endpoint = f"ipc://{sockets}/control"
        ready = folder / "ready.json"
        arguments = ["--endpoint", self.endpoint, "--ready-file", str(ready)]
        arguments += ["--state", str(state if state is not None else folder / "state")]
        reader, self._lifeline = _pipe()
        try:
            self.process = subprocess.Popen(
                [sys.executable, "-m", "mesh_motion_server", "serve", *arguments, *options],
                env=os.environ | {_LIFELINE: str(reader), _PRIVATE_FOLDERS: json.dumps([str(folder), str(sockets)])},
                pass_fds=[reader],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=log,
                start_new_session=True,  # Ctrl-C is for the client, which then stops the server in the right order
            )
        except OSError:
            os.close(self._lifeline)
            raise
        finally:
            os.close(reader)
        return ready

    def _await(self, ready: Path, log: BinaryIO) -> None:
        deadline = time.monotonic() + self._timeout
        while not ready.exists():
            if self.process.poll() is not None or time.monotonic() > deadline:
                words, hint = self._last_words(log)
                self.stop()
                raise Unavailable(f"the embedded server did not become ready: {words}", hint=hint)
            time.sleep(0.01)
        self.endpoint = json.loads(ready.read_text(encoding="utf-8"))["endpoint"]

    def _last_words(self, log: BinaryIO) -> tuple[str, str]:
        """The server's last output, and a way out of the error; the server may have removed the log from its folder."""
        said_so_far = os.pread(log.fileno(), os.fstat(log.fileno()).st_size, 0)
        lines = said_so_far.decode("utf-8", errors="replace").strip().splitlines()
        if not lines:
            return f"no output within {self._timeout} s", "give it more time: timeout=…"
        if "No module named" in lines[-1]:
            way_out = "pip install 'mesh-motion-server[server]', or give an endpoint"
            return lines[-1], way_out
        try:
            said: dict[str, Any] = json.loads(lines[-1])
            return str(said["reason"]), str(said.get("hint", ""))
        except (ValueError, KeyError, TypeError):
            return lines[-1], ""

    def leave_to_parent(self) -> None:
        """Give the server up in a forked child: the server lives and ends with the parent."""
        os.close(self._lifeline)
        self._lifeline = -1
        self._cleanup.detach()

    def stop(self) -> None:
        """Drain and end the server; idempotent."""
        if not self._cleanup.alive:
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
        self._cleanup()


def _pipe() -> tuple[int, int]:
    """Return both ends of a pipe with numbers above 2: closed standard descriptors here would be others in a child."""
    import fcntl  # noqa: PLC0415  (not on Windows, where the client can be imported all the same)

    ends, moved = os.pipe(), list[int]()
    try:
        moved += (fcntl.fcntl(end, fcntl.F_DUPFD_CLOEXEC, 3) for end in ends)
    except OSError:
        for end in moved:
            os.close(end)
        raise
    finally:
        for end in ends:
            os.close(end)
    reader, writer = moved
    return reader, writer


def _remove(folders: list[Path]) -> None:
    for folder in folders:
        shutil.rmtree(folder, ignore_errors=True)


def _leave_all_to_parent() -> None:
    for server in list(_RUNNING):
        if server._lifeline >= 0:
            server.leave_to_parent()


if hasattr(os, "register_at_fork"):  # on systems where processes can fork
    os.register_at_fork(after_in_child=_leave_all_to_parent)
