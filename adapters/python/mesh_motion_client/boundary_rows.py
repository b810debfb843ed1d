"""The rows of a move: displacements of the moving nodes, given in their order or patch by patch."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from mesh_motion_protocol.errors import InvalidInput, meant
from mesh_motion_protocol.shared_nodes import AGREEMENT, Torn, united
from numpy.typing import ArrayLike, NDArray

from mesh_motion_client.mesh import finite_rows

__all__ = ["boundary_rows"]


def boundary_rows(
    displacements: ArrayLike | Mapping[str, ArrayLike],
    moving_nodes: NDArray[np.int64],
    patches: Mapping[str, NDArray[np.int64]],
    *,
    dimension: int,
    extent: float | None,
    what: str = "displacements",
) -> NDArray[np.float64]:
    """Return (k, d) displacements, or other values named ``what``, in the order of the moving nodes.

    Parameters
    ----------
    displacements : (k, d) array, mesh length unit, or dict
        In the order of ``moving_nodes``; or patch name → (p, d) array in the order of the patch's nodes.
    moving_nodes : (k,) int64 array
        Ascending.
    patches : dict of (p,) int64 arrays
        The nodes of each moving patch; each moving node is on one of them.
    extent : float or None
        Longest side of the bounding box of the whole mesh, mesh length unit: the values of two patches at one node may
        differ by a share of it. None: by a share of the largest value.

    Raises
    ------
    InvalidInput
        For a wrong shape or name, a value that is not finite, or a node that two patches move to different places.
    """
    if isinstance(displacements, Mapping):
        given = _by_patch(displacements, patches, dimension, what)
        if extent is None:
            extent = max((float(np.abs(rows).max(initial=0.0)) for rows in given), default=0.0)
        return _united(given, moving_nodes, patches, extent) if given else np.empty((0, dimension))
    rows = finite_rows(displacements, what)
    wanted = (len(moving_nodes), dimension)
    if rows.shape != wanted:
        raise InvalidInput(
            f"{what} must have shape {wanted}, one row for each moving node, got {rows.shape}",
            code="INVALID_ARGUMENT.SHAPE",
            hint="session.moving_nodes has the order of the rows",
        )
    return rows


def _by_patch(
    displacements: Mapping[str, ArrayLike], patches: Mapping[str, NDArray[np.int64]], dimension: int, what: str
) -> list[NDArray[np.float64]]:
    """(p, d) displacements of each patch, in the order of ``patches``."""
    if set(displacements) != set(patches):
        alike = [meant(name, patches) for name in displacements if name not in patches]
        raise InvalidInput(
            f"{what} must name the moving patches {sorted(patches)}, got {sorted(displacements)}",
            hint=next(filter(None, alike), "or give rows in the order of session.moving_nodes"),
        )
    given = [finite_rows(displacements[name], f"{what} of patch {name!r}") for name in patches]
    for (name, nodes), rows in zip(patches.items(), given, strict=True):
        if rows.shape != (len(nodes), dimension):
            raise InvalidInput(
                f"{what} of patch {name!r} must have shape {(len(nodes), dimension)}, got {rows.shape}",
                code="INVALID_ARGUMENT.SHAPE",
            )
    return given


def _united(
    given: list[NDArray[np.float64]],
    moving_nodes: NDArray[np.int64],
    patches: Mapping[str, NDArray[np.int64]],
    extent: float,
) -> NDArray[np.float64]:
    """Join the displacements of all patches to (k, d) displacements of the moving nodes."""
    places = [np.searchsorted(moving_nodes, nodes) for nodes in patches.values()]
    try:
        return united(given, places, len(moving_nodes), extent)
    except Torn as torn:
        one, other = (repr(list(patches)[part]) for part in torn.parts)
        raise InvalidInput(
            f"node {int(moving_nodes[torn.place])} lies on the patches {one} and {other}, which move it to different "
            f"places: by {torn.values[0].tolist()} and {torn.values[1].tolist()}",
            hint=f"the two must agree to {AGREEMENT:g} of the longest side of the mesh's bounding box",
        ) from None
