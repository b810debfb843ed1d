"""The mesh of a session during the upload: parts per partition, item and name, checked on arrival and counted."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from mesh_motion_numerics.arrays import Integers
from mesh_motion_numerics.mesh.cells import CELL_TYPES
from mesh_motion_numerics.mesh.roles import ROLES, Patch
from mesh_motion_protocol.errors import InvalidInput, ResourceExhausted
from numpy.typing import NDArray

from mesh_motion_server.session.partitions.facets import FACET_NODES
from mesh_motion_server.session.partitions.meshes import PartitionMesh, joined

#: Items that may be uploaded.
ITEMS = ("nodes", "global_ids", "cells", "facets", "near_cells", "patch")

_KINDS = {"f": "float", "i": "integer"}
#: Bytes that count for one number, at any width on the wire.
_ITEM_BYTES = 8
_Key = tuple[str, str]
_Rows = NDArray[Any]


@dataclass(frozen=True, eq=False)
class Part:
    """One part of one item."""

    item: str  # one of :data:`ITEMS`
    name: str  # the type of the cells or facets, or the patch's name
    role: str  # the patch's role
    rows: NDArray[Any]  # (k, c). float64 coordinates, or int64 indices and ids; cells also int32


@dataclass
class _Pile:
    """The parts of one partition by (item, name), and the roles of its patches."""

    parts: dict[_Key, list[_Rows]] = field(default_factory=dict)
    roles: dict[str, str] = field(default_factory=dict)

    def drop_last(self, key: _Key) -> None:
        """Remove the last part of an item; with its only part, also a patch's role."""
        self.parts[key].pop()
        if not self.parts[key]:
            del self.parts[key]
            if key[0] == "patch":
                del self.roles[key[1]]

    def has(self, item: str) -> bool:
        """Whether any row of an item has arrived."""
        return any(len(rows) for (of, _), pieces in self.parts.items() if of == item for rows in pieces)

    def whole(self) -> dict[_Key, _Rows]:
        """Each item's rows (except cells) in one array, which replaces its parts."""
        for key, rows in self.parts.items():
            if key[0] != "cells":
                self.parts[key] = [joined(rows)]
        return {key: rows[0] for key, rows in self.parts.items() if key[0] != "cells"}


@dataclass(frozen=True, eq=False)
class _Added:
    """The record of an added part: pile, item and name, bytes on arrival."""

    pile: _Pile
    key: _Key
    nbytes: int


class MeshUpload:
    """Collects the parts of all partitions.

    Parameters
    ----------
    byte_budget : int
        Limit for all parts together.
    evaluation : {"server", "client"}
        With "client", cells are rows without columns: only their number is used.

    Attributes
    ----------
    reach : float
        Distance from the moving walls within which cells were requested, mesh length unit; 0: not requested yet.
    """

    def __init__(self, dimension: int, partitions: int, byte_budget: int, evaluation: str = "server") -> None:
        self._dimension = dimension
        self._evaluation = evaluation
        self._budget = byte_budget
        self._piles = [_Pile() for _ in range(partitions)]
        self._added: list[_Added] = []
        self.nbytes = 0
        self.reach = 0.0

    @property
    def count(self) -> int:
        """Number of parts."""
        return len(self._added)

    def add(self, partition: int, part: Part) -> int:
        """Append one part; return the number of rows that the partition has now for this item and name.

        Raises InvalidInput on an unknown item, name or role, a wrong shape or type, or a coordinate that is not finite.
        Raises ResourceExhausted if the session's byte budget is exceeded.
        """
        pile = self._piles[partition]
        self._check(part, partition, pile)
        nbytes = _ITEM_BYTES * part.rows.size
        if self.nbytes + nbytes > self._budget:
            raise ResourceExhausted(
                f"the upload would take {self.nbytes + nbytes} bytes; a session may take {self._budget}",
                hint="raise the server's max_session_bytes",
                details={"bytes": self.nbytes + nbytes, "limit": self._budget},
            )
        kept = _kept(part)
        rows = pile.parts.setdefault((part.item, part.name), [])
        self._added.append(_Added(pile, (part.item, part.name), nbytes))
        rows.append(kept)
        self.nbytes += nbytes
        if part.item == "patch":
            pile.roles[part.name] = part.role
        return sum(len(r) for r in rows)

    def back_to(self, count: int) -> None:
        """Remove the parts after the first ``count``: their requests failed although the parts had been stored."""
        while len(self._added) > count:
            added = self._added.pop()
            self.nbytes -= added.nbytes
            added.pile.drop_last(added.key)

    def check_reaches(self, reaches: Sequence[float]) -> None:
        """Check that the reach that each partition names for cells near moving walls was requested.

        Raises InvalidInput naming the first partition whose reach is neither 0 nor :attr:`reach`.
        """
        for partition, reach in enumerate(reaches):
            if reach not in (0.0, self.reach):
                asked = (
                    f"0 or {self.reach!r}, that of BUILT" if self.reach else "0, because no BUILT has had a reach yet"
                )
                raise InvalidInput(
                    f"partition {partition}: BUILD has the reach {reach!r}, expected {asked}",
                    code="INVALID_ARGUMENT.VALUE",
                    hint="send the cells within the reach of BUILT as near_cells, then BUILD with this reach",
                    details={"partition": partition, "field": "reach", "value": reach},
                )

    def without_layers(self, reaches: Sequence[float | None]) -> list[int]:
        """The partitions without facets or cells near moving walls, because of which no layer can be carried."""
        piles = enumerate(zip(self._piles, reaches, strict=True))
        return [p for p, (pile, reach) in piles if reach is None or (pile.has("cells") and not pile.has("facets"))]

    def meshes(self) -> list[PartitionMesh]:
        """Each partition's mesh from its parts.

        Raises InvalidInput if a partition sent no nodes, or if needed global ids are missing.
        """
        return [self._mesh(number, pile) for number, pile in enumerate(self._piles)]

    def clear(self) -> None:
        """Remove all parts."""
        self._piles = [_Pile() for _ in self._piles]
        self._added = []
        self.nbytes = 0

    def _mesh(self, number: int, pile: _Pile) -> PartitionMesh:
        whole = pile.whole()
        if ("nodes", "") not in whole:
            raise InvalidInput(
                f"partition {number} sent no nodes",
                code="INVALID_ARGUMENT.MESH",
                hint="send UPLOAD with item 'nodes'; without rows if the partition has none",
                details={"partition": number},
            )
        points = whole["nodes", ""]
        return PartitionMesh(
            points=points.astype(np.float64, copy=False),
            global_ids=self._global_ids(number, len(points), whole.get(("global_ids", ""))),
            cells={name: tuple(rows) for (item, name), rows in pile.parts.items() if item == "cells"},
            patches={
                name: Patch(pile.roles[name], rows[:, 0]) for (item, name), rows in whole.items() if item == "patch"
            },
            facets={name: rows for (item, name), rows in whole.items() if item == "facets" and len(rows)},
            near={name: rows for (item, name), rows in whole.items() if item == "near_cells" and len(rows)},
        )

    def _global_ids(self, number: int, count: int, rows: _Rows | None) -> Integers:
        """(n,) ids as sent; for a single partition the local indices."""
        if rows is not None:
            return rows[:, 0]
        if len(self._piles) > 1:
            raise InvalidInput(
                f"partition {number} sent no global ids",
                code="INVALID_ARGUMENT.PARTITION",
                hint="with more than one partition, UPLOAD item 'global_ids' with one id per node",
                details={"partition": number},
            )
        return np.arange(count)

    def _columns(self, part: Part) -> int:
        """Number of columns of a part with known item and name."""
        match part.item:
            case "nodes":
                return self._dimension
            case "cells" if self._evaluation == "client":
                return 0
            case "cells" | "near_cells":
                return CELL_TYPES[part.name].n_nodes
            case "facets":
                return FACET_NODES[part.name]
        return 1

    def _check(self, part: Part, partition: int, pile: _Pile) -> None:
        """Check item, name, role, shape, type and finiteness of one part."""
        _check_names(part, self._dimension, pile.roles)
        if part.item in ("facets", "near_cells") and self._evaluation == "server":
            raise _wrong_value(
                f"UPLOAD of {part.item}: the server has the cells, expected evaluation = 'client'", item=part.item
            )
        expected = self._columns(part)
        if part.rows.ndim != 2 or part.rows.shape[1] != expected:
            raise InvalidInput(
                f"UPLOAD of {_title(part)}: expected an array of shape (k, {expected}), got {part.rows.shape}",
                code="INVALID_ARGUMENT.SHAPE",
                details={"partition": partition, "item": part.item, "name": part.name},
            )
        kind = "f" if part.item == "nodes" else "i"
        if part.rows.dtype.kind != kind:
            raise InvalidInput(
                f"UPLOAD of {_title(part)}: expected {_KINDS[kind]} rows, got {part.rows.dtype}",
                code="INVALID_ARGUMENT.DTYPE",
                details={"partition": partition, "item": part.item, "name": part.name},
            )
        if kind == "f":
            before = sum(len(rows) for rows in pile.parts.get(("nodes", ""), ()))
            _check_finite(part.rows, partition, before)


def _kept(part: Part) -> _Rows:
    """Rows of 8 bytes an item; cells (k, c) of 4 if node numbers fit, because an upload is kept until BUILD."""
    rows = part.rows
    if part.item != "cells":
        return rows.astype(np.float64 if part.item == "nodes" else np.int64, copy=False)
    limits = np.iinfo(np.int32)
    fits = rows.size and rows.min() >= limits.min and rows.max() <= limits.max
    return rows.astype(np.int32, copy=False) if fits else rows.astype(np.int64, copy=False)


def _title(part: Part) -> str:
    return f"{part.item} {part.name!r}" if part.name else part.item


def _check_names(part: Part, dimension: int, roles: dict[str, str]) -> None:
    """Check that item, cell type, patch name and role are known and agree with earlier parts."""
    if part.item not in ITEMS:
        raise _wrong_value(f"UPLOAD: unknown item {part.item!r}; known are {', '.join(ITEMS)}", item=part.item)
    if part.item in ("cells", "near_cells"):
        _check_cell_type(part.name, dimension)
    elif part.item == "facets":
        _check_facet_type(part.name, dimension)
    elif part.item == "patch":
        _check_patch(part, roles)
    elif part.name:
        raise _wrong_value(f"UPLOAD of {part.item}: takes no name, got {part.name!r}", item=part.item, name=part.name)
    if part.role and part.item != "patch":
        raise _wrong_value(f"UPLOAD of {_title(part)}: only patches have a role, got {part.role!r}", role=part.role)


def _check_cell_type(name: str, dimension: int) -> None:
    known = [t.name for t in CELL_TYPES.values() if t.dimension == dimension]
    if name not in known:
        raise _wrong_value(
            f"UPLOAD of cells: {name!r} is not a cell type of a {dimension}D mesh; those are {', '.join(known)}",
            type=name,
        )


def _check_facet_type(name: str, dimension: int) -> None:
    known = {1: ("vertex",), 2: ("line",), 3: ("triangle", "quad")}[dimension]
    if name not in known:
        raise _wrong_value(
            f"UPLOAD of facets: {name!r} is not a facet of a {dimension}D mesh; those are {', '.join(known)}", type=name
        )


def _check_patch(part: Part, roles: dict[str, str]) -> None:
    if not part.name:
        raise _wrong_value("UPLOAD of a patch: a name is required", item=part.item)
    if part.role not in ROLES:
        raise _wrong_value(
            f"UPLOAD of patch {part.name!r}: unknown role {part.role!r}; known are {', '.join(ROLES)}",
            patch=part.name,
            value=part.role,
        )
    if roles.get(part.name, part.role) != part.role:
        raise _wrong_value(
            f"UPLOAD of patch {part.name!r}: role {part.role!r}, but earlier parts have {roles[part.name]!r}",
            patch=part.name,
            value=part.role,
        )


def _wrong_value(message: str, **details: str) -> InvalidInput:
    """The error for an item, name or role outside the table of SPEC.md's section 13."""
    return InvalidInput(message, code="INVALID_ARGUMENT.VALUE", details=dict(details))


def _check_finite(rows: _Rows, partition: int, before: int) -> None:
    """Refuse NaN and infinity; names the partition's node."""
    bad = np.argwhere(~np.isfinite(rows))
    if len(bad):
        row, axis = (int(i) for i in bad[0])
        raise InvalidInput(
            f"partition {partition}, node {before + row}: coordinate {axis} is {rows[row, axis]}",
            code="INVALID_ARGUMENT.NONFINITE",
            hint="every coordinate must be finite",
            details={"partition": partition, "node": before + row, "value": str(rows[row, axis])},
        )
