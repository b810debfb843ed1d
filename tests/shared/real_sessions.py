"""Sessions with the real numerics, without a socket."""

from dataclasses import replace
from typing import Any

import numpy as np
from mesh_motion_numerics.mesh.roles import Patch
from threadpoolctl import threadpool_info

from mesh_motion_server.service.dispatch import SessionHost
from mesh_motion_server.session.model import build_motion_model
from mesh_motion_server.session.partitions.meshes import PartitionMesh
from mesh_motion_server.session.store import SessionStore
from mesh_motion_server.settings import MethodSettings, ServerSettings
from tests.faults.driver import SESSION, Driver, make_spec
from tests.faults.stand_in import grid_mesh


def boxed(count: int) -> PartitionMesh:
    """A grid whose left side moves between fixed walls."""
    mesh = grid_mesh(count)
    sides = np.flatnonzero(((mesh.points == 0) | (mesh.points == 1)).any(axis=1))
    left = mesh.patches["left"].nodes
    return replace(mesh, patches={"left": Patch("moving", left), "walls": Patch("fixed", np.setdiff1d(sides, left))})


def bulge(driver: Driver, size: float) -> list[Any]:
    return [
        np.stack([size * np.sin(np.pi * m.points[i, 1]), 0 * i], axis=1)
        for m, i in zip(driver.meshes, driver.moving, strict=True)
    ]


def new_session(
    store: SessionStore, meshes: list[PartitionMesh], session: str = SESSION, level: str = "full", **settings: Any
) -> Driver:
    method = MethodSettings.from_mapping(settings)
    spec = make_spec(session, partitions=len(meshes), durability=level, settings=method)
    limits = ServerSettings(reserve_disk_bytes=0)
    return Driver(SessionHost.create(spec, store, limits=limits, build_model=build_motion_model), meshes)


def computes_as_servers() -> bool:
    """Whether BLAS here uses the same code as in servers (transport/processes.py): not on machines with AVX-512."""
    own = {library.get("architecture") for library in threadpool_info()}
    return not own & {"SkylakeX", "Cooperlake", "SapphireRapids"}
