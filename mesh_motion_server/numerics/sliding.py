"""Slip and symmetry patches: nodes that may move along their surface, and must not leave it.

Where a sliding node may go follows from the smooth pieces of the sliding patches that it started on:

- planar pieces: its own plane through its reference place; on two, their line of intersection; on three, its place;
- one curved piece: the piece's facets in the reference mesh, which represent the surface exactly as the mesh does;
- a curved and another piece: the curve where the two meet; more of them: its place.

So a corner stays a corner, an edge an edge, and a box whose six sides are one patch keeps its shape. Everything refers
to the reference mesh: nothing drifts however often positions are projected.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from mesh_motion_server.errors import InvalidInput
from mesh_motion_server.numerics.boundary_facets import boundary_facets
from mesh_motion_server.numerics.cells import CellTable
from mesh_motion_server.numerics.closest_point import FacetSet
from mesh_motion_server.numerics.smooth_pieces import Piece, sides, smooth_pieces

__all__ = ["SlidingSurfaces"]

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

#: Planes whose normals differ by less (as a sine) are one plane: they have no line of intersection to stay on.
_PARALLEL = 1e-6


class _Constraint(Protocol):
    """Where some nodes may go."""

    def project(self, positions: Array, reference: Array) -> Array:
        """The admissible positions (m, d) nearest to the given ones, of nodes that started at ``reference`` (m, d)."""
        ...


@dataclass(frozen=True, eq=False)
class _OnPlanes:
    """Orthonormal normals (r, d) of the planes through each node's reference place."""

    normals: Array

    def project(self, positions: Array, reference: Array) -> Array:
        out = positions.copy()
        for normal in self.normals:
            axis = int(np.argmax(np.abs(normal)))
            if np.count_nonzero(normal) == 1:  # along a coordinate: that coordinate stays bitwise
                out[:, axis] = reference[:, axis]
            else:
                out -= np.sum((out - reference) * normal, axis=1)[:, None] * normal
        return out


@dataclass(frozen=True, eq=False)
class _OnFacets:
    facets: FacetSet

    def project(self, positions: Array, reference: Array) -> Array:
        del reference
        return self.facets.closest(positions)


@dataclass(frozen=True, eq=False)
class _Held:
    def project(self, positions: Array, reference: Array) -> Array:
        del positions
        return reference.copy()


@dataclass(frozen=True, eq=False)
class SlidingSurfaces:
    """The constraints of all sliding nodes.

    Attributes
    ----------
    nodes : (s,) int64 array
        The sliding nodes, in the order of the rows that :meth:`project` takes.
    reference : (s, d) array, mesh length unit
        Their reference places.
    groups : tuple of (rows, constraint)
        Each row of ``nodes`` in exactly one group.
    """

    nodes: Integers
    reference: Array
    groups: tuple[tuple[Integers, _Constraint], ...]

    @classmethod
    def build(
        cls, points: Array, cells: CellTable, patches: Mapping[str, Integers], nodes: Integers
    ) -> SlidingSurfaces:
        """Find the surfaces of the sliding nodes.

        Parameters
        ----------
        points : (n, d) array, mesh length unit
            Reference coordinates.
        cells : CellTable
        patches : dict of (p,) int64 arrays
            Node indices of each slip or symmetry patch, with those that another role takes precedence on.
        nodes : (s,) int64 array
            The nodes that slide.

        Raises
        ------
        InvalidInput
            If a sliding node lies on no boundary facet of its patches.
        """
        facets = boundary_facets(cells)
        pieces = [piece for name in sorted(patches) for piece in smooth_pieces(points, facets, patches[name])]
        keys = _pieces_of(pieces, len(points), nodes)
        _refuse_stray(keys, patches, nodes)
        rows: dict[tuple[int, ...], list[int]] = {}
        for row, key in enumerate(keys):
            rows.setdefault(key, []).append(row)
        groups = tuple(
            (np.array(members, dtype=np.int64), _constraint(points, [pieces[i] for i in key]))
            for key, members in rows.items()
        )
        return cls(nodes, points[nodes], groups)

    def project(self, positions: Array) -> Array:
        """Put positions back onto the surfaces.

        Parameters
        ----------
        positions : (s, d) array, mesh length unit
            Where the sliding nodes would go; a row for each of ``nodes``.

        Returns
        -------
        (s, d) array
            The nearest admissible positions.
        """
        if positions.shape != self.reference.shape:
            raise InvalidInput(
                f"expected positions of shape {self.reference.shape}, a row a sliding node, got {positions.shape}",
                code="INVALID_ARGUMENT.SHAPE",
            )
        out = np.empty_like(self.reference)
        for rows, constraint in self.groups:
            out[rows] = constraint.project(positions[rows], self.reference[rows])
        return out


def _pieces_of(pieces: list[Piece], n_points: int, nodes: Integers) -> list[tuple[int, ...]]:
    """Numbers of the pieces that hold each node."""
    place = np.full(n_points, -1, dtype=np.int64)
    place[nodes] = np.arange(len(nodes))
    keys: list[tuple[int, ...]] = [()] * len(nodes)
    for number, piece in enumerate(pieces):
        for row in place[piece.nodes]:
            if row >= 0:
                keys[row] = (*keys[row], number)
    return keys


def _refuse_stray(keys: list[tuple[int, ...]], patches: Mapping[str, Integers], nodes: Integers) -> None:
    """Raise if a sliding node has no surface."""
    stray = next((int(node) for node, key in zip(nodes, keys, strict=True) if not key), None)
    if stray is not None:
        owner = next((name for name, members in sorted(patches.items()) if stray in members), "")
        raise InvalidInput(
            f"node {stray} of the sliding patch {owner!r} lies on no boundary facet of that patch",
            code="INVALID_ARGUMENT.MESH",
            hint="list all nodes of the patch's facets, those on its rim included",
            details={"node": stray},
        )


def _constraint(points: Array, pieces: list[Piece]) -> _Constraint:
    """Where a node on these pieces may go."""
    normals = [piece.normal for piece in pieces if piece.normal is not None]
    if len(normals) == len(pieces):
        return _OnPlanes(_orthonormal(normals))
    if len(pieces) == 1:
        return _OnFacets(FacetSet(points[pieces[0].simplices]))
    curve = _common_sides(pieces) if len(pieces) == 2 else np.empty((0, 2), dtype=np.int64)
    return _OnFacets(FacetSet(points[curve])) if len(curve) and curve.shape[1] == 2 else _Held()


def _orthonormal(normals: list[Array]) -> Array:
    """(r, d) orthonormal basis of the normals, in their order; nearly parallel ones count once."""
    basis: list[Array] = []
    for normal in normals:
        rest = normal.copy()
        for known in basis:
            rest -= (rest @ known) * known
        length = float(np.linalg.norm(rest))
        if length > _PARALLEL:
            basis.append(rest / length)
    return np.array(basis)


def _common_sides(pieces: list[Piece]) -> Integers:
    """Sides (e, 1 or 2) that two pieces share: the curve where they meet."""
    first, second = (np.unique(sides(piece.facets)[0], axis=0) for piece in pieces)
    both = np.concatenate([first, second])
    found, counts = np.unique(both, axis=0, return_counts=True)
    return np.asarray(found[counts == 2], dtype=np.int64)
