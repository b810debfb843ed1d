"""A server as started by an administrator, with its pages and its log; and a small mesh."""

from pathlib import Path

import status_page
from prometheus_client.parser import text_string_to_metric_families

from tests.faults.client_mesh import client_mesh
from tests.faults.server_process import ServerProcess
from tests.faults.stand_in import grid_mesh
from tests.faults.stand_in_server import StandInServer


def small_mesh():
    """A square in triangles: the left side moves, the right one is fixed."""
    return client_mesh(grid_mesh())


class Served(StandInServer):
    """A server with its pages for Prometheus and probes.

    It is `mesh-motion serve` with ``real``; otherwise the same with a stand-in for the numerics, which starts at once.
    """

    def __init__(self, folder, *, real=False, log=None, **options):
        super().__init__(folder, **{"metrics": "127.0.0.1:0"} | options)
        self.real, self.log_path = real, Path(log or self.log_path)

    def command(self, ready):
        return ServerProcess.command(self, ready) if self.real else super().command(ready)

    def get(self, page):
        return status_page.get(self, page)

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
