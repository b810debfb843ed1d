"""The same mesh in the files of many programs: a box of eight hexahedra with the patches wall, far and sides."""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from frame_meshes import tensor_grid
from mesh_motion_numerics.mesh.local_facets import LOCAL_FACETS
from numpy.typing import NDArray

from mesh_motion_server.files import MeshFile, write_mesh
from mesh_motion_server.files.sides import ABAQUS, EXODUS

Ints = NDArray[np.int64]
N = 3


def box() -> tuple[NDArray[np.float64], Ints]:
    """Points (27, 3), which fill no straight lines, and cells (8, 8)."""
    points, cells = tensor_grid(*[np.linspace(0.0, 1.0, N)] * 3)
    x, y, z = points.T
    bulge = 0.03 * np.sin(3 * x + 5 * y + 7 * z) * x * (1 - x) * y * (1 - y) * z * (1 - z)
    return 0.7 * (points + bulge[:, None] / 3), cells


POINTS, CELLS = box()


@dataclass
class Face:
    """A face: nodes, with the normal out of the first cell; the cells, -1 for none; the patch, "" for an inner face."""

    nodes: list[int]
    cells: tuple[int, int]
    patch: str
    local: int


def _faces() -> list[Face]:
    found: dict[tuple[int, ...], Face] = {}
    for cell, local in product(range(len(CELLS)), range(6)):
        nodes = CELLS[cell][list(LOCAL_FACETS["hexahedron"][local])]
        key = tuple(sorted(nodes.tolist()))
        if key in found:
            found[key].cells = (found[key].cells[0], cell)
            found[key].patch = ""
        else:
            z = POINTS[nodes, 2]
            patch = "wall" if (z == 0.0).all() else "far" if (z == 0.7).all() else "sides"
            found[key] = Face(nodes.tolist(), (cell, -1), patch, local)
    return sorted(found.values(), key=lambda face: face.patch)


FACES = _faces()
PATCHES = {name: np.unique([face.nodes for face in FACES if face.patch == name]) for name in ("far", "sides", "wall")}


def rows(values: object, form: str = "%r", separator: str = " ", first: int | None = None) -> str:
    lines = [separator.join(form % value for value in row) for row in np.asarray(values).tolist()]
    if first is not None:
        lines = [f"{number}{separator}{line}" for number, line in enumerate(lines, start=first)]
    return "\n".join(lines) + "\n"


def fluent(path: Path) -> None:
    zones, begin = "", 1
    numbers = {"": (2, 7), "far": (9, 3), "sides": (7, 4), "wall": (3, 5)}  # bc-type and zone of each patch
    for name, (kind, zone) in numbers.items():
        own = [face for face in FACES if face.patch == name]
        lines = "".join(
            " ".join(f"{v:x}" for v in [*(n + 1 for n in face.nodes[::-1]), face.cells[0] + 1, face.cells[1] + 1])
            + "\n"
            for face in own
        )
        zones += f"(13 ({zone:x} {begin:x} {begin + len(own) - 1:x} {kind:x} 4)(\n{lines}))\n"
        begin += len(own)
    path.write_text(
        f'(0 "made :-) (by hand)")\n(2 3)\n(10 (0 1 {N**3:x} 0 3))\n(10 (1 1 {N**3:x} 1 3)(\n{rows(POINTS)}))\n'
        f"(12 (0 1 8 0))\n(12 (2 1 8 1 4))\n(13 (0 1 {len(FACES):x} 0))\n{zones}"
        "(39 (7 interior inside 1)())\n(45 (3 pressure-far-field far 1)())\n(45 (4 symmetry sides 1)())\n"
        "(45 (5 wall wall 1)())\n(45 (2 fluid air 1)())\n"
    )


def fluent_binary(path: Path) -> None:
    """The same with nodes and faces in binary, one zone of faces of any size; the partitions have the byte of "("."""
    fluent(path)
    text = path.read_bytes()
    begin, end = text.index(b"(10 (1"), text.index(b"(12 (0")
    text = (
        text[:begin]
        + b"(3010 (1 1 %x 1 3)(" % N**3
        + POINTS.tobytes()
        + b")\nEnd of Binary Section   3010)\n"
        + text[end:]
    )
    for name, zone, size in (("wall", 5, []), ("sides", 4, [4])):
        begin = text.index(b"(13 (%x " % zone)
        body = text.index(b"(\n", begin)
        end = text.index(b"))\n", begin) + 3
        faces = [face for face in FACES if face.patch == name]
        packed = np.array(
            [[*size, *(n + 1 for n in of.nodes[::-1]), of.cells[0] + 1, 0] for of in faces], "<i4"
        ).tobytes()
        head = text[begin:body].replace(b"(13", b"(2013")
        head = head.replace(b" 4)", b" 0)") if size else head
        text = text[:begin] + head + b"(" + packed + b")\nEnd of Binary Section   2013)\n" + text[end:]
    partitions = np.full(8, ord("("), "<i4").tobytes()
    path.write_bytes(text + b"(2040 (2 1 8 1)(" + partitions + b")\nEnd of Binary Section   2040)\n")


def fluent_hdf5(path: Path) -> None:
    """Fluent's .msh.h5."""
    h5py = pytest.importorskip("h5py")

    with h5py.File(path, "w") as file:
        mesh = file.create_group("meshes/1")
        mesh.attrs.update(dimension=np.array([3], np.uint64), nodeCount=np.array([N**3], np.uint64))
        coords = mesh.create_dataset("nodes/coords/1", data=POINTS)
        nodes = mesh.create_group("faces/nodes/1")
        nodes["nnodes"] = np.full(len(FACES), 4, np.int16)
        nodes["nodes"] = np.array([n + 1 for face in FACES for n in face.nodes[::-1]], np.uint32)
        inner = sum(face.patch == "" for face in FACES)
        c0 = mesh.create_dataset("faces/c0/1", data=np.array([face.cells[0] + 1 for face in FACES], np.uint32))
        c1 = mesh.create_dataset("faces/c1/1", data=np.array([face.cells[1] + 1 for face in FACES[:inner]], np.uint32))
        for part, last in ((coords, N**3), (nodes, len(FACES)), (c0, len(FACES)), (c1, inner)):
            part.attrs.update(minId=np.array([1], np.uint64), maxId=np.array([last], np.uint64))
        names = ["", "far", "sides", "wall"]
        ends = np.cumsum([sum(face.patch == name for face in FACES) for name in names])
        zones = mesh.create_group("faces/zoneTopology")
        zones["id"], zones["zoneType"] = np.array([7, 3, 4, 5], np.int32), np.array([2, 9, 7, 3], np.int32)
        zones["minId"], zones["maxId"] = np.array([1, *(ends[:-1] + 1)], np.uint64), ends.astype(np.uint64)
        zones["name"] = np.array([b"inside;far;sides;wall"])


def med(path: Path) -> None:
    """MED 4 as Salome writes it: component by component, families with groups."""
    h5py = pytest.importorskip("h5py")
    names = list(PATCHES)
    with h5py.File(path, "w") as file:
        mesh = file.create_group("ENS_MAA/box")
        step = mesh.create_group("-0000000000000000001-0000000000000000001")
        step.create_dataset("NOE/COO", data=POINTS.T.ravel()).attrs["NBR"] = N**3
        step["NOE/FAM"] = np.zeros(N**3, np.int32)
        corners = CELLS[:, [0, 3, 2, 1, 4, 7, 6, 5]]
        step.create_dataset("MAI/HE8/NOD", data=corners.T.ravel() + 1).attrs["NBR"] = 8
        outer = [face for face in FACES if face.patch]
        quads = np.array([face.nodes for face in outer])
        step.create_dataset("MAI/QU4/NOD", data=quads.T.ravel() + 1).attrs["NBR"] = len(quads)
        step["MAI/QU4/FAM"] = np.array([-1 - names.index(face.patch) for face in outer], np.int32)
        for number, name in enumerate(names):
            family = file.create_group(f"FAS/box/ELEME/FAM_{-1 - number}_{name}")
            family.attrs["NUM"] = -1 - number
            family["GRO/NOM"] = np.frombuffer(name.encode().ljust(80, b"\0"), np.int8)[None]


def exodus(path: Path) -> None:
    """Exodus as Cubit writes it: side sets of the three patches, by their names."""
    from scipy.io import netcdf_file  # noqa: PLC0415

    numbers = {frozenset(corners): side for side, corners in enumerate(EXODUS.corners["hexahedron"], start=1)}
    with netcdf_file(path, "w", version=2) as file:
        sizes = {"num_dim": 3, "num_nodes": N**3, "num_elem": 8, "num_el_blk": 1, "num_el_in_blk1": 8, "len_name": 33}
        for name, size in (sizes | {"num_nod_per_el1": 8, "num_side_sets": 3}).items():
            file.createDimension(name, size)
        file.title, file.version, file.api_version = "box", np.float32(8.03), np.float32(8.03)
        file.floating_point_word_size, file.file_size = np.int32(8), np.int32(1)
        for kind, count, size in (("eb", 1, "num_el_blk"), ("ss", 3, "num_side_sets")):
            file.createVariable(f"{kind}_status", "i", (size,))[:] = 1
            prop = file.createVariable(f"{kind}_prop1", "i", (size,))
            prop[:] = 1 + np.arange(count)
            prop.name = "ID"
        for axis, column in zip("xyz", POINTS.T, strict=True):
            file.createVariable(f"coord{axis}", "d", ("num_nodes",))[:] = column
        connect = file.createVariable("connect1", "i", ("num_el_in_blk1", "num_nod_per_el1"))
        connect[:] = CELLS + 1
        connect.elem_type = "HEX8"
        names = file.createVariable("ss_names", "c", ("num_side_sets", "len_name"))
        for number, name in enumerate(PATCHES, start=1):
            names[number - 1] = np.frombuffer(name.encode().ljust(33, b"\0"), "S1")
            own = [face for face in FACES if face.patch == name]
            file.createDimension(f"num_side_ss{number}", len(own))
            local = [frozenset(1 + CELLS[face.cells[0]].tolist().index(node) for node in face.nodes) for face in own]
            for what, values in (
                ("elem", [face.cells[0] + 1 for face in own]),
                ("side", [numbers[key] for key in local]),
            ):
                file.createVariable(f"{what}_ss{number}", "i", (f"num_side_ss{number}",))[:] = values


def exodus_hdf5(path: Path) -> None:
    """The same in netCDF-4, which is HDF5."""
    h5py = pytest.importorskip("h5py")
    from scipy.io import netcdf_file  # noqa: PLC0415

    exodus(path)
    with netcdf_file(path, "r", mmap=False) as old:
        content = {name: (of[:].copy(), getattr(of, "elem_type", b"")) for name, of in old.variables.items()}
    with h5py.File(path, "w") as file:
        for name, (values, kind) in content.items():
            file[name] = values
            if kind:
                file[name].attrs["elem_type"] = kind


def abaqus(path: Path) -> None:
    """An input of CalculiX: a surface by sides, a set of nodes, a set of faces; the set of all nodes is not a patch."""
    numbers = {frozenset(corners): side for side, corners in enumerate(ABAQUS.corners["hexahedron"], start=1)}
    wall = ""
    for face in FACES:
        if face.patch == "wall":
            side = numbers[frozenset(1 + CELLS[face.cells[0]].tolist().index(node) for node in face.nodes)]
            wall += f"{face.cells[0] + 1}, S{side}\n"
    far = rows([face.nodes + np.array(1) for face in FACES if face.patch == "far"], separator=", ", first=101)
    sides = "".join(f"{node + 1},\n" for node in PATCHES["sides"])
    path.write_text(
        f"*HEADING\nbox\n** nodes\n*Node, NSET=Nall\n{rows(POINTS, separator=', ', first=1)}"
        f"*ELEMENT, TYPE=C3D8, ELSET=Eall\n{rows(CELLS + 1, separator=', ', first=1)}"
        f"*ELEMENT, TYPE=S4,\nELSET=far\n{far}*NSET, NSET=sides\n{sides}*SURFACE, NAME=wall, TYPE=ELEMENT\n{wall}"
        "*MATERIAL, NAME=air\n*STEP\n*END STEP\n"
    )


def kratos(path: Path) -> None:
    """Kratos' format, with parts of conditions, of nodes, and the fluid itself."""
    outer = [face for face in FACES if face.patch]
    parts = ""
    for name, nodes in PATCHES.items():
        listed = "".join(f"{node + 1}\n" for node in nodes) if name != "wall" else ""
        own = "".join(f"{k}\n" for k, face in enumerate(outer, start=1) if face.patch == name)
        parts += f"Begin SubModelPart {name}\n  Begin SubModelPartNodes\n{listed}End SubModelPartNodes\n"
        parts += f"  Begin SubModelPartConditions\n{own}End SubModelPartConditions\nEnd SubModelPart\n"
    path.write_text(
        "Begin ModelPartData\nEnd ModelPartData\nBegin Properties 0\nEnd Properties\n"
        f"Begin Nodes // number x y z\n{rows(POINTS, first=1)}End Nodes\n"
        f"Begin Elements Element3D8N\n{rows(np.pad(CELLS + 1, ((0, 0), (1, 0))), first=1)}End Elements\n"
        "Begin Conditions SurfaceCondition3D4N\n"
        f"{rows([[0, *(node + 1 for node in face.nodes)] for face in outer], first=1)}End Conditions\n"
        f"Begin SubModelPart fluid\nBegin SubModelPartElements\n1\n2\nEnd SubModelPartElements\n"
        f"End SubModelPart\n{parts}"
    )


def elmer(path: Path) -> None:
    path.mkdir()
    outer = [face for face in FACES if face.patch]
    names = list(PATCHES)
    (path / "mesh.header").write_text(f"{N**3} 8 {len(outer)}\n2\n808 8\n404 {len(outer)}\n")
    (path / "mesh.nodes").write_text(
        "".join(f"{k} -1 {x!r} {y!r} {z!r}\n" for k, (x, y, z) in enumerate(POINTS.tolist(), 1))
    )
    (path / "mesh.elements").write_text(rows([[1, 808, *cell] for cell in CELLS + 1], first=1))
    boundary = [
        [1 + names.index(face.patch), face.cells[0] + 1, 0, 404, *(n + 1 for n in face.nodes)] for face in outer
    ]
    (path / "mesh.boundary").write_text(rows(boundary, first=1))
    listed = "".join(f"$ {name} = {k}\n" for k, name in enumerate(names, start=1))
    (path / "mesh.names").write_text(
        f"! ----- names for bodies -----\n$ air = 1\n! ----- names for boundaries -----\n{listed}"
    )


def cgns(path: Path) -> None:
    """CGNS as Pointwise writes it: one zone, and sections of faces whose elements the boundary conditions name."""
    pytest.importorskip("h5py")
    from cgns_files import add_cells, add_node, new_cgns  # noqa: PLC0415 - it needs h5py

    with new_cgns(path) as root:
        base = add_node(root, "Base", "CGNSBase_t", np.array([3, 3]))
        zone = add_node(base, "Zone", "Zone_t", np.array([[N**3], [len(CELLS)], [0]]))
        add_node(zone, "ZoneType", "ZoneType_t", "Unstructured")
        grid = add_node(zone, "GridCoordinates", "GridCoordinates_t")
        for axis, values in zip("XYZ", POINTS.T, strict=True):
            add_node(grid, f"Coordinate{axis}", "DataArray_t", np.ascontiguousarray(values))
        outer = [face for face in FACES if face.patch]
        add_cells(zone, {"hexahedron": CELLS, "quad": np.array([face.nodes for face in outer])})
        conditions = add_node(zone, "ZoneBC", "ZoneBC_t")
        for name in PATCHES:
            rows_of = [[9 + k for k, face in enumerate(outer) if face.patch == name]]
            bc = add_node(conditions, name, "BC_t", "BCWall")
            add_node(bc, "PointList", "IndexArray_t", np.array(rows_of))
            add_node(bc, "GridLocation", "GridLocation_t", "FaceCenter")


def vtk(path: Path) -> None:
    marks = "".join(
        f"patch_{name} 1 {N**3} int\n{rows(np.isin(np.arange(N**3), nodes).astype(int).reshape(-1, 1))}"
        for name, nodes in PATCHES.items()
    )
    path.write_text(
        f"# vtk DataFile Version 3.0\nbox\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS {N**3} double\n{rows(POINTS)}"
        f"CELLS 8 72\n{rows([[8, *cell] for cell in CELLS.tolist()])}CELL_TYPES 8\n{rows([[12]] * 8)}"
        f"POINT_DATA {N**3}\nFIELD FieldData 3\n{marks}"
    )


def vtkhdf(path: Path) -> None:
    """VTK's HDF5 of one part, with the points of a second step."""
    h5py = pytest.importorskip("h5py")
    with h5py.File(path, "w") as file:
        root = file.create_group("VTKHDF")
        root.attrs.update(Type=np.bytes_("UnstructuredGrid"), Version=[2, 3])
        for name, count in (("Points", N**3), ("Cells", len(CELLS)), ("ConnectivityIds", CELLS.size)):
            root[f"NumberOf{name}"] = [count]
        root["Points"], root["Types"] = np.concatenate([POINTS, 2 * POINTS]), np.full(len(CELLS), 12, np.uint8)
        root["Connectivity"], root["Offsets"] = CELLS.ravel(), 8 * np.arange(len(CELLS) + 1)
        for name, nodes in PATCHES.items():
            root[f"PointData/patch_{name}"] = np.isin(np.arange(N**3), nodes).astype(np.int8)
        steps = root.create_group("Steps")
        steps.attrs["NSteps"] = 2
        steps["Values"], steps["NumberOfParts"], steps["PointOffsets"] = [0.0, 1.0], [1, 1], [0, N**3]
        steps["PartOffsets"], steps["CellOffsets"], steps["ConnectivityIdOffsets"] = [0, 0], [[0], [0]], [[0], [0]]
        for name in PATCHES:
            steps[f"PointDataOffsets/patch_{name}"] = [0, 0]


def own(path: Path) -> None:
    write_mesh(path, MeshFile(POINTS, {"hexahedron": CELLS}, PATCHES, path))


def su2(path: Path) -> None:
    markers = "".join(
        f"MARKER_TAG= {name}\nMARKER_ELEMS= {len(of)}\n{rows([[9, *face.nodes] for face in of])}"
        for name in PATCHES
        for of in [[face for face in FACES if face.patch == name]]
    )
    points = "".join(f"{line} {k}\n" for k, line in enumerate(rows(POINTS).splitlines()))
    path.write_text(
        f"NDIME= 3\nNELEM= 8\n{rows([[12, *cell, k] for k, cell in enumerate(CELLS.tolist())])}"
        f"NPOIN= {N**3}\n{points}NMARK= 3\n{markers}"
    )


def gmsh(path: Path) -> None:
    outer = [face for face in FACES if face.patch]
    names = list(PATCHES)
    listed = [[3, 2, 1 + names.index(face.patch), 1, *(n + 1 for n in face.nodes)] for face in outer]
    listed += [[5, 2, 9, 1, *(n + 1 for n in cell)] for cell in CELLS.tolist()]
    elements = "".join(f"{k} {' '.join(map(str, row))}\n" for k, row in enumerate(listed, start=1))
    physical = "".join(f'2 {k} "{name}"\n' for k, name in enumerate(names, start=1))
    path.write_text(
        f'$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$PhysicalNames\n4\n{physical}3 9 "air"\n$EndPhysicalNames\n'
        f"$Nodes\n{N**3}\n{rows(POINTS, first=1)}$EndNodes\n$Elements\n{len(listed)}\n{elements}$EndElements\n"
    )


def foam(path: Path) -> None:
    path.mkdir()
    inner = sum(not face.patch for face in FACES)
    begin = np.cumsum([inner, *(sum(face.patch == name for face in FACES) for name in PATCHES)])
    patches = "".join(
        f"{name} {{ type patch; nFaces {end - first}; startFace {first}; }}\n"
        for name, first, end in zip(PATCHES, begin, begin[1:], strict=False)
    )
    points = "".join(f"({line})\n" for line in rows(POINTS).splitlines())
    faces = "".join(f"4({' '.join(map(str, face.nodes))})\n" for face in FACES)
    for name, kind, body in (
        ("points", "vectorField", f"{N**3}\n(\n{points})\n"),
        ("faces", "faceList", f"{len(FACES)}\n(\n{faces})\n"),
        ("owner", "labelList", f"{len(FACES)}\n(\n{rows([[face.cells[0]] for face in FACES])})\n"),
        ("neighbour", "labelList", f"{inner}\n(\n{rows([[face.cells[1]] for face in FACES[:inner]])})\n"),
        ("boundary", "polyBoundaryMesh", f"3\n(\n{patches})\n"),
    ):
        head = f'FoamFile {{ version 2.0; format ascii; class {kind}; note "{{of}} a }} box;"; object {name}; }}\n'
        (path / name).write_text(head + body)


def universal(path: Path) -> None:
    """A file like those of Salome: a group of faces, one of nodes, one of both kinds, one of the cells; edges as
    Cubit.
    """
    nodes = "".join(
        f"{k:10}{1:10}{1:10}{11:10}\n" + "".join(f"{v:25.16E}".replace("E", "D") for v in xyz) + "\n"
        for k, xyz in enumerate(POINTS.tolist(), start=1)
    )
    outer = [face for face in FACES if face.patch]
    listed = [(94, face.nodes) for face in outer] + [(115, cell) for cell in CELLS.tolist()] + [(171, CELLS[0][:2])]
    elements = "".join(
        "".join(f"{v:10}" for v in (number, code, 2, 1, 7, len(own)))
        + "\n"
        + "".join(f"{v + 1:10}" for v in own)
        + "\n"
        for number, (code, own) in enumerate(listed, start=101)
    )
    groups = {"fluid": [(8, 101 + len(outer) + k) for k in range(len(CELLS))]}
    for name, of in PATCHES.items():
        faces = [(8, number) for number, face in enumerate(outer, start=101) if face.patch == name]
        groups[name] = [(7, node + 1) for node in of.tolist()] if name == "sides" else faces
    groups["wall"].append((7, int(PATCHES["wall"][0]) + 1))
    text = ""
    for number, (name, members) in enumerate(groups.items(), start=1):
        text += "".join(f"{v:10}" for v in (number, 0, 0, 0, 0, 0, 0, len(members))) + f"\n{name}\n"
        rows = [members[k : k + 2] for k in range(0, len(members), 2)]
        text += "".join("".join(f"{kind:10}{tag:10}{0:10}{0:10}" for kind, tag in row) + "\n" for row in rows)
    parts = ((151, "box\n"), (164, "         1  SI: Meter (newton)         2\n"), (2411, nodes), (2412, elements))
    path.write_text("".join(f"    -1\n{number:6}\n{body}    -1\n" for number, body in (*parts, (2467, text))))


def mfem(path: Path) -> None:
    """MFEM's format, version 1.3: the patches are sets of attributes, one with a name without quotes."""
    outer = [face for face in FACES if face.patch]
    numbers = {"far": 4, "sides": 2, "wall": 7}
    cells = rows([[1, 5, *cell] for cell in CELLS.tolist()])
    boundary = rows([[numbers[face.patch], 3, *face.nodes] for face in outer])
    path.write_text(
        "MFEM mesh v1.3\n\n#\n# MFEM Geometry Types: CUBE = 5\n#\n\ndimension\n3\n\n"
        f'elements\n8\n{cells}\nattribute_sets\n1\n"air"\n1\n1\n\nboundary\n{len(outer)}\n{boundary}\n'
        'bdr_attribute_sets\n3\n"far"\n1\n4\n"sides"\n1\n2\nwall\n1\n7\n\n'
        f"vertices\n{N**3}\n3\n{rows(POINTS)}\nmfem_mesh_end\n"
    )


def mfem_by_axes(path: Path) -> None:
    """The same with nodes of order 1, all x before all y."""
    mfem(path)
    head = path.read_text().partition("3\n" + rows(POINTS))[0]
    space = "FiniteElementSpace\nFiniteElementCollection: H1_3D_P1\nVDim: 3\nOrdering: 0\n"
    path.write_text(f"{head}\nnodes\n{space}\n{rows(POINTS.T.reshape(-1, 1))}\nmfem_mesh_end\n")


def medit(path: Path) -> None:
    """Medit's format: references 1 to 3 for the patches, a section that is not used, and 0 on an inner face."""
    outer = [face for face in FACES if face.patch]
    names = list(PATCHES)
    faces = [[*(n + 1 for n in face.nodes), 1 + names.index(face.patch)] for face in outer]
    faces.append([*(n + 1 for n in next(face.nodes for face in FACES if not face.patch)), 0])
    path.write_text(
        f"MeshVersionFormatted 2\nDimension\n3\n\nVertices\n{N**3}\n{rows(np.pad(POINTS, ((0, 0), (0, 1))))}\n"
        f"Quadrilaterals\n{len(faces)}\n{rows(faces)}\nCorners 1\n1\n"
        f"Hexahedra\n{len(CELLS)}\n{rows(np.pad(CELLS + 1, ((0, 0), (0, 1))))}\nEnd\n"
    )


def _xdmf(path: Path, item: Callable[[str, NDArray[Any]], str]) -> None:
    """XDMF as FEniCS writes it: a mesh and, on its points, a grid of the boundary, whose arrays have our names."""
    outer = [face for face in FACES if face.patch]
    marks = "".join(
        f'<Attribute Name="patch_{name}" Center="Cell">{item(name, mark)}</Attribute>\n'
        for name in PATCHES
        for mark in [np.array([face.patch == name for face in outer]).astype(np.int32)]
    )
    path.write_text(
        '<?xml version="1.0"?>\n<!DOCTYPE Xdmf SYSTEM "Xdmf.dtd" []>\n'
        '<Xdmf Version="3.0" xmlns:xi="http://www.w3.org/2001/XInclude">\n<Domain>\n'
        f'<Grid Name="box" GridType="Uniform">\n<Topology TopologyType="Hexahedron">{item("cells", CELLS)}</Topology>\n'
        f'<Geometry GeometryType="XYZ">{item("points", POINTS)}</Geometry>\n</Grid>\n'
        '<Grid Name="sides" GridType="Uniform">\n<xi:include xpointer="xpointer(/Xdmf/Domain/Grid/Geometry)"/>\n'
        f'<Topology TopologyType="Quadrilateral">{item("faces", np.array([face.nodes for face in outer]))}</Topology>\n'
        f"{marks}</Grid>\n</Domain>\n</Xdmf>\n"
    )


def _item(values: NDArray[Any], form: str, text: str, more: str = "") -> str:
    kind = f'NumberType="{"Float" if values.dtype.kind == "f" else "Int"}" Precision="{values.dtype.itemsize}"'
    size = " ".join(map(str, values.shape))
    return f'<DataItem Dimensions="{size}" {kind} Format="{form}"{more}>{text}</DataItem>'


def xdmf(path: Path) -> None:
    _xdmf(path, lambda _, values: _item(values, "XML", "\n" + rows(values.reshape(len(values), -1))))


def xdmf_hdf5(path: Path) -> None:
    """XDMF with the numbers in HDF5."""
    h5py = pytest.importorskip("h5py")

    with h5py.File(path.with_suffix(".h5"), "w") as file:

        def item(name: str, values: NDArray[Any]) -> str:
            file[f"Mesh/{name}"] = values
            return _item(values, "HDF", f"{path.stem}.h5:/Mesh/{name}")

        _xdmf(path, item)


def xdmf_binary(path: Path) -> None:
    raw = bytearray()

    def item(_: str, values: NDArray[Any]) -> str:
        place = len(raw)
        raw.extend(values.astype(values.dtype.newbyteorder(">")).tobytes())
        return _item(values, "Binary", f"{path.stem}.bin", f' Seek="{place}" Endian="Big"')

    _xdmf(path, item)
    path.with_suffix(".bin").write_bytes(raw)


def _ensight(text: Callable[[str], bytes], numbers: Callable[[NDArray[Any]], bytes]) -> bytes:
    """EnSight's geometry as OpenFOAM writes it, a part for each patch; ``sides`` has polygons, ids are given."""
    parts = [("internalMesh", np.arange(N**3), CELLS)]
    parts += [
        (name, nodes, np.searchsorted(nodes, [face.nodes for face in FACES if face.patch == name]))
        for name, nodes in PATCHES.items()
    ]
    out = b"".join(map(text, ["a box", "by hand", "node id given", "element id given"]))
    for number, (name, nodes, own) in enumerate(parts, start=1):
        out += text("part") + numbers(np.array([number])) + text(name) + text("coordinates")
        out += numbers(np.array([len(nodes)])) + numbers(nodes + 1)
        out += b"".join(numbers(column) for column in POINTS[nodes].T)
        kind = "nsided" if name == "sides" else "quad4" if own.shape[1] == 4 else "hexa8"
        out += text(kind) + numbers(np.array([len(own)])) + numbers(np.arange(len(own)) + 101)
        out += numbers(np.full(len(own), 4)) if kind == "nsided" else b""
        out += numbers(own + 1)
    return out


def ensight(path: Path) -> None:
    path.write_bytes(
        _ensight(lambda line: f"{line}\n".encode(), lambda values: rows(values.reshape(len(values), -1)).encode())
    )


def ensight_binary(path: Path, order: str = "<") -> None:
    """The same in C binary, in single precision."""
    path.write_bytes(
        b"C Binary".ljust(80, b"\0")
        + _ensight(
            lambda line: line.encode().ljust(80, b"\0"),
            lambda values: values.astype(f"{order}{values.dtype.kind}4").tobytes(),
        )
    )


def ugrid_text(path: Path) -> None:
    """UGRID as text, and FUN3D's names in its file."""
    path.write_text(_ugrid(rows))
    _mapbc(path.with_suffix(".mapbc"))


def ugrid_binary(path: Path) -> None:
    """The same in C binary, little endian."""
    parts: list[bytes] = []
    _ugrid(lambda values: parts.append(values.astype("<f8" if values.dtype.kind == "f" else "<i4").tobytes()) or "")
    path.write_bytes(b"".join(parts))
    _mapbc(path.with_name(path.name.replace(".lb8.ugrid", ".mapbc")))


def _ugrid(put: Callable[[NDArray[Any]], str]) -> str:
    outer = [face for face in FACES if face.patch]
    counts = np.array([[N**3, 0, len(outer), 0, 0, 0, len(CELLS)]])
    tags = np.array([[10 * (1 + list(PATCHES).index(face.patch))] for face in outer])
    return "".join(map(put, [counts, POINTS, np.array([face.nodes for face in outer]) + 1, tags, CELLS + 1]))


def _mapbc(path: Path) -> None:
    path.write_text("3\n10 5000 far\n20 6662 sides\n30 4000 wall ! viscous\n")


def netgen(path: Path) -> None:
    """Netgen's .vol with names of the boundary conditions."""
    outer = [face for face in FACES if face.patch]
    faces = [[1, 1 + list(PATCHES).index(face.patch), 1, 0, 4, *(node + 1 for node in face.nodes)] for face in outer]
    names = "".join(f"{number}\t{name}\n" for number, name in enumerate(PATCHES, start=1))
    cells = np.hstack([np.full((8, 2), (1, 8)), CELLS + 1])
    path.write_text(
        "# by hand\n\nmesh3d\ndimension\n3\ngeomtype\n0\n\n# surfnr bcnr domin domout np p1\n"
        f"surfaceelements\n{len(outer)}\n{rows(faces)}\n\nvolumeelements\n8\n{rows(cells)}\n"
        f"points\n{N**3}\n{rows(POINTS)}\nbcnames\n3\n{names}\nendmesh\n"
    )


#: {file: writer}; every file holds POINTS, CELLS and PATCHES.
WRITERS: dict[str, Callable[[Path], None]] = {
    "box.msh": fluent,
    "box.cas": fluent_binary,
    "box.msh.h5": fluent_hdf5,
    "box.med": med,
    "box.exo": exodus,
    "box.e": exodus_hdf5,
    "box.inp": abaqus,
    "box.mdpa": kratos,
    "box_elmer": elmer,
    "box.cgns": cgns,
    "box.vtk": vtk,
    "box.vtu": own,
    "box.vtkhdf": vtkhdf,
    "box.npz": own,
    "box.su2": su2,
    "box_gmsh.msh": gmsh,
    "box_foam": foam,
    "box.unv": universal,
    "box.mesh": mfem,
    "box.mfem": mfem_by_axes,
    "box.xdmf": xdmf,
    "box_h5.xdmf": xdmf_hdf5,
    "box.xmf": xdmf_binary,
    "box.geo": ensight,
    "box.ugrid": ugrid_text,
    "box.lb8.ugrid": ugrid_binary,
    "box.vol": netgen,
}
