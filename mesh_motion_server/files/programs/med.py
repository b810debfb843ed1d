"""Salome's MED files: HDF5, read with h5py (extra ``mesh``). Groups of faces, edges and nodes become patches.

Elements and nodes have families, and a family has the names of its groups. Arrays have all values of one component,
then those of the next.

https://docs.salome-platform.org/latest/dev/MEDCoupling/developer/med-file.html
"""

import re
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from mesh_motion_numerics.arrays import Floats, Integers
from mesh_motion_numerics.mesh.cells import CELL_TYPES
from mesh_motion_protocol.errors import InvalidInput

from mesh_motion_server.files.format import Format
from mesh_motion_server.files.hdf5 import array_of, opened_hdf5, whole_of
from mesh_motion_server.files.mesh_file import MeshFile, assemble_elements, by_name, chosen_zone, concatenated
from mesh_motion_server.files.moved import copied_hdf5
from mesh_motion_server.files.text import text_of
from mesh_motion_server.files.vtk.grid import CellFaces
from mesh_motion_server.files.vtk.polyhedra import Numbered, simple_elements

#: Our type and the number of nodes for MED's types; types of higher order have their corners first.
_TYPES = {
    "PO1": ("", 1), "SE2": ("line", 2), "SE3": ("line", 3), "TR3": ("triangle", 3), "TR6": ("triangle", 6),
    "TR7": ("triangle", 7), "QU4": ("quad", 4), "QU8": ("quad", 8), "QU9": ("quad", 9), "TE4": ("tetra", 4),
    "T10": ("tetra", 10), "HE8": ("hexahedron", 8), "H20": ("hexahedron", 20), "H27": ("hexahedron", 27),
    "PE6": ("wedge", 6), "P15": ("wedge", 15), "PE15": ("wedge", 15), "P18": ("wedge", 18), "PY5": ("pyramid", 5),
    "P13": ("pyramid", 13),
}  # fmt: skip
_POLYGONS, _POLYHEDRA = "POG", "POE"
#: MED lists the first face of a 3D cell in the opposite direction: our corner k is its corner _CORNERS[type][k].
_CORNERS = {"tetra": (0, 2, 1, 3), "hexahedron": (0, 3, 2, 1, 4, 7, 6, 5), "wedge": (0, 2, 1, 3, 5, 4),
            "pyramid": (0, 3, 2, 1, 4)}  # fmt: skip


def _read(path: Path, zone: str = "") -> MeshFile:
    """Read a mesh from ``.med``; ``zone`` is the name or number of one of several meshes.

    Raises InvalidInput without h5py; for several meshes if none is chosen, structured ones, and damaged files; for
    polyhedra that cannot be divided.
    """
    with opened_hdf5(path, "MED file") as file:
        chosen = chosen_zone(path, list(file["ENS_MAA"]), zone)
        _require_simple(path, chosen, file[f"ENS_MAA/{chosen}"].attrs)
        mesh = _step(file, chosen)
        groups = _groups(path, file, chosen)
        points = _components(path, mesh["NOE/COO"], "f")
        of_nodes: dict[str, list[Integers]] = defaultdict(list)
        if "FAM" in mesh["NOE"]:
            for group, rows in _grouped(array_of(path, mesh["NOE/FAM"], "iu"), groups):
                of_nodes[group].append(rows)
        points, elements, node_groups = simple_elements(
            path,
            points,
            _elements(path, mesh, len(points)),
            **_faces(path, mesh, len(points)),
            groups=concatenated(of_nodes),
        )
        dimension = max((CELL_TYPES[name].dimension for name, *_ in elements if name), default=0)
        found: dict[str, list[tuple[int, Integers]]] = defaultdict(list)
        for group, nodes in node_groups.items():
            found[group].append((0, nodes))
        for name, nodes, families in elements:
            if not name or CELL_TYPES[name].dimension < dimension:
                for group, rows in _grouped(families, groups):
                    found[group].append((CELL_TYPES[name].dimension if name else 0, nodes[rows].ravel()))
        patches, notes = by_name(found)
        whole = assemble_elements(path, points, [(name, nodes) for name, nodes, _ in elements], patches)
        return replace(whole, zone=chosen, notes=(*whole.notes, *notes))


def _require_simple(path: Path, name: str, given: Any) -> None:
    """Refuse a structured mesh, and one in other than Cartesian coordinates."""
    if int(given.get("TYP", 0)) == 1:
        raise InvalidInput(
            f"{path}: the mesh {name!r} is structured",
            hint="write it as an unstructured one: buildUnstructured() of MEDCoupling",
        )
    if what := {1: "cylindrical", 2: "spherical"}.get(int(given.get("REP", 0))):
        raise InvalidInput(f"{path}: the coordinates of the mesh {name!r} are {what}", hint="write Cartesian ones")


def _step(file: Any, name: str) -> Any:
    """The group with nodes and elements: that of the first time step; before version 3 that of the mesh itself."""
    mesh = file[f"ENS_MAA/{name}"]
    if "NOE" not in mesh and not len(mesh):
        raise ValueError(f"the mesh {name!r} has no nodes")
    return mesh if "NOE" in mesh else mesh[min(mesh)]


def _components(path: Path, data: Any, kinds: str) -> Any:
    """(n, c) an array that is stored component by component."""
    count = int(data.attrs["NBR"])
    return array_of(path, data, kinds).reshape(-1, count).T


def _elements(path: Path, mesh: Any, n_points: int) -> list[Numbered]:
    """Our type, nodes (m, k) and families (m,) of the elements that are neither polygons nor polyhedra."""
    found = []
    for key in mesh.get("MAI", ()):
        if key in (_POLYGONS, _POLYHEDRA):
            continue
        if key not in _TYPES:
            way = "; MEDCoupling's convertQuadraticCellsToLinear makes polygons of them that are read" * (key == "PO2")
            raise ValueError(f"elements of type {key}; known are {', '.join(_TYPES)}, POG, POE{way}")
        name, count = _TYPES[key]
        nodes = _components(path, mesh[f"MAI/{key}/NOD"], "iu") - 1
        wrong = np.argwhere((nodes < 0) | (nodes >= n_points))
        if nodes.shape[1] != count or len(wrong):
            reason = f"names node {int(nodes[tuple(wrong[0])]) + 1}" if len(wrong) else f"has {nodes.shape[1]} nodes"
            raise ValueError(f"element {int(wrong[0, 0]) + 1 if len(wrong) else 1} of type {key} {reason}")
        if name in _CORNERS:
            nodes[:, : len(_CORNERS[name])] = nodes[:, _CORNERS[name]]
        found.append((name, nodes, _families(path, mesh[f"MAI/{key}"], len(nodes))))
    return found


def _families(path: Path, elements: Any, count: int) -> Integers:
    """(count,) the families of elements; 0 if they have none."""
    found: Integers = array_of(path, elements["FAM"], "iu") if "FAM" in elements else np.zeros(count, np.int64)
    if len(found) != count:
        raise ValueError(f"{count} elements, but {len(found)} numbers of families")
    return found


def _faces(path: Path, mesh: Any, n_points: int) -> dict[str, list[CellFaces]]:
    """The polygons, with their families, and the polyhedra."""
    found: dict[str, list[CellFaces]] = {"polygons": [], "polyhedra": []}
    for key, kind in ((_POLYGONS, "polygons"), (_POLYHEDRA, "polyhedra")):
        if key not in mesh.get("MAI", ()):
            continue
        elements = mesh[f"MAI/{key}"]
        nodes, sizes = array_of(path, elements["NOD"], "iu") - 1, np.diff(array_of(path, elements["INN"], "iu"))
        wrong = np.flatnonzero((nodes < 0) | (nodes >= n_points))
        if len(wrong):
            raise ValueError(f"elements of type {key} name node {int(nodes[wrong[0]]) + 1}; the last one is {n_points}")
        counts = np.diff(array_of(path, elements["IFN"], "iu")) if key == _POLYHEDRA else np.ones(len(sizes), np.int64)
        faces = CellFaces.of_counts(nodes, sizes, counts)
        if key == _POLYGONS:
            faces = replace(faces, cells=_families(path, elements, len(sizes)))
        found[kind].append(faces)
    return found


def _grouped(families: Integers, groups: dict[int, list[str]]) -> Iterator[tuple[str, Integers]]:
    """The groups of the ``families`` (m,) of nodes or elements, and the rows that are in them."""
    for family in np.unique(families).tolist():
        for group in groups.get(family, ()):
            yield group, np.flatnonzero(families == family)


def _groups(path: Path, file: Any, mesh: str) -> dict[int, list[str]]:
    """{number of a family: names of its groups}."""
    found: dict[int, list[str]] = {}
    for kind in ("ELEME", "NOEUD"):
        families = file.get(f"FAS/{mesh}/{kind}", {})
        for family in families.values():
            names = list(whole_of(path, family["GRO/NOM"])) if "GRO/NOM" in family else []
            found[int(family.attrs["NUM"])] = [
                text_of(np.asarray(name).tobytes().split(b"\0")[0]).strip() for name in names
            ]
    return found


def _move(source: Path, target: Path, points: Floats, zone: str) -> None:
    """Write the file with other coordinates of one mesh's nodes."""
    with opened_hdf5(source, "MED file") as file:
        chosen = chosen_zone(source, list(file["ENS_MAA"]), zone)
    with copied_hdf5(source, target) as file:
        data = _step(file, chosen)["NOE/COO"]
        columns = data[()].reshape(-1, int(data.attrs["NBR"]))
        columns[: points.shape[1]] = points[: columns.shape[1]].T
        data[...] = columns.reshape(data.shape)


MED = Format("a MED mesh", (".med", ".rmed"), re.compile(rb"\A\x89HDF"), _read, True, _move)
