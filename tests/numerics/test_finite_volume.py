"""Faces of a finite-volume code: known angles, no change by rigid motions, and the values of checkMesh."""

import re
from dataclasses import replace
from pathlib import Path

import foam_cases as foam
import numpy as np
import pytest
from box_meshes import CELL_KINDS, box_mesh
from frame_meshes import tensor_grid
from mesh_motion_numerics.mesh import finite_volume
from mesh_motion_numerics.mesh.cell_facets import CellFacets
from mesh_motion_numerics.mesh.cells import CELL_TYPES, CellTable
from mesh_motion_numerics.mesh.finite_volume import FaceMeasures, extruded_cells, extruded_points, face_measures
from mesh_motion_numerics.mesh.local_facets import LOCAL_FACETS
from scipy.spatial.transform import Rotation

from benchmarks.peers.openfoam.foam_files import write_polymesh
from benchmarks.peers.openfoam.polymesh import PolyMesh

FLOOR = 1e-5  # degrees: near 1 a cosine gives its angle only to the square root of the rounding error


def measured(points: np.ndarray, cells: CellTable) -> FaceMeasures:
    found = face_measures(points, cells)
    assert found is not None
    return found


def angles(points: np.ndarray, cells: CellTable) -> np.ndarray:
    centres, volumes = finite_volume._cell_geometry(points, cells)
    return finite_volume._measured(points, CellFacets.of(cells), centres, volumes)[0]


def shaken(kind: str, share: float = 0.25, n: int = 5) -> tuple[np.ndarray, CellTable]:
    mesh = box_mesh(kind, n)
    points = mesh.points + share / n * np.random.default_rng(7).uniform(-1, 1, mesh.points.shape)
    return points + 0.1 * np.sin(3 * points[:, ::-1]), mesh.cells


def line_of_cubes(shift: float) -> tuple[np.ndarray, CellTable]:
    """Two unit cubes side by side along x, sheared: y grows by ``shift`` times x."""
    points, cells = tensor_grid(np.arange(3.0), np.arange(2.0), np.arange(2.0))
    points[:, 1] += shift * points[:, 0]
    return points, CellTable.from_arrays({"hexahedron": cells})


@pytest.mark.parametrize("degrees", [0.0, 10.0, 64.9, 65.1, 74.9, 75.1, 80.0])
def test_a_sheared_lattice_has_the_angle_of_its_shear(degrees: float) -> None:
    points, cells = line_of_cubes(np.tan(np.radians(degrees)))
    found = measured(points, cells)
    assert found.faces == 1
    assert found.max_non_orthogonality == pytest.approx(degrees, abs=FLOOR)
    assert (found.faces_above_65, found.faces_above_75) == (int(degrees > 65), int(degrees > 75))
    assert found.min_volume_ratio == pytest.approx(1.0)
    (worst,) = found.worst
    assert worst.cells == (0, 1)
    np.testing.assert_allclose(worst.centre, [1.0, 0.5 + np.tan(np.radians(degrees)), 0.5])


def test_a_sheared_cell_has_the_angle_and_skewness_of_its_shear() -> None:
    points = np.array([[0, 0], [1, 0], [2, 0.6], [0, 1], [1, 1], [2, 1.6]], dtype=float)
    found = measured(points, CellTable.from_arrays({"quad": np.array([[0, 1, 4, 3], [1, 2, 5, 4]])}))
    # d leads from (0.5, 0.5) to (1.5, 0.8) and meets the edge x = 1 at y = 0.65, 0.15 from its middle: 0.3 of its half;
    # the edge x = 2 has its middle at y = 1.1 and the cell's centre at y = 0.8
    assert found.max_non_orthogonality == pytest.approx(np.degrees(np.arctan(0.3)))
    assert found.max_skewness == pytest.approx(0.3 / 0.5)


def test_the_volume_ratio_is_that_of_neighbours() -> None:
    points = np.array([[x, y] for x in (0.0, 1.0, 3.0, 3.5) for y in (0.0, 1.0)])
    quads = np.array([[2 * i, 2 * i + 2, 2 * i + 3, 2 * i + 1] for i in range(3)])
    found = measured(points, CellTable.from_arrays({"quad": quads}))
    assert found.min_volume_ratio == pytest.approx(0.25)
    assert found.max_skewness == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("kind", CELL_KINDS)
def test_the_shortest_edge_and_smallest_face_are_those_against_rest(kind: str) -> None:
    """Computed from every edge and face of every cell."""
    rest, cells = box_mesh(kind, 5).points, box_mesh(kind, 5).cells
    points, plane = shaken(kind)[0], cells.dimension == 2

    def least(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        facets = [n[list(f)] for b in cells for n in b.nodes for f in LOCAL_FACETS[b.type.name]]
        lengths = np.array([np.linalg.norm(x[a] - x[b]) for f in facets for a, b in zip(f, np.roll(f, 1), strict=True)])
        spokes = [np.cross(x[f[2]] - x[f[0]], x[f[-1]] - x[f[1]] if len(f) > 3 else x[f[2]] - x[f[1]]) for f in facets
                  if not plane]  # fmt: skip
        return lengths, np.array([np.linalg.norm(area) / 2 for area in spokes])

    (lengths, areas), (lengths_at_rest, areas_at_rest) = least(points), least(rest)
    found = face_measures(points, cells, rest)
    assert found is not None
    assert found.shortest_edge == pytest.approx((lengths / lengths_at_rest).min(), rel=1e-12)
    expected = found.shortest_edge if plane else (areas / areas_at_rest).min()
    assert found.smallest_face == pytest.approx(expected, rel=1e-12)
    assert found.smallest_face < found.shortest_edge or plane


def test_a_collapsed_edge_is_seen_where_cells_keep_their_angles_and_areas() -> None:
    """Squeezed to a thousandth along x and stretched as much along y: a rectangle of the same area."""
    mesh = box_mesh("quad", 4)
    found = face_measures(mesh.points * [1e-3, 1e3], mesh.cells, mesh.points)
    assert found is not None
    assert found.max_non_orthogonality == pytest.approx(0.0, abs=FLOOR)
    assert found.min_volume_ratio == pytest.approx(1.0)
    assert found.shortest_edge == found.smallest_face == pytest.approx(1e-3)


@pytest.mark.parametrize("kind", CELL_KINDS)
def test_uniform_meshes_have_the_angles_of_their_cells(kind: str) -> None:
    mesh = box_mesh(kind, 5)
    found = measured(mesh.points, mesh.cells)
    assert found.faces == len(CellFacets.of(mesh.cells).neighbour)
    if kind in ("quad", "hexahedron"):
        assert found.max_non_orthogonality == pytest.approx(0.0, abs=FLOOR)
        assert found.max_skewness == pytest.approx(0.0, abs=1e-12)
    assert found.min_volume_ratio == pytest.approx(1.0 if "+" not in kind else 0.5)


@pytest.mark.parametrize("kind", CELL_KINDS)
def test_rigid_motion_and_scale_change_nothing(kind: str) -> None:
    points, cells = shaken(kind)
    before = measured(points, cells)
    turn = Rotation.from_rotvec([0.3, -1.1, 0.7]).as_matrix()
    if cells.dimension == 2:
        turn = Rotation.from_rotvec([0, 0, 0.7]).as_matrix()[:2, :2]
    after = measured(1e-3 * (points @ turn.T) + np.arange(cells.dimension), cells)
    for name, value in before.numbers().items():
        assert after.numbers()[name] == pytest.approx(value, rel=1e-8), name
    assert [face.cells for face in after.worst] == [face.cells for face in before.worst]


@pytest.mark.parametrize("kind", ["quad", "quad + triangle"])
def test_a_plane_mesh_is_its_extrusion(kind: str) -> None:
    points, cells = shaken(kind)
    plane = measured(points, cells)
    solid = measured(extruded_points(points) * [1, 1, 0.1], extruded_cells(cells, len(points)))
    for name, value in plane.numbers().items():
        assert solid.numbers()[name] == pytest.approx(value, rel=1e-9), name
    assert [face.cells for face in plane.worst] == [face.cells for face in solid.worst]
    assert plane.worst[0].centre == pytest.approx(solid.worst[0].centre[:2])


@pytest.mark.parametrize("kind", CELL_KINDS)
def test_the_worst_faces_are_named_by_their_cells(kind: str) -> None:
    points, cells = shaken(kind)
    found = measured(points, cells)
    values = [face.non_orthogonality for face in found.worst]
    assert len(values) == 10
    assert values == sorted(values, reverse=True)
    assert values[0] == found.max_non_orthogonality
    for face in found.worst:
        one, other = ({int(v) for v in block.nodes[row]} for block, row in map(cells.locate, face.cells))
        shared = sorted(one & other)
        assert len(shared) >= cells.dimension
        span = np.ptp(points[shared], axis=0)
        assert (np.abs(face.centre - points[shared].mean(axis=0)) <= span).all()


def test_blocks_change_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    rest, (points, cells) = box_mesh("hexahedron + wedge", 5).points, shaken("hexahedron + wedge")
    whole = face_measures(points, cells, rest)
    monkeypatch.setattr(finite_volume, "_BLOCK", 17)
    assert face_measures(points, cells, rest) == whole


def test_facets_are_matched_as_one_by_one() -> None:
    for kind in CELL_KINDS:
        cells = box_mesh(kind, 5).cells
        sides: dict[tuple[int, ...], list[int]] = {}
        number = 0
        for block in cells:
            for nodes in block.nodes.tolist():
                for local in LOCAL_FACETS[block.type.name]:
                    sides.setdefault(tuple(sorted(nodes[k] for k in local)), []).append(number)
                number += 1
        facets = CellFacets.of(cells)
        inner = len(facets.neighbour)
        pairs = list(zip(facets.owner[:inner].tolist(), facets.neighbour.tolist(), strict=True))
        assert pairs == sorted(tuple(cells) for cells in sides.values() if len(cells) == 2)
        assert facets.owner[inner:].tolist() == sorted(cells[0] for cells in sides.values() if len(cells) == 1)
        for nodes, owner in zip(facets.nodes.tolist(), facets.owner.tolist(), strict=True):
            assert owner in sides[tuple(sorted(v for v in nodes if v >= 0))]


def test_meshes_without_faces_have_no_measures() -> None:
    assert face_measures(np.arange(3.0)[:, None], CellTable.from_arrays({"line": np.array([[0, 1], [1, 2]])})) is None
    single = measured(np.array([[0, 0], [1, 0], [0, 1]]), CellTable.from_arrays({"triangle": np.array([[0, 1, 2]])}))
    assert single.numbers() | {"max_skewness": 0} == {
        "faces": 0, "max_non_orthogonality": 0.0, "faces_above_65": 0, "faces_above_75": 0, "max_skewness": 0,
        "min_volume_ratio": 1.0, "shortest_edge": 1.0, "smallest_face": 1.0,
    }  # fmt: skip
    assert single.worst == ()


def checked(text: str, pattern: str) -> float:
    match = re.search(pattern, text)
    return float(match[1]) if match else 0.0


@pytest.mark.parametrize("kind", CELL_KINDS)
@pytest.mark.parametrize("share", [0.2, 0.36])
def test_the_numbers_are_those_of_checkmesh(tmp_path: Path, kind: str, share: float) -> None:
    points, cells = shaken(kind, share)
    case = foam.FoamCase.new(tmp_path)
    mesh = PolyMesh.from_cells(shaken(kind, 0.0)[0], cells, {"walls": np.arange(len(points))})
    moved = mesh.points.copy()
    moved[:, : cells.dimension] = np.tile(points, (mesh.copies, 1))
    write_polymesh(replace(mesh, points=moved), tmp_path)
    text = case.run("checkMesh", "-constant", "-allGeometry")
    found = measured(points, cells)
    printed = checked(text, r"non-orthogonality Max: ([\d.e+-]+)")
    assert found.max_non_orthogonality == pytest.approx(printed, rel=1e-9)
    plane = cells.dimension == 2
    all_angles = angles(extruded_points(points), extruded_cells(cells, len(points))) if plane else angles(points, cells)
    mean = np.degrees(np.arccos(np.cos(np.radians(all_angles)).mean()))
    assert mean == pytest.approx(checked(text, r"non-orthogonality Max: .* average: ([\d.e+-]+)"), rel=1e-9)
    severe = int(((all_angles > 70) & (all_angles < 90)).sum())
    assert severe == checked(text, r"severely non-orthogonal \(> 70 degrees\) faces: (\d+)")
    assert found.max_skewness == pytest.approx(checked(text, r"[Mm]ax skewness = ([\d.e+-]+)"), rel=1e-9)
    assert found.min_volume_ratio == pytest.approx(checked(text, r"volume ratio : minimum: ([\d.e+-]+)"), rel=1e-9)


def test_every_type_of_cell_with_faces_is_compared() -> None:
    compared = {name for kind in CELL_KINDS for name in kind.split(" + ")}
    assert compared == set(CELL_TYPES) - {"line"}
