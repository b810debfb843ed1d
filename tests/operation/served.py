"""A server as an administrator starts it, with its pages and its log; and a small mesh."""

import json
import os
import signal
import subprocess
import sys
import time
import urllib.error
import urllib.request
from pathlib import Path

import numpy as np
from mesh_motion_client import Mesh, Patch
from prometheus_client.parser import text_string_to_metric_families

HERE = Path(__file__).parent
PATIENCE = 60.0


def wait_until(condition, what, seconds=PATIENCE):
    """Poll until the condition holds and return what it gave."""
    deadline = time.monotonic() + seconds
    while not (value := condition()):
        assert time.monotonic() < deadline, f"{what}: not within {seconds} s"
        time.sleep(0.02)
    return value


def small_mesh(cells=4):
    """A square in triangles: the left side moves, the right one is fixed."""
    n = cells + 1
    x = np.arange(n) / cells
    points = np.stack(np.meshgrid(x, x), axis=-1).reshape(-1, 2)
    i = (np.arange(cells)[:, None] * n + np.arange(cells)).ravel()
    triangles = np.concatenate([np.stack([i, i + 1, i + n + 1], axis=1), np.stack([i, i + n + 1, i + n], axis=1)])
    left, right = np.arange(0, n * n, n), np.arange(n - 1, n * n, n)
    return Mesh(points, {"triangle": triangles}, {"left": Patch("moving", left), "right": Patch("fixed", right)})


class Served:
    """One server; started again it keeps its endpoint and its sessions.

    It is `mesh-motion serve` with ``real``; otherwise the same with a stand-in for the numerics, which starts at once.
    """

    def __init__(self, folder, settings):
        self.folder, self.state, self.log_path = folder, folder / "state", folder / "log.jsonl"
        self.endpoint, self.process, self._lifeline = "tcp://127.0.0.1:0", None, -1
        self.real, self.level = settings.pop("real", False), settings.pop("level", "info")
        self.environment = settings.pop("environment", {})
        self.log_path = Path(settings.pop("log", self.log_path))
        self.settings = {"metrics": "127.0.0.1:0", "threads": 1, "state_folder": str(self.state)} | settings

    def start(self, *, ready=True):
        """Start it; with ``ready`` until clients may connect."""
        ready_file = self.folder / "ready.json"
        ready_file.unlink(missing_ok=True)
        lifeline, self._lifeline = os.pipe()  # the server ends with the tests, even if they are killed
        with self.log_path.open("ab") as log:
            self.process = subprocess.Popen(
                [sys.executable, *self._command(ready_file)],
                env=os.environ | {"MESH_MOTION_LIFELINE_FD": str(lifeline)} | self.environment,
                stdout=subprocess.DEVNULL,
                stderr=log,
                pass_fds=[lifeline],
            )
        os.close(lifeline)
        if ready:
            wait_until(lambda: ready_file.exists() or self.process.poll() is not None, "the server is ready")
            assert self.process.poll() is None, self.log_path.read_text()
            values = json.loads(ready_file.read_text())
            self.endpoint, self.pages = values["endpoint"], values["metrics"].replace("tcp://", "http://")
        return self

    def _command(self, ready_file):
        settings = self.settings | {"endpoint": self.endpoint}
        if not self.real:
            return [str(HERE / "run_stand_in.py"), json.dumps(settings), str(ready_file), self.level]
        file = self.folder / "settings.toml"
        file.write_text("".join(f"{key} = {json.dumps(value)}\n" for key, value in settings.items()))
        options = ["--settings", str(file), "--ready-file", str(ready_file), "--log-level", self.level]
        return ["-m", "mesh_motion_server", "serve", *options]

    def stop(self, how=signal.SIGTERM):
        """End it; its exit status."""
        if self._lifeline >= 0:
            os.close(self._lifeline)
            self._lifeline = -1
        if self.process is None:
            return None
        if self.process.poll() is None:
            self.process.send_signal(how)
        try:
            return self.process.wait(PATIENCE)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
            raise

    def get(self, page):
        """Status and text of a page; asked again where a busy machine does not serve it within its five seconds."""
        return wait_until(lambda: self._get(page), f"{page} is answered")

    def _get(self, page):
        try:
            with urllib.request.urlopen(self.pages + page, timeout=PATIENCE) as reply:
                return reply.status, reply.read().decode()
        except urllib.error.HTTPError as refusal:
            with refusal:
                return refusal.code, refusal.read().decode()
        except OSError:
            return None

    def metrics(self):
        """Sample name, or name and label's value → number."""
        status, text = self.get("/metrics")
        assert status == 200
        samples = {}
        for family in text_string_to_metric_families(text):
            for sample in family.samples:
                name = sample.name.removeprefix("mesh_motion_")
                key = (name, *sample.labels.values()) if sample.labels else name
                samples[key] = sample.value
        return samples

    def logs(self, event=None):
        """The log's whole lines, of one event or all."""
        whole, _, _ = self.log_path.read_text().rpartition("\n")
        lines = [json.loads(line) for line in whole.splitlines()]
        return [line for line in lines if event in (None, line["event"])]

    def children(self):
        """Process ids: gateway, monitor, workers."""
        with open(f"/proc/{self.process.pid}/task/{self.process.pid}/children") as children:
            return [int(pid) for pid in children.read().split()]
