"""Cells that name a node twice, in every way that leaves a simpler cell."""

from itertools import pairwise, permutations
from pathlib import Path

import numpy as np
import pytest
from mesh_files import lists
from mesh_motion_numerics.mesh.local_facets import LOCAL_FACETS

from mesh_motion_server.files import read_mesh, write_mesh
from mesh_motion_server.files.collapsed import uncollapsed

CUBE = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]], float)
PRISM = CUBE[[0, 1, 3, 4, 5, 7]]


def volume(points: np.ndarray, cells: dict[str, np.ndarray]) -> float:
    """By the divergence theorem over the facets, each as a fan of triangles: negative for mirrored cells."""
    total = 0.0
    for name, nodes in cells.items():
        for cell in nodes:
            for facet in LOCAL_FACETS[name]:
                a, *rest = points[cell[list(facet)]]
                total += sum(np.linalg.det([a, b, c]) for b, c in pairwise(rest)) / 6
    return total


WAYS = [
    ("hexahedron", CUBE, {b: a, c: d}, "wedge", 1 / 2)
    for facet in LOCAL_FACETS["hexahedron"]
    for a, b, c, d in (facet, facet[1:] + facet[:1])
]
WAYS += [("hexahedron", CUBE, dict.fromkeys(facet, facet[0]), "pyramid", 1 / 3) for facet in LOCAL_FACETS["hexahedron"]]
WAYS += [
    ("hexahedron", CUBE, dict.fromkeys(facet, facet[0]) | {b: a}, "tetra", 1 / 6)
    for facet in LOCAL_FACETS["hexahedron"]
    for other in LOCAL_FACETS["hexahedron"]
    for a, b in zip(other, other[1:] + other[:1], strict=True)
    if not set(facet) & set(other)
]
WAYS += [("wedge", PRISM, {4: 3, 5: 3}, "tetra", 1 / 6), ("wedge", PRISM, {1: 0, 2: 0}, "tetra", 1 / 6)]
WAYS += [("wedge", PRISM, {k + 3: k}, "pyramid", 1 / 3) for k in range(3)]


@pytest.mark.parametrize(("name", "points", "to", "simple", "size"), WAYS)
def test_a_cell_that_collapses_is_the_simpler_one(
    name: str, points: np.ndarray, to: dict[int, int], simple: str, size: float
) -> None:
    nodes = np.array([[to.get(k, k) for k in range(len(points))], list(range(len(points)))])
    found, changed = uncollapsed({name: nodes})
    assert (changed, {kind: len(of) for kind, of in found.items()}) == (1, {name: 1, simple: 1})
    assert set(found[simple].ravel()) == set(nodes[0])
    assert volume(points, {simple: found[simple]}) == pytest.approx(size)


@pytest.mark.parametrize("nodes", sorted(set(permutations([0, 0, 1, 2]))))
def test_quadrilaterals_with_two_corners_at_one_place(nodes: tuple[int, ...]) -> None:
    """Neighbours that are one node leave a triangle; opposite corners leave nothing that is known."""
    found, changed = uncollapsed({"quad": np.array([nodes])})
    if nodes[0] == nodes[2] or nodes[1] == nodes[3]:
        assert (lists(found), changed) == ({"quad": [list(nodes)]}, 0)
    else:
        (triangle,) = found["triangle"].tolist()
        assert changed == 1
        assert sorted(triangle) == [0, 1, 2]
        assert "".join(map(str, triangle)) in "".join(map(str, dict.fromkeys(nodes))) * 2


def test_a_cell_with_seven_nodes_is_unchanged() -> None:
    nodes = np.array([[0, 1, 1, 3, 4, 5, 6, 7]])
    found, changed = uncollapsed({"hexahedron": nodes})
    assert (lists(found), changed) == ({"hexahedron": nodes.tolist()}, 0)


def test_a_deck_with_wedges_as_hexahedra(tmp_path: Path) -> None:
    """Abaqus allows it; the nodes are written back."""
    nodes = "".join(f"{k + 1}, {x}, {y}, {z}\n" for k, (x, y, z) in enumerate(CUBE.tolist()))
    (tmp_path / "m.inp").write_text(
        f"*NODE\n{nodes}*ELEMENT, TYPE=C3D8, ELSET=all\n1, 1, 2, 3, 3, 5, 6, 7, 7\n2, 1, 3, 4, 4, 5, 7, 8, 8\n"
        "*NSET, NSET=floor\n1, 2, 3, 4\n"
    )
    mesh = read_mesh(tmp_path / "m.inp")
    assert {name: len(nodes) for name, nodes in mesh.cells.items()} == {"wedge": 2}
    assert mesh.notes == ("2 cells name a node twice: they are read as cells of simpler types",)
    assert volume(mesh.points, mesh.cells) == pytest.approx(1.0)
    write_mesh(tmp_path / "moved.inp", mesh)
    assert read_mesh(tmp_path / "moved.inp").points.tolist() == CUBE.tolist()
