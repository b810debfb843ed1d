"""BUILD of meshes that cannot be moved: indices, cells, patches, periodic sides, partitions, sizes."""

from collections.abc import Callable
from typing import Any

import numpy as np

from tests.faults.inputs.cases import BadInput, Names, Rng
from tests.faults.inputs.drafts import Draft, Part, Rows

_MESH, _DEGENERATE = "INVALID_ARGUMENT.MESH", "INVALID_ARGUMENT.MESH_DEGENERATE"
_PARTITION, _SHAPE = "INVALID_ARGUMENT.PARTITION", "INVALID_ARGUMENT.SHAPE"
Spoil = Callable[[Draft, Rng], Names]


def _row(name: str, code: str, spoil: Spoil, *says: str, draft: str = "square", mended: bool = False) -> BadInput:
    return BadInput(name, "build", spoil, code, says, draft=draft, mended=mended)


# --- indices ---------------------------------------------------------------------------------------------------------


def _cell_index(value: int, dtype: type[Any] = np.int64) -> BadInput:
    def spoil(draft: Draft, rng: Rng) -> Names:
        cells = draft.rows("cells", "triangle").astype(dtype)
        row = int(rng.integers(len(cells)))
        cells[row, rng.integers(3)] = value
        draft.replace("cells", "triangle", cells)
        return {"partition": 0, "type": "triangle", "row": row, "value": value}

    return _row(f"a cell with node {value} ({dtype.__name__})", _MESH, spoil, "row", str(value), "0 … 24")


def _patch_index(value: int) -> BadInput:
    def spoil(draft: Draft, rng: Rng) -> Names:
        row = int(rng.integers(5))
        draft.rows("patch", "left")[row, 0] = value
        return {"partition": 0, "patch": "left", "row": row, "value": value}

    return _row(f"a patch with node {value}", _MESH, spoil, "'left'", str(value), "0 … 24")


_INDICES = (
    *(_cell_index(value) for value in (-1, 25, 2**31 - 1, 2**31, 2**32, 2**62, 2**63 - 1, -(2**63))),
    *(_cell_index(value, np.int32) for value in (-1, 25, 2**31 - 1, -(2**31))),
    *(_patch_index(value) for value in (-1, 25, 2**32, 2**63 - 1, -(2**63))),
)

# --- cells -----------------------------------------------------------------------------------------------------------


_CELL: Names = {"cell": lambda cell: isinstance(cell, int)}
_INVERTED: Names = {**_CELL, "determinant": lambda d: d < 0}


def _moved(where: Any, places: Any, names: Names) -> Spoil:
    """These nodes, or some of their coordinates, get other values."""

    def spoil(draft: Draft, rng: Rng) -> Names:
        draft.points[where] = places
        return names

    return spoil


def _renumbered(kind: str, order: list[int], names: Names, *, each: bool = False) -> Spoil:
    """One cell, or each of them, has its nodes in another order."""

    def spoil(draft: Draft, rng: Rng) -> Names:
        cells = draft.rows("cells", kind)
        cell: Any = slice(None) if each else int(rng.integers(len(cells)))
        cells[cell] = cells[cell][..., order]
        return names if names else {"cell": cell}

    return spoil


def _added(order: list[int], names: Callable[[int], Names]) -> Spoil:
    """One of the 32 triangles once more, with its nodes in this order."""

    def spoil(draft: Draft, rng: Rng) -> Names:
        cells = draft.rows("cells", "triangle")
        cell = int(rng.integers(len(cells)))
        draft.replace("cells", "triangle", np.concatenate([cells, cells[[cell]][:, order]]))
        return names(cell)

    return spoil


def _overlapping(draft: Draft, rng: Rng) -> Names:
    draft.replace("cells", "triangle", np.concatenate([draft.rows("cells", "triangle"), [[0, 1, 6]]]))
    return {"facet": lambda facet: len(facet) == 2, "cells": lambda cells: 32 in cells}


_CELLS = (
    _row("a cell with a node twice", _DEGENERATE, _renumbered("triangle", [0, 1, 0], {}), "names a node twice"),
    _row("a flat cell", _DEGENERATE, _moved(6, [0.0, 0.125], {**_CELL, "determinant": lambda d: d <= 1e-12}),
         "cell", "determinant"),
    _row("a cell that is flat apart from rounding", _DEGENERATE, _moved(6, [1e-16, 0.125], _CELL), "is flat"),
    _row("two inner nodes in one place", _DEGENERATE, _moved(12, [0.25, 0.25], _CELL), "cell", "determinant"),
    _row("all nodes in one place", _DEGENERATE, _moved(slice(None), 0.5, {"cell": 0, "count": 32}), "cell 0"),
    _row("a folded mesh", _DEGENERATE, _moved(12, [3.0, 0.5], _INVERTED), "cell", "inverted"),
    _row("a twisted hexahedron", _DEGENERATE, _renumbered("hexahedron", [0, 1, 2, 3, 7, 6, 5, 4], {}), "cell",
         "inverted", draft="cube"),
    _row("a crossed quadrilateral", _DEGENERATE, _renumbered("quad", [0, 2, 1, 3], _CELL), "cell", "inverted",
         draft="quads"),
    _row("quadrilaterals in another node order", _DEGENERATE,
         _renumbered("quad", [0, 1, 3, 2], {"count": 12}, each=True), "12 such cells", draft="quads"),
    _row("a cell twice", _MESH, _added([0, 1, 2], lambda cell: {"type": "triangle", "cells": [cell, 32]}), "cell 32",
         "'triangle'"),
    _row("the same cell, begun elsewhere", _DEGENERATE,
         _added([1, 2, 0], lambda cell: {"facet": lambda facet: len(facet) == 2,
                                         "cells": lambda cells: {cell, 32} <= set(cells)}), "facet", "32"),
    _row("a cell over others", _DEGENERATE, _overlapping, "facet", "32"),
    _row("1D, a folded mesh", _DEGENERATE, _moved([1, 2], [[0.5], [0.25]], {"cell": lambda cell: cell in range(4)}),
         "inverted", draft="line"),
)  # fmt: skip

# --- what is missing, patches ----------------------------------------------------------------------------------------


def _without(item: str, name: str, names: Names) -> Spoil:
    def spoil(draft: Draft, rng: Rng) -> Names:
        draft.drop(item, name)
        return names

    return spoil


def _without_patches(draft: Draft, rng: Rng) -> Names:
    draft.parts[0] = [part for part in draft.parts[0] if part.item != "patch"]
    return {}


def _patch(name: str, role: str, nodes: Any, names: Names) -> Spoil:
    """One more patch; if the name exists, other nodes for that patch."""

    def spoil(draft: Draft, rng: Rng) -> Names:
        if any(part.name == name for part in draft.parts[0]):
            draft.drop("patch", name)
        draft.add_patch(name, role, nodes)
        return names

    return spoil


def _ids(values: Any) -> Spoil:
    def spoil(draft: Draft, rng: Rng) -> Names:
        draft.parts[0].append(Part("global_ids", "", "", Rows(np.asarray(values)[:, None])))
        return {"partition": 0}

    return spoil


_ON_LOW: Names = {"patch": "low", "node": lambda node: node in range(5)}
_ON_SIDES: Names = {
    "patch": lambda patch: patch in {"low", "high"},
    "node": lambda node: node in {*range(5), *range(20, 25)},
}
_IMAGES: Names = {"node": lambda node: node in {2, 22}, "image": lambda node: node in {2, 22}}
_PATCHES = (
    _row("no nodes", _MESH, _without("nodes", "", {"partition": 0}), "partition 0", mended=True),
    _row("no cells", _MESH, _without("cells", "triangle", {}), "no cells", mended=True),
    _row("no patches", _MESH, _without_patches, "'moving'", "none", mended=True),
    _row("no moving patch", _MESH, _without("patch", "left", {}), "'moving'", "'walls'", mended=True),
    *(
        _row(f"a {role} patch without nodes", _MESH, _patch("empty", role, [], {"patch": "empty"}), "'empty'")
        for role in ("moving", "fixed", "slip", "periodic")
    ),
    _row("fewer global ids than nodes", _SHAPE, _ids(np.arange(24)), "25", "24"),
    _row("a global id twice", _MESH, _ids([*range(24), 7]), "7"),
    _row("a slip node inside the mesh", _MESH, _patch("loose", "slip", [12], {"node": 12, "patch": "loose"}), "node 12",
         "'loose'"),
    _row("a symmetry line that is bent", _MESH, _moved((slice(1, 4), 1), [-0.02, -0.03, -0.02],
         {"patch": "mirror", "node": lambda node: node in range(5)}), "'mirror'", "plan", draft="symmetric"),
    _row("a periodic patch without a partner", _MESH, _without("patch", "high", {"patch": "low"}), "'low'",
         draft="periodic", mended=True),
    _row("periodic sides with other spacing", _MESH, _moved((21, 0), 0.3, _ON_SIDES), "node", draft="periodic"),
    _row("a periodic side that is shorter", _MESH, _patch("high", "periodic", range(20, 24), _ON_LOW), "'low'", "node",
         draft="periodic"),
    _row("a side that is its own image", _MESH, _patch("high", "periodic", range(5), {"patch": _ON_SIDES["patch"]}),
         "'low'", draft="periodic"),
    _row("a fixed node with a free image", _MESH, _patch("right", "fixed", [*range(4, 25, 5), 2], _IMAGES), "node 2",
         draft="periodic"),
)  # fmt: skip

# --- partitions ------------------------------------------------------------------------------------------------------


def _other_coordinates(draft: Draft, rng: Rng) -> Names:
    node = int(rng.integers(5))  # the first nodes of the second partition are the last ones of the first
    draft.rows("nodes", "", 1)[node, 0] += 1e-6
    return {"global_id": int(draft.rows("global_ids", "", 1)[node, 0]), "partitions": [0, 1]}


def _id_twice(draft: Draft, rng: Rng) -> Names:
    ids = draft.rows("global_ids", "", 1)
    ids[-1] = ids[-2]
    return {"partition": 1, "global_id": int(ids[-2, 0])}


def _no_ids(draft: Draft, rng: Rng) -> Names:
    draft.drop("global_ids", "", 1)
    return {"partition": 1}


def _no_nodes_there(draft: Draft, rng: Rng) -> Names:
    draft.parts[1] = [draft.part("global_ids", "", 1)]
    return {"partition": 1}


def _other_role(draft: Draft, rng: Rng) -> Names:
    draft.part("patch", "walls", 1).role = "slip"
    return {"patch": "walls", "partitions": [0, 1]}


def _cell_in_both(draft: Draft, rng: Rng) -> Names:
    """Global ids that make a cell of the second partition one of the first."""
    own, first = draft.rows("global_ids", "", 1), draft.rows("global_ids", "", 0)
    draft.rows("nodes", "", 1)[:] = draft.rows("nodes", "", 0)[: len(own)]
    own[:] = first[: len(own)]
    draft.replace("cells", "triangle", draft.rows("cells", "triangle", 0)[:4], 1)
    draft.parts[1] = [part for part in draft.parts[1] if part.item != "patch"]
    return {"type": "triangle", "partitions": [0, 1]}


def _index_there(draft: Draft, rng: Rng) -> Names:
    cells = draft.rows("cells", "triangle", 1)
    cells[3, 1] = len(draft.rows("nodes", "", 1))
    return {"partition": 1, "row": 3, "value": int(cells[3, 1])}


def _folded_there(draft: Draft, rng: Rng) -> Names:
    """The corner that is missing in the first partition passes through its only cell."""
    (corner,) = np.flatnonzero(draft.rows("global_ids", "", 1)[:, 0] == 24)
    draft.rows("nodes", "", 1)[corner] = 0.8
    (row,) = np.flatnonzero((draft.rows("cells", "triangle", 1) == corner).any(axis=1))
    return {"partition": 1, "type": "triangle", "cell": int(row), "count": 1}


_PARTITIONS = (
    _row("partitions with other coordinates", _PARTITION, _other_coordinates, "global id", draft="halves"),
    _row("a global id twice in a partition", _MESH, _id_twice, "partition 1", draft="halves"),
    _row("a partition without global ids", _PARTITION, _no_ids, "partition 1", draft="halves", mended=True),
    _row("a partition without nodes", _MESH, _no_nodes_there, "partition 1", draft="halves"),
    _row("a patch with two roles", _PARTITION, _other_role, "'walls'", "'slip'", draft="halves"),
    _row("a cell in two partitions", _PARTITION, _cell_in_both, "partition 0", "partition 1", draft="halves"),
    _row("a wrong index in the second partition", _MESH, _index_there, "partition 1", "row 3", draft="halves"),
    _row("an inverted cell in the second partition", _DEGENERATE, _folded_there, "inverted", draft="halves"),
)

# --- sizes -----------------------------------------------------------------------------------------------------------


def _scaled(factor: float, draft: str) -> BadInput:
    """Coordinates whose squares and products leave the floating-point range."""

    def spoil(scaled: Draft, rng: Rng) -> Names:
        scaled.points[:] *= factor
        return {"value": lambda value: 0.5 * factor < float(value) < 4 * factor}

    return _row(f"{draft} × {factor:g}", _MESH, spoil, f"{factor:.3g}"[-4:], draft=draft)


def _offset(draft: Draft, rng: Rng) -> Names:
    """Coordinates so large that neighbouring nodes become equal."""
    draft.points[:] += 1e17
    return {"cell": 0}


def _grazing(draft: Draft, rng: Rng) -> Names:
    """Coordinates so large that they are rounded to 1/8, the length of two edges."""
    draft.points[:] = 1e15 + 0.25 * draft.points
    return {"cell": 0}


_SIZES = (
    *(_scaled(factor, "square") for factor in (1e200, 1e160, 1e25, 1e-25, 1e-200, 1e-310)),
    *(_scaled(factor, "cube") for factor in (1e120, 1e-120)),
    _row("an offset of 10¹⁷", _DEGENERATE, _offset, "cell 0"),
    _row("an offset that rounds edges away", _DEGENERATE, _grazing, "cell"),
)

BAD_MESHES = (*_INDICES, *_CELLS, *_PATCHES, *_PARTITIONS, *_SIZES)
