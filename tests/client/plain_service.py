"""The real session host with a very cheap model that can be stopped.

Environment: ``PLAIN_FOLDER`` is where the model looks for the file ``hold`` (a move waits while it lies there) and
appends a line to ``moves`` for every move that it computes.
"""

import os
import time
from functools import partial
from pathlib import Path

import numpy as np
from plain_model import PlainModel

from mesh_motion_server.service.dispatch import SessionHost as RealHost
from mesh_motion_server.session.store import SessionStore
from mesh_motion_server.transport import template

FOLDER = Path(os.environ["PLAIN_FOLDER"])


class WaitingModel(PlainModel):
    """Every node moves by the mean displacement of the moving nodes, which move to their targets."""

    farthest = 100.0
    motion_warnings = ("a warning",)

    def move(self, committed, targets, factors, *, boundary_displacement=None):
        with (FOLDER / "moves").open("a") as file:
            file.write("move\n")
        while (FOLDER / "hold").exists():
            time.sleep(0.01)
        return super().move(committed, targets, factors)

    def of_all(self, displacement):
        return np.array([np.sum(np.sort(column)) for column in displacement.T]) / len(displacement)


class SessionHost(RealHost):
    create = partial(RealHost.create, build_model=WaitingModel)
    resume = partial(RealHost.resume, build_model=WaitingModel)


def main(channel, level):
    return template.main(channel, level, lambda: (SessionHost, SessionStore))
