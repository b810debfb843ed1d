from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from mesh_files import one_line
from mesh_motion_protocol.errors import InvalidInput

from mesh_motion_server.files import read_mesh, write_mesh

REFERENCES = Path(__file__).parents[1] / "references"

SQUARE = """% two triangles and a quad, element and node numbers at the ends as older writers leave them
NDIME= 2
NELEM= 3
5 0 1 4 0
5 0 4 3 1
9 1 2 5 4 2
NPOIN= 6 6
0.0 0.0 0
0.5 0.0 1
1.0 0.0 2   % a comment
0.0 1.0 3
0.5 1.0 4
1.0 1.0 5
NMARK= 3
MARKER_TAG= lower wall
MARKER_ELEMS= 2
3 0 1
3 1 2
MARKER_TAG= far
MARKER_ELEMS= 1
3 2 5
SEND_RECV= 0
MARKER_TAG= pin
MARKER_ELEMS= 1
1 3
"""


def su2(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "mesh.su2"
    path.write_text(text)
    return path


def test_markers_keep_their_names(tmp_path: Path) -> None:
    mesh = read_mesh(su2(tmp_path, SQUARE))
    assert {name: list(nodes) for name, nodes in mesh.patches.items()} == {
        "lower wall": [0, 1, 2],
        "far": [2, 5],
        "pin": [3],
    }
    np.testing.assert_array_equal(mesh.cells["triangle"], [[0, 1, 4], [0, 4, 3]])
    np.testing.assert_array_equal(mesh.cells["quad"], [[1, 2, 5, 4]])
    np.testing.assert_array_equal(mesh.points[4], [0.5, 1.0])


def test_three_dimensions_and_every_cell_type(
    tmp_path: Path, all_solids: tuple[np.ndarray, dict[str, np.ndarray]]
) -> None:
    points, cells = all_solids
    codes = {"tetra": 10, "hexahedron": 12, "wedge": 13, "pyramid": 14}
    rows = [f"{codes[name]} {' '.join(map(str, row))}" for name, nodes in cells.items() for row in nodes]
    text = f"NDIME= 3\nNPOIN= {len(points)}\n" + "\n".join(" ".join(map(repr, map(float, p))) for p in points)
    text += f"\nNELEM= {len(rows)}\n" + "\n".join(rows) + "\nNMARK= 1\nMARKER_TAG= base\nMARKER_ELEMS= 1\n9 0 3 2 1\n"
    mesh = read_mesh(su2(tmp_path, text))
    np.testing.assert_array_equal(mesh.points, points)
    assert set(mesh.cells) == set(cells)
    for name, nodes in cells.items():
        np.testing.assert_array_equal(mesh.cells[name], nodes)
    np.testing.assert_array_equal(mesh.patches["base"], [0, 1, 2, 3])


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("NDIME= 2", "NDIME= two", "malformed"),
        ("NDIME= 2", "NDIME= 200000000000", "expected 2 or 3"),
        ("NELEM= 3", "NELEM= 300", "only"),
        ("5 0 1 4 0", "5 0 1", "'5 0 1': 3 numbers, expected 4"),
        ("5 0 1 4 0", "5 0 1.5 4 0", "'5 0 1.5 4 0': could not convert string '1.5'"),
        ("5 0 1 4 0", "22 0 1 4 0", r"element type 22 .* \(Gmsh: Mesh.ElementOrder = 1\)"),
        ("5 0 1 4 0", "5 0 1 9 0", "row 0 names node 9"),
        ("0.5 1.0 4", "0.5 one 4", "'0.5 one 4': could not convert string 'one'"),
        ("0.5 1.0 4", "0.5 nan 4", "node 4 has y = nan"),
        ("MARKER_ELEMS= 2", "MARKER_ELEMS= 3", "MARKERELEMS= 3, but only 2 rows"),
    ],
)
def test_damaged_files_give_one_clear_line(tmp_path: Path, old: str, new: str, message: str) -> None:
    one_line(su2(tmp_path, SQUARE.replace(old, new)), message)


def with_rows(text: str, *changes: tuple[str, str]) -> str:
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    return text


def test_variants_that_solvers_accept_are_read(tmp_path: Path) -> None:
    """Other spellings, blanks, missing numbers, boxes that deform, markers without a name or without elements."""
    text = with_rows(
        SQUARE,
        ("NDIME= 2", "NDIME  =2\n\n   % nothing"),
        ("5 0 1 4 0\n", "  5\t0  1   4\n"),
        ("0.0 1.0 3\n", "0.0 1.0\n"),
        ("MARKER_TAG= far", "MARKERTAG=  "),
        ("NMARK= 3", "NMARK= 4\nMARKER_TAG= empty\nMARKER_ELEMS= 0\nSEND_RECV= 0"),
    )
    text += "FFD_NBOX= 1\nFFD_TAG= BOX\nFFD_CORNER_POINTS= 2\n0.0 0.0\n1.0 1.0\nNPERIODIC= 1\n0.0 0.0 0.0\n"
    mesh, plain = read_mesh(su2(tmp_path, text)), read_mesh(su2(tmp_path, SQUARE))
    np.testing.assert_array_equal(mesh.points, plain.points)
    np.testing.assert_array_equal(mesh.cells["triangle"], plain.cells["triangle"])
    assert list(mesh.patches) == ["lower wall", "unnamed", "pin"]
    np.testing.assert_array_equal(mesh.patches["unnamed"], plain.patches["far"])
    assert mesh.notes == (
        "marker 'empty' has no elements: it is not a patch",
        "a marker without a name becomes the patch 'unnamed'",
    )


def test_markers_of_older_releases_are_no_patches(tmp_path: Path) -> None:
    text = with_rows(SQUARE, ("NPOIN= 6 6", "NPOIN= 6\t5"), ("NMARK= 3", "NMARK= 4"))
    text += "MARKER_TAG= SEND_RECEIVE\nMARKER_ELEMS= 1\nSEND_TO= 1\n1 2 1\n"
    mesh = read_mesh(su2(tmp_path, text))
    assert (len(mesh.points), list(mesh.patches)) == (6, ["lower wall", "far", "pin"])


def zones(tmp_path: Path) -> Path:
    """The square twice, the second one at another place."""
    other = with_rows(SQUARE, ("0.0 0.0 0", "0.0 -7.0 0"))
    return su2(tmp_path, f"NZONE= 2\nIZONE= 1\n{SQUARE}\nIZONE= 2\n{other}")


def test_one_zone_of_several_is_chosen(tmp_path: Path) -> None:
    path = zones(tmp_path)
    one_line(path, r"mesh\.su2: 2 zones: 1, 2 \(choose one: zone = ")
    with pytest.raises(InvalidInput, match=r"no zone '3'; 2 zones: 1, 2"):
        read_mesh(path, "3")
    assert [read_mesh(path, zone).points[0, 1] for zone in ("1", "2")] == [0.0, -7.0]
    with pytest.raises(InvalidInput, match="a NumPy archive has no zones"):
        read_mesh(REFERENCES / "thesis_slab.npz", "1")


@pytest.mark.parametrize(
    ("line", "other", "message"),
    [
        ("NELEM= 3", "NELEM= 2", "NELEM= 2, but 3 rows follow"),
        ("NPOIN= 6 6", "NPOIN= 5", "NPOIN= 5, but 6 rows follow"),
        ("MARKER_ELEMS= 2", "MARKER_ELEMS= 1", "MARKERELEMS= 1, but 2 rows follow"),
        ("NMARK= 3", "NMARK= 4", "1 markers less than its NMARK announces"),
        ("NMARK= 3", "NELEM= 1\n5 0 1 4\nNMARK= 3", "NELEM= appears twice"),
        ("NDIME= 2", "NZONE= 2\nIZONE= 1\nNDIME= 2", "NZONE= 2, but only 1 follow"),
    ],
)
def test_nothing_that_the_counts_leave_out_is_dropped(tmp_path: Path, line: str, other: str, message: str) -> None:
    assert SQUARE.count(line + "\n") == 1
    with pytest.raises(InvalidInput, match=message):
        read_mesh(su2(tmp_path, SQUARE.replace(line + "\n", other + "\n")))


def test_one_zone_comes_back_with_moved_nodes(tmp_path: Path) -> None:
    """The other zone, comments and numbers at the ends of rows stay."""
    path = zones(tmp_path)
    mesh = read_mesh(path, "2")
    write_mesh(tmp_path / "moved.su2", replace(mesh, points=mesh.points / 3))
    np.testing.assert_array_equal(read_mesh(tmp_path / "moved.su2", "2").points, mesh.points / 3)
    np.testing.assert_array_equal(read_mesh(tmp_path / "moved.su2", "1").points, read_mesh(path, "1").points)
    write_mesh(tmp_path / "back.su2", mesh)
    assert (tmp_path / "back.su2").read_text().split() == path.read_text().split()
