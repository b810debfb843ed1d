"""A whole server in separate processes, which end with this one: started, stopped, killed and started again."""

import contextlib
import json
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any, Self

from mesh_motion_client import Keys

from mesh_motion_server.security.key_folder import admit, make_client_keys, make_server_keys
from mesh_motion_server.transport.serve import LIFELINE
from tests.faults.check import BrokenPromise
from tests.faults.processes import alive, children_of, descendants, name_of
from tests.faults.waiting import wait_until

#: Seconds until a server is ready, and until it has ended; a busy machine may need most of them.
_PATIENCE = 120.0
#: Bytes: a thousand small sessions and more.
_ROOM = 2 << 30


class ServerProcess:
    """The installed ``mesh-motion serve``; as a context manager it is started, and stopped at the end.

    After a second start it has the same endpoint and the same sessions.

    ``folder``: folder for the sessions and the log; made if missing; ``level`` ({"debug", "info", "warning", "error"}):
    level of the log; ``environment``: additional environment variables of its processes; ``pass_fds``: inherited file
    descriptors; ``settings``: of :class:`~mesh_motion_server.settings.ServerSettings`, plain values; by default one
    thread and a free port of 127.0.0.1. ``state``: folder of the sessions, unless ``state_folder`` is given;
    ``log_path``: the logs of all runs, JSON lines; ``output_path``: standard output of the last run; ``ready_file``:
    exists while clients may connect; ``announced``: content of that file at the last start.
    """

    def __init__(
        self,
        folder: Path,
        *,
        level: str = "info",
        environment: Mapping[str, str] = MappingProxyType({}),
        pass_fds: Sequence[int] = (),
        **settings: Any,
    ) -> None:
        self.folder, self.state, self.level = folder, folder / "state", level
        self.log_path, self.output_path, self.ready_file = folder / "log", folder / "output", folder / "ready.json"
        known = {"endpoint": "tcp://127.0.0.1:0", "threads": 1, "state_folder": str(self.state)}
        self.settings: dict[str, Any] = known | settings
        self.announced: dict[str, Any] = {}
        self._environment, self._pass_fds = dict(environment), tuple(pass_fds)
        self._process: subprocess.Popen[bytes] | None = None
        self._lifeline = -1

    # --- what is known of it -----------------------------------------------------------------------------------------

    @property
    def endpoint(self) -> str:
        """Its endpoint; the port is known after the first start."""
        return str(self.settings["endpoint"])

    @property
    def process(self) -> subprocess.Popen[bytes]:
        """The supervisor.

        Raises BrokenPromise if it was never started.
        """
        if self._process is None:
            raise BrokenPromise("the server was not started")
        return self._process

    @property
    def runs(self) -> bool:
        return self._process is not None and self._process.poll() is None

    def children(self) -> list[int]:
        """Processes that the supervisor has started, oldest first: the gateway, the monitor if there is one, workers.

        Raises psutil.NoSuchProcess if the supervisor has ended.
        """
        return children_of(self.process.pid)

    def gateway(self) -> int:
        (pid,) = [pid for pid in descendants(self.process.pid) if name_of(pid) == "mesh-gateway"]
        return pid

    def workers(self) -> set[int]:
        return {pid for pid in descendants(self.process.pid) if name_of(pid) == "mesh-worker"}

    def worker_of(self, session: str) -> int:
        """Process id of a session's newest worker, from the log."""
        at_work = [event for event in self.events("worker_started") if event["session"] == session]
        return int(at_work[-1]["worker"])

    def kill_worker(self, session: str) -> None:
        """Send SIGKILL to a session's worker; the log may show a new worker a moment after the client knows it."""

        def killed() -> bool:
            with contextlib.suppress(ProcessLookupError):
                os.kill(self.worker_of(session), signal.SIGKILL)
                return True
            return False

        wait_until(killed, f"the worker of session {session} is killed")

    def events(self, *names: str) -> list[dict[str, Any]]:
        """Whole lines of the log, for these events or for all."""
        lines = self.log_path.read_text(encoding="utf-8", errors="replace").splitlines()
        events = [json.loads(line) for line in lines if line.startswith("{") and line.endswith("}")]
        return [event for event in events if not names or event.get("event") in names]

    def last_words(self) -> str:
        return self.log_path.read_text(encoding="utf-8", errors="replace")[-800:]

    # --- its lives ---------------------------------------------------------------------------------------------------

    def command(self, ready: Path) -> list[str]:
        """Arguments for Python; the program writes ``ready`` when clients may connect."""
        file = self.folder / "settings.toml"
        lines = [f"{name} = {json.dumps(value)}\n" for name, value in self.settings.items()]
        file.write_text("".join(lines), encoding="utf-8")
        options = ["--settings", str(file), "--ready-file", str(ready), "--log-level", self.level]
        return ["-m", "mesh_motion_server", "serve", *options]

    def start(self) -> Self:
        """Start it and wait until clients may connect.

        Raises BrokenPromise if clients cannot connect in time; the server has then ended.
        """
        self.launch()
        self.wait_ready()
        return self

    def launch(self) -> None:
        self._let_go()
        self.folder.mkdir(parents=True, exist_ok=True)
        self.ready_file.unlink(missing_ok=True)  # one that was killed leaves it behind
        lifeline, self._lifeline = os.pipe()  # the server ends with this process, however that ends
        with self.log_path.open("ab") as log, self.output_path.open("wb") as output:
            self._process = subprocess.Popen(
                [sys.executable, *self.command(self.ready_file)],
                env=os.environ | {LIFELINE: str(lifeline)} | self._environment,
                pass_fds=[lifeline, *self._pass_fds],
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=log,
            )
        os.close(lifeline)

    def wait_ready(self) -> None:
        """Wait until clients may connect.

        Raises BrokenPromise as :meth:`start`.
        """
        try:
            wait_until(lambda: self.ready_file.exists() or not self.runs, "the server is ready", _PATIENCE)
            self.announced = json.loads(self.ready_file.read_text(encoding="utf-8"))
        except (BrokenPromise, FileNotFoundError):
            self.stop()
            raise BrokenPromise(f"a server did not become ready: {self.last_words()}") from None
        self.settings["endpoint"] = self.announced["endpoint"]

    def stop(self, how: int = signal.SIGTERM) -> int | None:
        """End the server, by a drain or with this signal; return its exit status, None if it was never started.
        Idempotent.
        """
        if self._process is None:
            return None
        if self.runs:
            self._process.send_signal(how)
        try:
            self._process.wait(_PATIENCE)
        except subprocess.TimeoutExpired:
            self.kill()
        self._let_go()
        return self._process.returncode

    def kill(self) -> None:
        """Send SIGKILL to the supervisor, and wait for its children, which end with it."""
        if self._process is None:
            return
        children = descendants(self._process.pid) - {self._process.pid}
        self._process.kill()
        self._process.wait()
        self._let_go()
        wait_until(lambda: not any(map(alive, children)), "the children of a killed server end", _PATIENCE)

    def _let_go(self) -> None:
        if self._lifeline >= 0:
            os.close(self._lifeline)
            self._lifeline = -1

    def __enter__(self) -> Self:
        return self if self.runs else self.start()

    def __exit__(self, *_: object) -> None:
        self.stop()


def seeded(*names: str) -> dict[str, str]:
    """Environment of a server with faults by name: tests/faults/seeded/sitecustomize.py."""
    paths = [str(Path(__file__).with_name("seeded")), *filter(None, [os.environ.get("PYTHONPATH")])]
    return {"PYTHONPATH": os.pathsep.join(paths), "SEEDED_FAULTS": ",".join(names)}


def make_keys(folder: Path, name: str = "prover") -> Keys:
    """Keys of a server, in ``folder / "keys"``, and of one user on its list."""
    make_server_keys(folder / "keys")
    public = make_client_keys(name, folder / "clients")
    admit(public.key, folder / "keys", name=name)
    return Keys.load(folder / "clients" / f"{name}.secret", folder / "keys" / "server.public")


def memory_folder() -> str | None:
    """A folder in memory for rows that do not test the disk; None if the system has none."""
    folder = Path("/dev/shm")
    return str(folder) if os.access(folder, os.W_OK) and shutil.disk_usage(folder).free > _ROOM else None
