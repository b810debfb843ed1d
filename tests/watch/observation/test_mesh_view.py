"""The committed mesh of a stored session, for drawing: against the session's own numbers, and on a live one."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from mesh_motion_protocol.digests import state_digest

from mesh_motion_server.errors import InvalidInput, JournalError
from mesh_motion_server.numerics.mesh.boundary_facets import boundary_facets
from mesh_motion_server.numerics.mesh.cells import CellTable
from mesh_motion_server.session.journal.filesystem import PosixFileSystem
from mesh_motion_server.session.spec import StoredSpec
from mesh_motion_server.session.store import SessionStore
from mesh_motion_server.watch.observation import mesh_view
from mesh_motion_server.watch.observation.mesh_surface import cells_surface, sides_surface
from mesh_motion_server.watch.observation.mesh_view import StoredMesh
from proofs.driver import SESSION, Driver, make_driver
from proofs.stand_in import grid_mesh, split_mesh


def stepped(folder: Path, steps: int, pieces: int = 1) -> tuple[Driver, Path]:
    """A session with so many steps, and its folder."""
    mesh = grid_mesh()
    driver = make_driver(SessionStore(folder), split_mesh(mesh, pieces) if pieces > 1 else [mesh])
    driver.open()
    for step in range(1, steps + 1):
        driver.advance(step)
    return driver, folder / "sessions" / SESSION


@pytest.mark.parametrize("pieces", [1, 2])
def test_what_is_shown_is_what_was_committed(tmp_path: Path, pieces: int) -> None:
    driver, folder = stepped(tmp_path, 2, pieces)
    committed = driver.advance(3)[0]
    before = {path: path.read_bytes() for path in folder.iterdir() if path.is_file()}
    seen = StoredMesh(folder).look()
    assert (seen.step, seen.committed, seen.whole) == (3, 3, True)
    stored = StoredMesh(folder)
    assert state_digest(3, seen.points[stored._mesh.id_order]) == committed.digest
    assert {path: path.read_bytes() for path in folder.iterdir() if path.is_file()} == before
    cells = stored._mesh.cells
    assert len(seen.cells) == len(cells) == len(seen.quality)
    for place in (0, len(seen.cells) - 1):
        assert stored._mesh.locate_cell(int(seen.cells[place])) == (
            seen.names.partition[place],
            seen.names.types[seen.names.kind[place]],
            seen.names.local[place],
        )


def test_an_inverted_cell_is_told_apart_where_its_quality_is_that_of_a_valid_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    _, folder = stepped(tmp_path, 1)
    stored = StoredMesh(folder)
    step, committed, points = stored.coordinates()
    monkeypatch.setattr(stored, "coordinates", lambda: (step, committed, points * [-1.0, 1.0]))
    monkeypatch.setattr(stored, "_spec", with_metric(stored._spec, "skew"))
    seen = stored.look()
    assert seen.quality.min() > 0.0
    assert seen.inverted.all()


def with_metric(spec: StoredSpec, metric: str) -> StoredSpec:
    return replace(spec, settings=spec.settings.model_copy(update={"quality_metric": metric}))


def test_a_live_session_is_followed_and_a_commit_in_flight_is_passed_over(tmp_path: Path) -> None:
    driver, folder = stepped(tmp_path, 2)
    stored = StoredMesh(folder)
    assert stored.look().step == 2
    driver.advance(3)
    assert stored.look().step == 3

    class Overtaken(PosixFileSystem):
        """Two commits go by between the journal and the slot."""

        left = 1

        def read(self, handle: int, offset: int, size: int) -> bytes:
            if self.left and size == 8 * 25 * 2 and offset:
                self.left -= 1
                driver.advance(4)
                driver.advance(5)
            return super().read(handle, offset, size)

    found = StoredMesh(folder, files=Overtaken()).look()
    assert (found.step, found.committed) == (5, 5)


def test_what_does_not_verify_is_told(tmp_path: Path) -> None:
    driver, folder = stepped(tmp_path, 2)
    driver.host.close()
    slot = folder / "slot-0"
    data = bytearray(slot.read_bytes())
    data[-1] ^= 1
    slot.write_bytes(data)
    with pytest.raises(JournalError, match="step 2"):
        StoredMesh(folder).look()
    with pytest.raises(InvalidInput, match="MB"):
        StoredMesh(folder, most_bytes=10)
    with pytest.raises(JournalError):
        StoredMesh(tmp_path)


def test_of_a_large_mesh_the_worst_region_is_shown(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    _, folder = stepped(tmp_path, 1)
    whole = StoredMesh(folder).look()
    monkeypatch.setattr(mesh_view, "MOST_CELLS", 6)
    seen = StoredMesh(folder).look()
    assert (len(seen.cells), seen.whole) == (6, False)
    assert int(np.argmin(seen.quality)) in seen.cells
    assert len(seen.quality) == len(whole.quality)
    assert len(seen.surface.outline) == len(whole.surface.outline)


BOX = np.array([[x, y, z] for z in (0, 1, 2) for y in (0, 1, 2) for x in (0, 1, 2)], dtype=float)
CORNERS = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)]
HEXAHEDRA = np.array(
    [[(x + i) + 3 * (y + j) + 9 * (z + k) for i, j, k in CORNERS] for z in (0, 1) for y in (0, 1) for x in (0, 1)]
)
SPLIT = [(0, 1, 2, 6), (0, 2, 3, 6), (0, 3, 7, 6), (0, 7, 4, 6), (0, 4, 5, 6), (0, 5, 1, 6)]


@pytest.mark.parametrize("kind", ["hexahedron", "tetra"])
def test_each_side_of_the_boundary_knows_its_cell(kind: str) -> None:
    blocks = HEXAHEDRA if kind == "hexahedron" else np.concatenate([HEXAHEDRA[:, list(four)] for four in SPLIT])
    cells = CellTable.from_arrays({kind: blocks})
    surface = sides_surface(cells, np.array([0, 3]), 1000)
    boundary = ~surface.inner
    assert boundary.sum() == 2 * 6 * 4  # two triangles on each of four squares of six sides
    assert (surface.owners >= 0).all()
    for triangle, owner in zip(surface.triangles, surface.owners, strict=True):
        assert set(triangle) <= set(blocks[owner])
    assert set(surface.owners[surface.inner]) == {0, 3}
    few = sides_surface(cells, np.array([0]), 5, np.linalg.norm(BOX, axis=1))
    assert len(np.unique(few.triangles[~few.inner].ravel())) < 27


def test_edges_come_once_and_the_outline_is_the_boundary() -> None:
    cells = CellTable.from_arrays({"triangle": np.array([[0, 1, 2], [0, 2, 3]]), "quad": np.array([[1, 4, 5, 2]])})
    surface = cells_surface(cells)
    assert len(surface.edges) == 8
    assert len(surface.triangles) == 4
    assert surface.owners.tolist() == [0, 1, 2, 2]
    assert len(surface.outline) == len(boundary_facets(cells)["line"]) == 6
    assert cells_surface(CellTable.from_arrays({"line": np.array([[0, 1], [1, 2]])})).edges.tolist() == [[0, 1], [1, 2]]
