"""The mesh that opens a session: points, cells and patches, checked before anything is sent."""

from __future__ import annotations

import os
import zipfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Self

import numpy as np
from mesh_motion_protocol.errors import InvalidInput, meant
from mesh_motion_protocol.limits import NAME_BYTES
from mesh_motion_protocol.messages import Upload
from numpy.typing import ArrayLike, NDArray

from mesh_motion_client.display import Described, draw
from mesh_motion_client.exchange import Content, from_file, from_gmsh, from_meshio, from_pyvista, to_pyvista

__all__ = ["CELL_NODES", "ROLES", "Mesh", "Patch", "finite_rows", "real_numbers", "whole_numbers"]

#: Number of nodes of each cell type.
CELL_NODES = {"line": 2, "triangle": 3, "quad": 4, "tetra": 4, "pyramid": 5, "wedge": 6, "hexahedron": 8}
ROLES = ("moving", "fixed", "slip", "symmetry", "periodic")
#: In place of a role: the patch is left out, as in a case file.
_LEFT_OUT = "free"

#: Cell types of a 2D mesh.
_PLANE = ("triangle", "quad")

#: Bytes of one UPLOAD: so small that the worker never holds much more than the mesh itself.
_PART_BYTES = 32 << 20
#: Number of nodes that 4-byte integers can number.
_INT32 = 1 << 31
#: Bytes that a packed file may always unpack to, and the factor of its own size that it may unpack to.
_UNPACKED_BYTES, _UNPACKED_RATIO = 1 << 30, 200
#: Errors that reading a damaged ``.npz`` raises.
_DAMAGED = (ValueError, zipfile.BadZipFile, EOFError, KeyError, RuntimeError, MemoryError, OverflowError)


@dataclass(frozen=True, eq=False)
class Patch:
    """A part of the boundary with one role.

    Attributes
    ----------
    role : {"moving", "fixed", "slip", "symmetry", "periodic"}
    nodes : (p,) int array
        Node indices, 0-based.
    """

    role: str
    nodes: NDArray[np.int64]

    def __post_init__(self) -> None:
        if not isinstance(self.role, str) or self.role not in ROLES:
            raise InvalidInput(
                f"a patch's role must be one of {', '.join(ROLES)}, got {_short(self.role)}",
                hint=meant(str(self.role), ROLES) or "Patch(role, nodes)",
            )
        object.__setattr__(self, "nodes", _indices(self.nodes, "a patch's nodes").reshape(-1))


@dataclass(frozen=True, eq=False, repr=False)
class Mesh(Described):
    """A volume mesh, or one partition of it.

    Attributes
    ----------
    points : (n, d) array, mesh length unit
        d = 1, 2 or 3.
    cells : dict
        Cell type → (m, nodes of the type) int array, 0-based, in VTK's node order; but a wedge in Gmsh's order: 0, 1, 2
        anticlockwise as seen from 3, 4, 5.
    patches : dict
        Name → :class:`Patch`.
    global_ids : (n,) int array, optional
        Only with several partitions: the nodes' numbers in the whole mesh.
    """

    points: NDArray[np.float64]
    cells: Mapping[str, NDArray[np.integer]]
    patches: Mapping[str, Patch] = field(default_factory=dict)
    global_ids: NDArray[np.int64] | None = None

    def __post_init__(self) -> None:
        points = finite_rows(self.points, "points")
        if not ((len(points) or self.global_ids is not None) and 1 <= points.shape[1] <= 3):
            raise InvalidInput(
                f"points must have shape (n, 1), (n, 2) or (n, 3) with n > 0, got {points.shape}",
                hint="a partition, which has global_ids, may have no points",
            )
        object.__setattr__(self, "points", points)
        self._check_kinds()
        object.__setattr__(self, "cells", {name: self._cells(name, nodes) for name, nodes in self.cells.items()})
        for name, patch in self.patches.items():
            self._check_range(patch.nodes, f"patch {name!r}")
        if self.global_ids is not None:
            ids = _indices(self.global_ids, "global_ids").reshape(-1)
            if len(ids) != len(points):
                raise InvalidInput(
                    f"global_ids must have one number for each point, got {len(ids)} for {len(points)} points"
                )
            object.__setattr__(self, "global_ids", ids)

    @classmethod
    def load(cls, path: str | os.PathLike[str], roles: Mapping[str, str], *, zone: str = "") -> Self:
        """Read a mesh file.

        Parameters
        ----------
        path : path
            ``.npz``, as ``mesh-motion convert`` writes it: ``points``, ``cells_<type>``, ``patch_<name>``, and in a
            partition ``global_ids``. If the server's package is installed too, also every file that
            ``mesh-motion check`` reads: of Gmsh, OpenFOAM, SU2, VTK, CGNS, …
        roles : dict
            Name of each patch → its role, or "free" to leave it out. A partition need not have all of them.
        zone : str
            Name or number of a zone, if the file has several.

        Raises
        ------
        InvalidInput
            Naming the file, if it cannot be read, holds other arrays, or has a patch without a role.
        """
        _check_roles(roles)
        if not isinstance(path, str | os.PathLike):
            raise InvalidInput(f"path must be the path of a mesh file, got {_short(path)}")
        if zone or Path(path).suffix.lower() != ".npz":
            return cls._of(from_file(path, zone), roles, f"{os.fspath(path)}: ")
        try:
            with np.load(path, allow_pickle=False) as file:
                _check_unpacked(path, sum(member.file_size for member in file.zip.infolist()))
                arrays = dict(file)
        except OSError as error:
            raise InvalidInput(f"{path}: cannot be read: {error.strerror or error}") from None
        except (*_DAMAGED, AttributeError, TypeError) as error:
            raise InvalidInput(f"{path}: not readable as an .npz archive of plain arrays: {error}") from None
        cells, nodes = (
            {key.removeprefix(kind): arrays[key] for key in arrays if key.startswith(kind)}
            for kind in ("cells_", "patch_")
        )
        others = (
            set(arrays) - {"points", "global_ids"} - {*map("cells_{}".format, cells), *map("patch_{}".format, nodes)}
        )
        if others or "points" not in arrays:
            raise InvalidInput(
                f"{path}: expected 'points', 'cells_<type>', 'patch_<name>' and 'global_ids', got {sorted(arrays)}",
                hint="mesh-motion convert writes such a file",
            )
        return cls._of(Content(arrays["points"], cells, nodes), roles, f"{path}: ", arrays.get("global_ids"))

    @classmethod
    def from_pyvista(cls, dataset: Any, roles: Mapping[str, str]) -> Self:
        """The mesh of a dataset of PyVista.

        Parameters
        ----------
        dataset : pyvista.DataSet
        roles : dict
            Name of each patch → its role. The patch's nodes are those where the array ``name`` or ``patch_<name>`` of
            points or cells is not 0; or the name is a number of faces (in 2D: edges) in an array such as
            ``gmsh:physical``, as in ``.vtu`` files.

        Raises
        ------
        InvalidInput
            If an array is missing, or the type of a cell is not one of the seven.
        """
        return cls._of(from_pyvista(dataset, _check_roles(roles)), roles)

    @classmethod
    def from_meshio(cls, mesh: Any, roles: Mapping[str, str]) -> Self:
        """The mesh of a ``meshio.Mesh``.

        Parameters
        ----------
        mesh : meshio.Mesh
        roles : dict
            Name of each patch → its role. A patch is a set of points, a set of cells, a named physical group of Gmsh,
            or a number in ``gmsh:physical``, ``cell_tags``, ``medit:ref``, ``netgen:index``, ….

        Raises
        ------
        InvalidInput
            As :meth:`from_pyvista` does.
        """
        return cls._of(from_meshio(mesh, _check_roles(roles)), roles)

    @classmethod
    def from_gmsh(cls, roles: Mapping[str, str]) -> Self:
        """The mesh of Gmsh's current model, its nodes in the order of their tags.

        Parameters
        ----------
        roles : dict
            Name of each physical group of the boundary → its role, or "free" to leave it out; a group without a name
            has its number.

        Raises
        ------
        InvalidInput
            If there is no mesh, a group has no role, or the type of a cell is not one of the seven.
        """
        _check_roles(roles)
        return cls._of(from_gmsh(), roles, "Gmsh's model: ")

    def to_pyvista(self) -> Any:
        """Return a ``pyvista.UnstructuredGrid`` of the mesh, with a point array ``patch_<name>`` for each patch."""
        return to_pyvista(self, self.points)

    @classmethod
    def _of(
        cls, content: Content, roles: Mapping[str, str], where: str = "", global_ids: NDArray[np.int64] | None = None
    ) -> Self:
        """Make the mesh with a role for each patch; each patch with a role must exist, except in a partition."""
        without, unknown = sorted(set(content.patches) - set(roles)), sorted(set(roles) - set(content.patches))
        if without:
            raise InvalidInput(
                f"{where}patch {without[0]!r} has no role; roles are given of {sorted(roles)}",
                hint=next(
                    (f"{name!r} is not a patch: {hint}" for name in unknown if (hint := meant(name, without))),
                    f"add {without[0]!r}: 'moving' or 'fixed', or 'free' to leave it out",
                ),
            )
        if unknown and global_ids is None:
            raise InvalidInput(
                f"{where}there is no patch {unknown[0]!r}; the mesh has {sorted(content.patches)}",
                hint=meant(unknown[0], content.patches) or "roles name the patches of the mesh",
            )
        kept = {name: nodes for name, nodes in content.patches.items() if roles[name] != _LEFT_OUT}
        patches = {name: Patch(roles[name], nodes) for name, nodes in kept.items()}
        try:
            return cls(content.points, content.cells, patches, global_ids)
        except InvalidInput as error:
            raise InvalidInput(
                f"{where}{error.message}", code=error.code, hint=error.hint, details=error.details
            ) from None

    @property
    def dimension(self) -> int:
        """Number of coordinates."""
        return int(self.points.shape[1])

    @property
    def nbytes(self) -> int:
        """Bytes of the upload."""
        sizes = [self.points.nbytes, *(nodes.nbytes for nodes in self.cells.values())]
        return sum(sizes) + sum(patch.nodes.nbytes for patch in self.patches.values())

    def description(self) -> list[str]:
        """The mesh's size, bounding box and patches."""
        cells = ", ".join(f"{len(nodes)} {name}" for name, nodes in self.cells.items())
        low, high = (", ".join(f"{x:.4g}" for x in ends) for ends in (self.points.min(axis=0), self.points.max(axis=0)))
        patches = [f"{name}: {len(patch.nodes)} nodes, {patch.role}" for name, patch in self.patches.items()]
        return [f"Mesh in {self.dimension}D: {len(self.points)} nodes, {cells}", f"box ({low}) to ({high})", *patches]

    def plot(self) -> Any:
        """Draw a picture: the cells of a 2D mesh, the boundary of a 3D mesh. See :func:`.display.draw`."""
        return draw(self, self.points, "the mesh as given")

    def parts(self, **at: Any) -> Iterator[Upload]:
        """Yield the UPLOADs that carry this mesh; ``at`` are the fields they share."""
        items: list[tuple[dict[str, Any], NDArray[Any]]] = [({"item": "nodes"}, self.points)]
        if self.global_ids is not None:
            items.append(({"item": "global_ids"}, self.global_ids[:, None]))
        items += [({"item": "cells", "name": name}, nodes) for name, nodes in self.cells.items()]
        items += [
            ({"item": "patch", "name": name, "role": patch.role}, patch.nodes[:, None])
            for name, patch in self.patches.items()
        ]
        for fields, rows in items:
            yield from uploads(rows, **at, **fields)

    def _check_kinds(self) -> None:
        """Check that cells and patches are dicts by name."""
        if not isinstance(self.cells, Mapping):
            raise InvalidInput(
                f"cells must be a dict, cell type → node numbers, got {_short(self.cells)}",
                hint="as cells={'triangle': triangles}",
            )
        if not isinstance(self.patches, Mapping):
            raise InvalidInput(
                f"patches must be a dict, name → Patch, got {_short(self.patches)}",
                hint="as patches={'wall': Patch('moving', nodes)}",
            )
        for name, patch in self.patches.items():
            if not isinstance(name, str) or not name:
                raise InvalidInput(f"a patch's name must be a text that is not empty, got {name!r}")
            if (size := len(name.encode(errors="replace"))) > NAME_BYTES:
                raise InvalidInput(
                    f"a patch's name must have at most {NAME_BYTES} bytes in UTF-8, got {size}: {name[:40]!r}…",
                    hint="give the patch a shorter name",
                )
            if not isinstance(patch, Patch):
                raise InvalidInput(
                    f"patch {name!r} must be a Patch, got {_short(patch)}", hint=f"as {name!r}: Patch('moving', nodes)"
                )

    def _cells(self, name: str, nodes: ArrayLike) -> NDArray[np.integer]:
        if name not in CELL_NODES:
            raise InvalidInput(
                f"cell types are {', '.join(CELL_NODES)}, got {name!r}", hint=meant(str(name), CELL_NODES)
            )
        if name in _PLANE and self.points.shape[1] == 3:
            raise InvalidInput(
                f"cells of type {name} must have points (n, 2), got points {self.points.shape}",
                hint="a 2D mesh needs points[:, :2]; a 3D mesh needs its volume cells without the cells of its surface",
            )
        array = whole_numbers(nodes, f"cells of type {name}")
        if array.ndim != 2 or array.shape[1] != CELL_NODES[name]:
            raise InvalidInput(f"cells of type {name} must have shape (m, {CELL_NODES[name]}), got {array.shape}")
        self._check_range(array, f"cells of type {name}")
        # half the bytes to send; narrow and wide integers mean the same
        return np.array(array, dtype=np.int32 if len(self.points) <= _INT32 else np.int64, order="C")

    def _check_range(self, nodes: NDArray[Any], what: str) -> None:
        if not nodes.size or (nodes.min() >= 0 and nodes.max() < len(self.points)):
            return
        wrong = np.argwhere((nodes < 0) | (nodes >= len(self.points)))
        first = tuple(int(i) for i in wrong[0])
        raise InvalidInput(
            f"{what} must name nodes 0 … {len(self.points) - 1}, got {int(nodes[first])} in row {first[0]}",
            hint="node numbers count from 0",
            details={"row": first[0], "value": int(nodes[first])},
        )


def _check_roles(roles: Mapping[str, str]) -> Mapping[str, str]:
    """The roles, if they are a dict."""
    if not isinstance(roles, Mapping):
        raise InvalidInput(
            f"roles must be a dict, name of a patch → its role, got {_short(roles)}",
            hint="as roles={'wall': 'moving', 'outlet': 'fixed'}",
        )
    return roles


def _check_unpacked(path: str | os.PathLike[str], held: int) -> None:
    """Raise InvalidInput for a file that is made to fill the memory when it is unpacked."""
    packed = os.path.getsize(path)
    most = max(_UNPACKED_BYTES, _UNPACKED_RATIO * packed)
    if held > most:
        raise InvalidInput(
            f"{os.fspath(path)}: {packed} bytes that hold {held}, expected at most {most}",
            hint="if it is a mesh, store it without compression",
        )


def real_numbers(values: ArrayLike, what: str) -> NDArray[np.float64]:
    """The values as a float64 array; no copy if they are one already."""
    try:
        _refuse_masked(values)
        array = np.asarray(values)
        if array.dtype.kind not in "buifO":  # NumPy would take dates as seconds, and text such as 1_0 as a number
            raise TypeError(f"they are {array.dtype}")
        return np.asarray(array, dtype=np.float64, order="C")
    except (TypeError, ValueError) as error:
        raise InvalidInput(f"{what} must be numbers: {error}", code="INVALID_ARGUMENT.DTYPE") from None


def finite_rows(values: ArrayLike, what: str) -> NDArray[np.float64]:
    """Return a (n, d) float64 copy of ``values``, checked for NaN and infinity; an (n,) input becomes one column."""
    array = np.array(real_numbers(values, what), order="C")
    if array.ndim == 1:
        array = array[:, None]
    if array.ndim != 2:
        raise InvalidInput(f"{what} must be a table (rows, coordinates), got shape {array.shape}")
    finite = np.isfinite(array)
    if not finite.all():
        wrong = np.argwhere(~finite)
        row, column = (int(i) for i in wrong[0])
        raise InvalidInput(
            f"{what} must be finite, got {array[row, column]} in row {row}",
            code="INVALID_ARGUMENT.NONFINITE",
            hint="look at the solver that sent it first",
            details={"row": row, "value": str(array[row, column])},
        )
    return array


def _indices(values: ArrayLike, what: str) -> NDArray[np.int64]:
    """Copy of whole numbers as int64."""
    return np.array(whole_numbers(values, what), dtype=np.int64, order="C")


def whole_numbers(values: ArrayLike, what: str) -> NDArray[Any]:
    """The values as an array of integers; no copy if they are one already."""
    try:
        _refuse_masked(values)
        array = np.asarray(values)
    except ValueError as error:
        raise InvalidInput(f"{what} must be whole numbers: {error}", code="INVALID_ARGUMENT.DTYPE") from None
    if array.size and not np.issubdtype(array.dtype, np.integer):
        mask = array.dtype == np.bool_
        raise InvalidInput(
            f"{what} must be whole numbers, got dtype {array.dtype}",
            code="INVALID_ARGUMENT.DTYPE",
            hint="numpy.flatnonzero(mask) gives the numbers" if mask else "array.astype(int), if they are whole",
        )
    return array


def _refuse_masked(values: ArrayLike) -> None:
    """Raise ValueError for a masked array with masked entries: numpy would use the values under the mask."""
    if np.ma.is_masked(values):
        entry = [int(i) for i in np.argwhere(np.ma.getmaskarray(np.ma.asarray(values)))[0]]
        raise ValueError(f"entry {entry} is masked; fill it, or leave its row out")


def uploads(rows: NDArray[Any], **fields: Any) -> Iterator[Upload]:
    """The UPLOADs of (k, c) rows with these fields, at least one."""
    step = max(1, _PART_BYTES // (8 * rows.shape[1]))  # the receiver widens each item to 8 bytes
    for start in range(0, max(1, len(rows)), step):
        yield Upload(**fields, rows=rows[start : start + step])


def _short(value: object) -> str:
    """Describe a value; a long one without its content."""
    return f"an array of shape {value.shape}" if isinstance(value, np.ndarray) else f"{value!r:.60}"
