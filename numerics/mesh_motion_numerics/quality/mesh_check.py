"""Checks whether a mesh is usable. Every error names the first bad item and a remedy; smaller oddities give warnings.

A mesh is checked once, when a session is built; all later code trusts the result. Cheap and basic checks come before
the checks that depend on them, so the first error is the one to repair first: shapes and numbers, node indices, the
cells' geometry, the patches, the boundary.

Boundary nodes in no patch are allowed: they follow the interpolation like interior nodes, and no correction moves them;
boundary nodes behind fixed nodes do not move. This is rarely wanted at a wall, hence the warning.
"""

from collections.abc import Mapping
from typing import NamedTuple, NoReturn

import mesh_motion_kernels as kernels
import numpy as np
from mesh_motion_protocol.errors import InvalidInput

from mesh_motion_numerics.arrays import Floats, Integers, Marks
from mesh_motion_numerics.mesh.boundary_facets import boundary_nodes
from mesh_motion_numerics.mesh.cells import CellTable
from mesh_motion_numerics.mesh.coincidence import coincident_nodes
from mesh_motion_numerics.mesh.hanging_nodes import refuse_hanging_nodes, refuse_split_facets
from mesh_motion_numerics.mesh.patch_check import check_patches, nodes_behind_fixed, nodes_in_no_patch, patch_warnings
from mesh_motion_numerics.mesh.points import bounding_box, marks_at
from mesh_motion_numerics.mesh.roles import Patch
from mesh_motion_numerics.quality.metrics import cell_quality, reference_sizes
from mesh_motion_numerics.quality.orientation import OrientedCells, oriented
from mesh_motion_numerics.quality.quality_summary import judged_mesh

# A smaller skew is 0 up to rounding; cells of a boundary layer with aspect ratio 10⁶ have a skew of 10⁻⁶ and pass.
_FLAT_SKEW = 1e-10
# The correction takes high powers of the cells' determinants: with cells 10⁻³ as long as the mesh, its results change
# below 10⁻¹⁸ and above 10²⁰. These limits leave room for smaller cells and long motions.
_SMALLEST_EXTENT, _LARGEST_EXTENT = 1e-12, 1e15


class CheckedMesh(NamedTuple):
    """The result of the check of a usable mesh."""

    cells: CellTable  # In one orientation (:mod:`.orientation`); all later code computes with these
    #: (m,). Result of :func:`~mesh_motion_numerics.quality.metrics.reference_sizes`, all positive.
    reference_sizes: Floats
    warnings: list[str]
    resting: Integers  # (r,). Nodes in no patch that stay where they are: those behind fixed nodes
    coincident: Integers  # (c, 2). Boundary or patch nodes at the same place: the first one, and another one
    loose: Integers  # (l,). Nodes in no cell and in no patch


def checked_mesh(points: Floats, cells: CellTable, patches: Mapping[str, Patch]) -> CheckedMesh:
    """Refuse an unusable mesh, and collect the warnings of a usable one.

    Raises InvalidInput: ``.SHAPE`` for a wrong shape; ``.NONFINITE`` for a coordinate that is not finite;
    ``.MESH_DEGENERATE`` for node indices out of range, repeated nodes in a cell, inverted or flat cells, and facets of
    more than two cells; ``.MESH`` for an extent outside the floating-point range, for hanging nodes, for quads on
    triangles and for patches (unknown role, no or repeated nodes, no moving patch).

    Parameters
    ----------
    points : (n, d) array, mesh length unit

    Returns
    -------
    CheckedMesh
        Warnings: cells in the opposite orientation, boundary nodes at the same place, orphan nodes, patch nodes inside
        the mesh, boundary nodes without a patch, patches that share nodes.
    """
    listed, read = cells, checked_cells(points, cells)
    cells, sizes = read.cells, read.sizes
    check_patches(len(points), patches)
    boundary = _boundary_of(points, listed, read)
    floating = nodes_in_no_patch(boundary, patches)
    refuse_hanging_nodes(points, cells, floating)
    refuse_split_facets(cells, floating)
    checked = np.union1d(boundary, np.concatenate([patch.nodes for patch in patches.values()]))
    pairs = coincident_nodes(points, checked)
    orphans = nodes_in_no_cell(len(points), cells)
    loose = np.setdiff1d(orphans, checked)
    odd = [*read.warnings, *_coincident(pairs), *_orphans(orphans)]
    resting = nodes_behind_fixed(len(points), cells, boundary, patches, pairs)
    return CheckedMesh(
        cells, sizes, [*odd, *patch_warnings(boundary, orphans, patches, resting)], resting, pairs, loose
    )


def checked_cells(points: Floats, cells: CellTable) -> OrientedCells:
    """Refuse unusable points (n, d) and cells, in particular inverted and flat ones; errors as above."""
    _check_points(points, cells.dimension)
    _check_extent(points)
    _check_indices(len(points), cells)
    read = oriented(points, cells)
    _check_geometry(points, read.cells, read.sizes)
    return read


def _check_points(points: Floats, dimension: int) -> None:
    """Require the shape (n, d), n > 0, and finite coordinates."""
    if points.ndim != 2 or points.shape[1] != dimension or not len(points):
        raise InvalidInput(
            f"points: expected an array of shape (n, {dimension}) with n > 0 for {dimension}D cells, "
            f"got {points.shape}",
            code="INVALID_ARGUMENT.SHAPE",
            details={"shape": list(points.shape), "dimension": dimension},
        )
    finite = np.isfinite(points)
    if not finite.all():
        node, axis = (int(i) for i in np.argwhere(~finite)[0])
        count = int(len(points) - np.count_nonzero(finite.all(axis=1)))
        raise InvalidInput(
            f"node {node}: coordinate {'xyz'[axis]} is {points[node, axis]}, expected a finite number"
            f" ({count} such node{'s' if count > 1 else ''})",
            code="INVALID_ARGUMENT.NONFINITE",
            details={"node": node, "axis": "xyz"[axis], "value": str(points[node, axis]), "count": count},
        )


def _check_extent(points: Floats) -> None:
    """Require lengths whose powers (a size is a product of d lengths) stay within the floating-point range."""
    low, high = bounding_box(points)
    extent = float((high / 2 - low / 2).max()) * 2  # halves: no overflow
    if 0.0 < extent < _SMALLEST_EXTENT or extent > _LARGEST_EXTENT:
        raise InvalidInput(
            f"the mesh is {extent:.3g} long, expected {_SMALLEST_EXTENT:.0e} to {_LARGEST_EXTENT:.0e}",
            code="INVALID_ARGUMENT.MESH",
            hint="take another unit of length",
            details={"value": extent},
        )


def _check_indices(n: int, cells: CellTable) -> None:
    """Require every node index in range, and no node twice in a cell."""
    for block, span in cells.numbered:
        if block.nodes.min() < 0 or block.nodes.max() >= n:
            row, place = (int(i) for i in np.argwhere((block.nodes < 0) | (block.nodes >= n))[0])
            raise InvalidInput(
                f"cell {span.start + row} ({block.type.name}): node index {block.nodes[row, place]} is out of range, "
                f"expected 0 to {n - 1}",
                code="INVALID_ARGUMENT.MESH_DEGENERATE",
                hint="node indices start at 0" if block.nodes.max() == n else "",
                details={"cell": span.start + row, "index": int(block.nodes[row, place]), "nodes": n},
            )
        row = kernels.first_row_with_repetition(np.ascontiguousarray(block.nodes))
        if row >= 0:
            raise InvalidInput(
                f"cell {span.start + row} ({block.type.name}) names a node twice: {block.nodes[row].tolist()}",
                code="INVALID_ARGUMENT.MESH_DEGENERATE",
                hint="split collapsed cells into types of their own, for example wedge or pyramid",
                details={"cell": span.start + row, "nodes": block.nodes[row].tolist()},
            )


def _check_geometry(points: Floats, cells: CellTable, sizes: Floats) -> None:
    """Require positive corner determinants and no flat cell; sizes (m,)."""
    # in one pass that stores no array
    lowest, _ = judged_mesh(points, cells, sizes, metric="skew", worst=1, distributions=False)
    if lowest.inverted or not lowest.metric.min > _FLAT_SKEW:
        _refuse_geometry(points, cells, sizes)


def _boundary_of(points: Floats, listed: CellTable, read: OrientedCells) -> Integers:
    """(b,) nodes of the boundary. Mirrored cells that overlap their neighbours were inverted: the mesh is folded."""
    try:
        return boundary_nodes(read.cells)
    except InvalidInput as error:
        named = error.details.get("cells")
        if isinstance(named, list) and np.isin(named, read.mirrored).any():
            _refuse_geometry(points, listed, reference_sizes(points, listed))
        raise


def _refuse_geometry(points: Floats, cells: CellTable, sizes: Floats) -> NoReturn:
    """Raise an error that names the first bad cell."""
    quality = cell_quality(points, cells, sizes)
    bad = quality.inverted | ~(quality.skew > _FLAT_SKEW)
    cell, count = int(np.argmax(bad)), int(np.count_nonzero(bad))
    block, row = cells.locate(cell)
    corners = points[block.nodes[row][block.type.corner_array]]
    with np.errstate(divide="ignore"):  # log of nearly zero edge lengths
        determinants = np.linalg.det(corners[:, 1:] - corners[:, :1])
    size = block.type.size_factor * float(determinants.sum())
    raise InvalidInput(
        f"cell {cell} ({block.type.name}, nodes {block.nodes[row].tolist()}) is "
        f"{'inverted or degenerate' if quality.inverted[cell] else 'flat'}: its smallest corner determinant is "
        f"{determinants.min():.4g}, expected a positive one; its size is {size:.4g}"
        f" ({count} such cell{'s' if count > 1 else ''} of {len(cells)})",
        code="INVALID_ARGUMENT.MESH_DEGENERATE",
        hint=_inversion_hint(cells, bad),
        details={"cell": cell, "determinant": float(determinants.min()), "size": size, "count": count},
    )


def _inversion_hint(cells: CellTable, bad: Marks) -> str:
    """The most likely cause of these bad cells."""
    for block, span in cells.numbered:
        if bad[span].all():
            return f"all cells of type {block.type.name!r} are: their node order differs from VTK's and Gmsh's"
    return "mesh the domain again, or repair these cells"


def _coincident(pairs: Integers) -> list[str]:
    """A warning for nodes (c, 2) at the same place: two sides of an interface, a baffle or a wake."""
    if not len(pairs):
        return []
    pair, left = f"{pairs[0, 0]} and {pairs[0, 1]}", len(pairs) - 1
    more = f" and {left} more pair{'s' if left > 1 else ''}" if left else ""
    return [
        f"the boundary nodes {pair}{more} are at the same place; they are interpolated as one, and each has its own "
        "displacement"
    ]


def nodes_in_no_cell(n: int, cells: CellTable) -> Integers:
    """The nodes of ``n`` that are in no cell, ascending."""
    return np.flatnonzero(~marks_at(n, *(block.nodes for block in cells)))


def _orphans(orphans: Integers) -> list[str]:
    """A warning for nodes (o,) in no cell."""
    if not len(orphans):
        return []
    return [
        f"{len(orphans)} node{'s belong' if len(orphans) > 1 else ' belongs'} to no cell, the first is node "
        f"{orphans[0]}; off the patches they are moved like interior nodes, and no cell judges them"
    ]
