"""A whole server for a proof: gateway, supervisor and workers in processes of their own, which end with us.

``python -m mesh_motion_server.prove.served SETTINGS_JSON READY_FILE NUMERICS`` is what it runs: the server itself, with
the stand-in's arithmetic or the real one.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType, TracebackType
from typing import Any, Literal, Self

from mesh_motion_server.prove.check import BrokenPromise
from mesh_motion_server.prove.processes import command_of, descendants
from mesh_motion_server.settings import ServerSettings
from mesh_motion_server.transport.hosting import Hosting
from mesh_motion_server.transport.serve import LIFELINE, serve

__all__ = ["Served", "memory_folder"]

#: Seconds until a server is ready, and until it has ended; a busy machine may need most of them.
_PATIENCE = 120.0
#: Bytes: a thousand small sessions and more.
_ROOM = 2 << 30
_STAND_IN = Hosting("mesh_motion_server.prove.stand_in_host", numerics="mesh_motion_server.prove.stand_in")


class Served:
    """A server on an endpoint that the system chose; used as a context.

    Parameters
    ----------
    folder : Path
        For the endpoint's files, the log and, unless ``state_folder`` is given, the sessions.
    numerics : {"stand-in", "real"}
    environment : dict
        What its processes find in theirs beside what is in ours.
    settings : dict
        Of :class:`ServerSettings`; by default TCP on this machine, one thread.

    Attributes
    ----------
    endpoint : str
    process : subprocess.Popen
        The supervisor.
    log : Path
    """

    def __init__(
        self,
        folder: Path,
        numerics: Literal["stand-in", "real"] = "stand-in",
        *,
        environment: Mapping[str, str] = MappingProxyType({}),
        **settings: Any,
    ) -> None:
        self.log, ready = folder / "log", folder / "ready.json"
        ready.unlink(missing_ok=True)
        known = {"endpoint": "tcp://127.0.0.1:0", "state_folder": str(folder / "state"), "threads": 1}
        lifeline, self._lifeline = os.pipe()
        with self.log.open("ab") as log:
            self.process = subprocess.Popen(
                [sys.executable, "-m", __name__, json.dumps(known | settings), str(ready), numerics],
                env=os.environ | {LIFELINE: str(lifeline)} | dict(environment),
                pass_fds=[lifeline],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=log,
            )
        os.close(lifeline)
        self.endpoint = self._await(ready)

    def _await(self, ready: Path) -> str:
        deadline = time.monotonic() + _PATIENCE
        while not ready.exists():
            if self.process.poll() is not None or time.monotonic() > deadline:
                self.stop()
                words = self.log.read_text(encoding="utf-8", errors="replace")
                raise BrokenPromise(f"a server did not become ready: {words[-300:]}")
            time.sleep(0.005)
        return str(json.loads(ready.read_text(encoding="utf-8"))["endpoint"])

    def gateway(self) -> int:
        """The gateway's process."""
        (pid,) = [pid for pid in descendants(self.process.pid) if "transport.gateway" in command_of(pid)]
        return pid

    def workers(self) -> set[int]:
        """Processes of sessions, and the spare."""
        return {pid for pid in descendants(self.process.pid) if "transport.worker" in command_of(pid)}

    def stop(self) -> None:
        """Drain and end it; idempotent."""
        if self._lifeline >= 0:
            os.close(self._lifeline)
            self._lifeline = -1
        try:
            self.process.wait(_PATIENCE)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: type[BaseException] | BaseException | TracebackType | None) -> None:
        self.stop()


def memory_folder() -> str | None:
    """Where files cost no disk, for proofs that are not about it; None where the system has no such place."""
    folder = Path("/dev/shm")
    return str(folder) if os.access(folder, os.W_OK) and shutil.disk_usage(folder).free > _ROOM else None


def main(settings: str, ready_file: str, numerics: str) -> int:
    """Serve until the lifeline ends."""
    hosting = _STAND_IN if numerics == "stand-in" else Hosting()
    return serve(
        ServerSettings.model_validate_json(settings), ready_file=Path(ready_file), level="info", hosting=hosting
    )


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
