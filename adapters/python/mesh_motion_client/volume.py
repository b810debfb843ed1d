"""The volume of a mesh whose field the client evaluates: the server has the boundary only.

The client moves nodes and judges cells with the server's numerics, which are imported when the first such session is
opened (``pip install 'mesh-motion-client[ranks]'``); no other part of the client needs them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from mesh_motion_protocol.errors import InvalidInput
from mesh_motion_protocol.messages import Corrected, Fetched, Moved, TangentFound, Upload
from numpy.typing import NDArray

from mesh_motion_client.mesh import Mesh, Patch, uploads

__all__ = ["Volume"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


class Volume:
    """The nodes and cells of a partition, as one rank holds them."""

    def __init__(self, mesh: Mesh) -> None:
        try:
            # an extra
            from mesh_motion_numerics.distributed.field import Field  # noqa: PLC0415
            from mesh_motion_numerics.distributed.rank import Rank  # noqa: PLC0415
            from mesh_motion_numerics.distributed.region import Extent  # noqa: PLC0415
        except ImportError as error:
            raise InvalidInput(
                f"evaluation = 'client' needs the numerics, which cannot be imported: {error}",
                hint="pip install 'mesh-motion-client[ranks]'",
            ) from error
        self._mesh, self._field, self._extent = mesh, Field, Extent
        self._known: tuple[list[dict[str, Any]], Floats, Floats, Floats] | None = None
        on_patches = [np.empty(0, dtype=np.int64), *(patch.nodes for patch in mesh.patches.values())]
        self._rank = Rank(mesh.points, mesh.cells, np.concatenate(on_patches))
        self._order = None if mesh.global_ids is None else np.argsort(mesh.global_ids)

    @property
    def nodes(self) -> Ints:
        """(b,) nodes that are uploaded, in the order of the upload."""
        return np.asarray(self._rank.nodes)

    @property
    def field_known(self) -> bool:
        """Whether a MOVED may contain only the coefficients of the field."""
        return self._known is not None

    def parts(self, **at: Any) -> Iterator[Upload]:
        """Yield the UPLOADs of the boundary with its facets, and of the number of cells of each type."""
        mesh, nodes = self._mesh, self.nodes
        ids = nodes if mesh.global_ids is None else mesh.global_ids[nodes]
        patches = {name: Patch(patch.role, np.searchsorted(nodes, patch.nodes)) for name, patch in mesh.patches.items()}
        yield from Mesh(mesh.points[nodes], {}, patches, ids).parts(**at)
        for name, cells in mesh.cells.items():
            yield Upload(**at, item="cells", name=name, rows=np.empty((len(cells), 0), dtype=np.int64))
        for name, rows in self._rank.facets.items():
            yield from uploads(rows, **at, item="facets", name=name)

    def near(self, wall: Floats, reach: float, **at: Any) -> Iterator[Upload]:
        """Yield the UPLOADs of more cells: those around nodes within ``reach`` of facets (f, d d) of moving walls."""
        mesh, d = self._mesh, self._mesh.points.shape[1]
        nodes, cells = self._rank.near(wall.reshape(-1, d, d), reach)
        ids = nodes if mesh.global_ids is None else mesh.global_ids[nodes]
        if len(nodes):
            yield from uploads(mesh.points[nodes], **at, item="nodes")
            yield from uploads(ids[:, None], **at, item="global_ids")
        for name, rows in cells.items():
            yield from uploads(rows, **at, item="near_cells", name=name)

    def take_again(self, fetched: Fetched) -> bool:
        """Store which nodes were uploaded; return whether the fetched reference coordinates (b, d) are theirs."""
        if fetched.nodes is not None:
            nodes, rows = self._here(fetched.nodes[len(self.nodes) :])
            self._rank.extend(nodes[np.argsort(rows)])
        return np.array_equal(fetched.points, self._mesh.points[self.nodes])

    def displacement(self, moved: Moved) -> Floats:
        """(n, d) displacement of all nodes from the reference mesh."""
        return self._rank.displacement(self._field_of(moved), moved.displacement)

    def coordinates(self, fetched: Fetched, corrected: Corrected | None) -> Floats:
        """(n, d) coordinates of all nodes, with the correction, if any."""
        points = self._mesh.points
        found = points + self._rank.displacement(self._field_of(fetched), np.zeros((len(self.nodes), points.shape[1])))
        found[self.nodes] = fetched.points
        if corrected is not None:
            nodes, rows = self._here(corrected.nodes)
            found[nodes] = points[nodes] + corrected.displacement[rows]
        return found

    def velocity(self, found: TangentFound) -> Floats:
        """(n, c d) velocities of all nodes, the components of c vectors one after the other."""
        assert found.coefficients is not None
        d, columns = self._mesh.points.shape[1], []
        for first in range(0, found.velocity.shape[1], d):
            of = slice(first, first + d)
            field = self._field_with(np.ascontiguousarray(found.coefficients[:, of]))
            columns.append(self._rank.velocity(field, found.velocity[:, of]))
        velocity = np.concatenate(columns, axis=1)
        assert found.freed is not None
        assert found.freed_velocity is not None
        nodes, rows = self._here(found.freed)
        velocity[nodes] = found.freed_velocity[rows]
        return velocity

    def counted(self, weights: Floats, corrected: Ints) -> dict[str, Floats | Ints]:
        """COTANGENT's fields for weights (n, c d) of all nodes.

        Parameters
        ----------
        corrected : (r,) int64 array
            Global ids of the nodes that the last CORRECT sent.
        """
        inside, _ = self._here(corrected)
        inside = np.setdiff1d(inside, self.nodes)
        ids = inside if self._mesh.global_ids is None else self._mesh.global_ids[inside]
        assert self._known is not None
        d, field = self._mesh.points.shape[1], self._field_with(self._known[3])
        vectors = [weights[:, first : first + d] for first in range(0, weights.shape[1], d)]
        return {
            "weights": weights[self.nodes],
            "coefficients": np.concatenate([self._rank.counted(field, one, inside) for one in vectors], axis=1),
            "region": ids,
            "region_weights": weights[inside],
        }

    def judge(self, displacement: Floats, metric: str) -> Callable[[list[dict[str, Any]]], dict[str, Any]]:
        """Judge the cells with the nodes displaced by (n, d); return JUDGE's fields for the server's questions."""
        return self._rank.judge(displacement, metric)

    def region(self, reply: Moved | Fetched, extent: dict[str, Any], around: Ints) -> dict[str, Any]:
        """Return CORRECT's fields: cells after the motion of a MOVED, or before the correction of a FETCHED.

        Parameters
        ----------
        extent : dict
            The ``region`` of a reply.
        around : (k,) int64 array
            Global ids; nodes of other partitions are ignored.
        """
        known = reply.displacement if isinstance(reply, Moved) else reply.points - self._mesh.points[self.nodes]
        nodes, _ = self._here(around)
        found = self._rank.region(self._field_of(reply), known, self._extent.of(extent), nodes).fields()
        if self._mesh.global_ids is not None:
            found["nodes"][:, 0] = self._mesh.global_ids[found["nodes"][:, 0]]
        return found

    def correct(self, displacement: Floats, corrected: Corrected) -> None:
        """Write the correction of this partition's freed nodes into a displacement (n, d) of all nodes."""
        nodes, rows = self._here(corrected.nodes)
        displacement[nodes] = corrected.displacement[rows]

    def _here(self, ids: Ints) -> tuple[Ints, Ints]:
        """The nodes of this partition among those with global ids (k,), and their rows in that array."""
        if self._order is None or self._mesh.global_ids is None:
            return ids, np.arange(len(ids))
        own = self._mesh.global_ids[self._order]
        at = np.minimum(np.searchsorted(own, ids), len(own) - 1)
        rows = np.flatnonzero(own[at] == ids)
        return self._order[at[rows]], rows

    def _field_of(self, reply: Moved | Fetched) -> Any:
        """Return the field of a reply; its parts that are constant in a session may have come earlier."""
        if reply.sums or self._known is None:
            self._known = reply.sums, np.array(reply.centres), np.array(reply.boxes), np.array(reply.coefficients)
        return self._field_with(np.array(reply.coefficients))

    def _field_with(self, coefficients: Floats) -> Any:
        """A field of this boundary."""
        assert self._known is not None
        return self._field(*self._known[:3], coefficients)
