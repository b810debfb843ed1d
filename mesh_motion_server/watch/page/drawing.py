"""A mesh view as bytes that a browser copies to its graphics card without conversion.

::

    0   4     length of the header, little-endian
    4   …     header: JSON, spaces up to a multiple of 4; ``arrays`` lists [name, type, offset behind it, length]
    …   …     the arrays, little-endian: f4, u4, u1

``points`` (n, 3) are in units of half the mesh's extent from its centre, so that 32 bits suffice. Data that are
equal for all steps (triangles, edges, names of cells) are left out if the reader's ``key`` shows that it has them. If
its ``stamp`` shows that it also has the coordinates, only the header is sent.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from hashlib import sha256
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mesh_motion_server.numerics.arrays import Integers
from mesh_motion_server.watch.observation.mesh_surface import Surface
from mesh_motion_server.watch.observation.mesh_view import MeshView

__all__ = ["Packer"]


class Packer:
    """Packs the views of one mesh; data that are equal for all steps are packed once."""

    def __init__(self) -> None:
        self._fixed: _Fixed | None = None

    def pack(self, view: MeshView, have: str = "", seen: str = "") -> bytes:
        """Pack a view into bytes.

        Parameters
        ----------
        have, seen : str
            The key and the stamp of the reader's data.
        """
        if self._fixed is None or self._fixed.surface is not view.surface:
            self._fixed = _Fixed.of(view)
        fixed = self._fixed
        low, high = view.box
        centre, half = (low + high) / 2, float(max((high - low).max() / 2, np.finfo(float).tiny))
        points = np.zeros((len(fixed.nodes), 3))
        points[:, : view.dimension] = (view.points[fixed.nodes] - centre) / half
        moving: dict[str, NDArray[Any]] = {
            "points": points.astype("<f4"),
            "quality": np.nan_to_num(view.quality[view.cells], neginf=-9.0).astype("<f4"),
            "inverted": view.inverted[view.cells].astype("<u1"),
        }
        header = {
            "step": view.step,
            "committed": view.committed,
            "dimension": view.dimension,
            "metric": view.metric,
            "threshold": view.threshold,
            "minimum": float(np.nanmin(view.quality)),
            "cells": len(view.quality),
            "shown": len(view.cells),
            "inverted_cells": int(np.count_nonzero(view.inverted)),
            "below": int(np.count_nonzero(view.quality < view.threshold)),
            "whole": view.whole,
            "centre": [*centre.tolist(), 0.0, 0.0][:3],
            "half": half,
            "types": view.names.types,
            "key": fixed.key,
            "stamp": _digest(moving),
        }
        if have != fixed.key:
            return _packed(header, moving | fixed.arrays)
        return _packed(header, {} if seen == header["stamp"] else moving)


@dataclass(frozen=True, eq=False)
class _Fixed:
    """The constant data of a surface: its nodes (k,) and the arrays that refer to them."""

    surface: Surface
    nodes: Integers
    arrays: dict[str, NDArray[Any]]
    key: str

    @classmethod
    def of(cls, view: MeshView) -> _Fixed:
        """Of a view's surface and the cells on it."""
        surface, names = view.surface, view.names
        nodes = np.unique(np.concatenate([surface.triangles.ravel(), surface.edges.ravel(), surface.outline.ravel()]))
        arrays: dict[str, NDArray[Any]] = {
            "triangles": np.searchsorted(nodes, surface.triangles).astype("<u4"),
            "edges": np.searchsorted(nodes, surface.edges).astype("<u4"),
            "outline": np.searchsorted(nodes, surface.outline).astype("<u4"),
            "owners": _owners(view).astype("<u4"),
            "inner": surface.inner.astype("<u1"),
            "kind": names.kind.astype("<u1"),
            "partition": names.partition.astype("<u4"),
            "local": names.local.astype("<u4"),
        }
        return cls(surface, nodes, arrays, _digest(arrays))


def _owners(view: MeshView) -> Integers:
    """Index of each triangle's cell among the shown cells; the number of shown cells if unknown."""
    owners = view.surface.owners
    return np.where(owners < 0, len(view.cells), np.searchsorted(view.cells, owners))


def _digest(arrays: dict[str, NDArray[Any]]) -> str:
    digest = sha256()
    for array in arrays.values():
        digest.update(np.ascontiguousarray(array).data)
    return digest.hexdigest()[:16]


def _packed(header: dict[str, Any], arrays: dict[str, NDArray[Any]]) -> bytes:
    listed, offset = [], 0
    for name, array in arrays.items():
        listed.append([name, array.dtype.str[1:], offset, array.size])
        offset += array.nbytes + -array.nbytes % 4
    head = json.dumps(header | {"arrays": listed}, allow_nan=False, separators=(",", ":")).encode()
    head += b" " * (-len(head) % 4)
    parts = [len(head).to_bytes(4, "little"), head]
    for array in arrays.values():
        parts += [np.ascontiguousarray(array).tobytes(), bytes(-array.nbytes % 4)]
    return b"".join(parts)
