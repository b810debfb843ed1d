"""AVS' unstructured cell data in text, as deal.II and Cubit use it. Materials of faces (in 2D: of lines) are patches.

https://dav.lbl.gov/archive/NERSC/Software/express/help6.1/help/reference/dvmac/UCD_Form.htm
"""

import re
from collections import defaultdict
from pathlib import Path

import numpy as np
from mesh_motion_numerics.arrays import Floats, Integers
from mesh_motion_numerics.mesh.cells import CELL_TYPES
from mesh_motion_protocol.errors import InvalidInput

from mesh_motion_server.files.format import Format
from mesh_motion_server.files.mesh_file import MeshFile, assemble_elements, by_name, named_groups
from mesh_motion_server.files.moved import edit_lines, move_rows
from mesh_motion_server.files.numbering import NumberedRows
from mesh_motion_server.files.text import integer, text_of

#: Our type, and the order of its corners: a pyramid begins with its tip.
_TYPES = {
    "line": ("line", [0, 1]), "tri": ("triangle", [0, 1, 2]), "quad": ("quad", [0, 1, 2, 3]),
    "tet": ("tetra", [0, 1, 2, 3]), "hex": ("hexahedron", list(range(8))), "prism": ("wedge", list(range(6))),
    "pyr": ("pyramid", [1, 2, 3, 4, 0]), "pt": ("", [0]),
}  # fmt: skip


def _counted(lines: list[str]) -> tuple[int, list[list[str]], list[list[str]]]:
    """The line of the first node, and the words of all nodes and of all cells."""
    head = next((place for place, line in enumerate(lines) if line.split() and not line.lstrip().startswith("#")), -1)
    n_nodes, n_cells = (integer(word) for word in lines[head].split()[:2])
    rows = [words for line in lines[head + 1 :] if (words := line.split()) and not words[0].startswith("#")]
    if len(rows) < n_nodes + n_cells:
        raise ValueError(f"{n_nodes} nodes and {n_cells} cells, but {len(rows)} rows follow")
    return head + 1, rows[:n_nodes], rows[n_nodes : n_nodes + n_cells]


def _read(path: Path) -> MeshFile:
    """Read a mesh. Raises InvalidInput for unknown types of cells, nodes that do not exist, and malformed rows."""
    try:
        _, nodes, cells = _counted([text_of(line) for line in path.read_bytes().splitlines()])
        rows = NumberedRows.of(np.array([integer(row[0]) for row in nodes], dtype=np.int64))
        points = np.array([row[1:4] for row in nodes], dtype=np.float64).reshape(-1, 3)
        found: dict[str, list[list[int]]] = defaultdict(list)
        for number, material, kind, *corners in cells:
            if kind not in _TYPES or len(corners) != len(_TYPES[kind][1]):
                raise ValueError(f"cell {number} is a {kind!r} of {len(corners)} nodes; known are {', '.join(_TYPES)}")
            found[kind].append([integer(material), *(integer(word) for word in corners)])
        elements = {name: np.array(listed, dtype=np.int64) for name, listed in found.items() if name != "pt"}
        return _mesh(path, points, elements, rows)
    except (ValueError, IndexError, OverflowError) as error:
        raise InvalidInput(f"{path}: malformed AVS UCD file: {error}") from None


def _mesh(path: Path, points: Floats, found: dict[str, Integers], rows: NumberedRows) -> MeshFile:
    """The mesh of the cells of each type: rows of a material and the numbers of the nodes."""
    dimension = max((CELL_TYPES[_TYPES[name][0]].dimension for name in found), default=0)
    elements: list[tuple[str, Integers]] = []
    groups: dict[tuple[int, int | str], list[Integers]] = defaultdict(list)
    for name, values in found.items():
        kind, order = _TYPES[name]
        nodes = rows(values[:, 1:], f"{name}: node")
        elements.append((kind, nodes[:, order]))
        if CELL_TYPES[kind].dimension == dimension - 1:
            for material in np.unique(values[:, 0]).tolist():
                groups[dimension - 1, material].append(nodes[values[:, 0] == material].ravel())
    patches, _ = by_name(named_groups({key: np.concatenate(parts) for key, parts in groups.items()}))
    return assemble_elements(path, points, elements, patches)


def _move(source: Path, target: Path, points: Floats) -> None:
    """Write the file with other coordinates of the nodes."""

    def change(lines: list[bytes]) -> None:
        first, *_ = _counted([text_of(line) for line in lines])
        move_rows(lines, first, points, column=1, comment=b"#")

    edit_lines(source, target, change)


_HEAD = rb"\A(\s|#.*\n)*\d+([ \t]+\d+){4}[ \t\r]*\n[ \t]*\d+([ \t]+[-+.\deE]+){3}[ \t\r]*\n"
UCD = Format("an AVS UCD file", (".inp", ".ucd"), re.compile(_HEAD), _read, move=_move)
