"""What the session's tests share: a small mesh in one piece or several, and ranks that drive a session."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from mesh_motion_protocol.messages import Join

from mesh_motion_server.numerics.roles import Patch
from mesh_motion_server.prove import model_files
from mesh_motion_server.prove.driver import SESSION, TOKEN, Driver, make_driver, make_spec, resume, resume_driver
from mesh_motion_server.prove.stand_in import StandIn, grid_mesh
from mesh_motion_server.service.dispatch import Envelope
from mesh_motion_server.session.partitions import PartitionMesh


def split_mesh(whole: PartitionMesh, parts: int, seed: int = 0) -> list[PartitionMesh]:
    """Cells dealt out at random; every partition numbers its nodes in an order of its own."""
    random = np.random.default_rng(seed)
    cells = whole.cells["triangle"]
    owner = random.integers(0, parts, len(cells))
    owner[:parts] = np.arange(parts)
    meshes = []
    for part in range(parts):
        own = random.permutation(np.flatnonzero(owner == part))
        nodes = random.permutation(np.unique(cells[own]))
        local = np.full(len(whole.points), -1)
        local[nodes] = np.arange(len(nodes))
        patches = {
            name: Patch(patch.role, local[np.intersect1d(patch.nodes, nodes)]) for name, patch in whole.patches.items()
        }
        meshes.append(
            PartitionMesh(
                points=whole.points[nodes],
                global_ids=whole.global_ids[nodes],
                cells={"triangle": local[cells[own]]},
                patches={name: patch for name, patch in patches.items() if len(patch.nodes)},
            )
        )
    return meshes


@pytest.fixture
def kit() -> SimpleNamespace:
    """The builders of this module: test modules cannot import it."""
    return SimpleNamespace(
        StandIn=StandIn,
        grid_mesh=grid_mesh,
        split_mesh=split_mesh,
        make_spec=make_spec,
        TOKEN=TOKEN,
        SESSION=SESSION,
        files=model_files,
        make_driver=make_driver,
        resume=resume,
        resume_driver=resume_driver,
        Driver=Driver,
        Envelope=Envelope,
        Join=Join,
    )
