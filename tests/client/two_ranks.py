"""One rank of a driver with two: ``python two_ranks.py ENDPOINT CREDENTIALS_FILE RANK MESH.npz OUT.npy``."""

import sys
import time
from pathlib import Path

import numpy as np
from mesh_motion_client import Credentials, Mesh, Patch, connect


def part(file, rank):
    """This rank's mesh: its nodes, cells and moving nodes in local numbers."""
    with np.load(file) as data:
        ids = data[f"ids{rank}"]
        local = {int(g): i for i, g in enumerate(ids)}
        cells = np.array([[local[int(g)] for g in cell] for cell in data[f"cells{rank}"]])
        patches = {
            name: Patch(role, np.array([local[int(g)] for g in data[name] if int(g) in local], dtype=int))
            for name, role in (("left", "moving"), ("right", "fixed"))
        }
        return Mesh(data["points"][ids], {"triangle": cells}, patches, global_ids=ids)


def main(endpoint, credentials, rank, file, out):
    rank, path = int(rank), Path(credentials)
    mesh = part(file, rank)
    with connect(endpoint, timeout=30) as server:
        if rank == 0:
            session = server.open(mesh, partitions=2, announce=lambda c: c.save(path))
        else:
            deadline = time.monotonic() + 30
            while not path.exists() and time.monotonic() < deadline:
                time.sleep(0.01)
            session = server.join(Credentials.load(path), mesh, partition=rank)
        with session:
            for step in range(3):
                x = mesh.points[session.moving_nodes]
                session.move(0.01 * (step + 1) * np.stack([x[:, 1], x[:, 0] + 1], axis=1))
                session.commit()
            np.save(out, session.points())


if __name__ == "__main__":
    main(*sys.argv[1:])
