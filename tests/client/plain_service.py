"""The real session host with a model that computes next to nothing and can be held up.

Environment: ``PLAIN_FOLDER`` is where the model looks for the file ``hold`` (a move waits while it lies there) and
appends a line to ``moves`` for every move that it computes.
"""

import os
import time
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import numpy as np

from mesh_motion_server.errors import NumericalError
from mesh_motion_server.numerics.roles import BoundaryRoles
from mesh_motion_server.service.dispatch import SessionHost as RealHost
from mesh_motion_server.session.store import SessionStore

__all__ = ["SessionHost", "SessionStore"]

FOLDER = Path(os.environ["PLAIN_FOLDER"])


class PlainModel:
    """Every node moves by the mean displacement of the moving nodes, which go where they are told."""

    warnings = ()

    def __init__(self, points, cells, patches, method):
        self.roles, self.method, self.cells = BoundaryRoles.from_patches(patches), method, cells

    def summary(self, points):
        values = SimpleNamespace(min=1.0, mean=1.0, p1=1.0, p5=1.0, p50=1.0)
        return SimpleNamespace(
            size=values,
            skew=values,
            size_skew=values,
            metric=values,
            worst=[],
            inverted=0,
            cells=sum(len(block) for block in self.cells),
        )

    def without_distributions(self):
        return self

    def move(self, committed, targets, factors):
        with (FOLDER / "moves").open("a") as file:
            file.write("move\n")
        while (FOLDER / "hold").exists():
            time.sleep(0.01)
        told = targets - committed[self.roles.moving]
        if abs(told).max() > 100:
            raise NumericalError("too far", best=-0.5, cells=[1, 0], fraction=0.25, hint="move less")
        points = committed + np.array([np.sum(np.sort(column)) for column in told.T]) / len(told)
        points[self.roles.moving] = targets
        correction = SimpleNamespace(
            method="none", enrichment_points=np.zeros((0, committed.shape[1])), freed_nodes=0, iterations=0
        )
        return SimpleNamespace(
            points=points,
            standard=self.summary(points),
            corrected=self.summary(points),
            correction=correction,
            reached=True,
            seconds={"total": 0.0},
            caches={"factorization": "made"},
            control_points=np.arange(len(committed)),
            support_radius=1.0,
            sub_steps=1,
            warnings=["a warning"],
        )


class SessionHost(RealHost):
    """The real one, with the plain model."""

    create = partial(RealHost.create, build_model=PlainModel)
    resume = partial(RealHost.resume, build_model=PlainModel)
