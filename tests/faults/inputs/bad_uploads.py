"""UPLOAD of invalid parts: each is sent after the good parts, which stay as they are."""

from collections.abc import Callable
from typing import Any

import numpy as np

from tests.faults.inputs.cases import BadInput, Names, Rng
from tests.faults.inputs.drafts import Draft, Part, Rows

_VALUE, _SHAPE, _DTYPE = "INVALID_ARGUMENT.VALUE", "INVALID_ARGUMENT.SHAPE", "INVALID_ARGUMENT.DTYPE"
_FRAMES, _NONFINITE, _BYTES = "INVALID_ARGUMENT.FRAMES", "INVALID_ARGUMENT.NONFINITE", "RESOURCE_EXHAUSTED.BYTES"
_POINTS = np.zeros((3, 2))
_TRIANGLE = np.array([[0, 1, 5]])
_INDEX = np.array([[0]])
_DTYPES = ("<u8", "<f2", ">f8", "|O", "O", "<c16", "<M8[s]", "|S2147483647", "V1000000000", "f8", "", "{'names': ['']}")


def _part(item: str, name: str, role: str, rows: Rows | np.ndarray[Any, Any], /, **names: Any) -> Callable[..., Any]:
    sent = rows if isinstance(rows, Rows) else Rows(rows)
    return lambda *_: (Part(item, name, role, sent), names)


def _nonfinite(value: float, dtype: type[Any] = np.float64) -> BadInput:
    """A bad row in an additional part of the nodes: rows are counted over all parts."""

    def spoil(draft: Draft, rng: Rng) -> tuple[Part, Names]:
        points = draft.points.astype(dtype)
        row, axis = int(rng.integers(len(points))), int(rng.integers(2))
        points[row, axis] = value
        return Part("nodes", "", "", Rows(points)), {"partition": 0, "node": 25 + row, "value": str(value)}

    return BadInput(f"node at {value} ({dtype.__name__})", "upload", spoil, _NONFINITE, ("node", str(value)))


def _wire(name: str, code: str, rows: Rows, *says: str) -> BadInput:
    return BadInput(f"UPLOAD of nodes, {name}", "upload", _part("nodes", "", "", rows, field="rows"), code, says)


def _too_many(draft: Draft, rng: Rng) -> tuple[Part, Names]:
    return Part("nodes", "", "", Rows(np.zeros((5000, 2)))), {"limit": 1 << 16}


def _row(name: str, code: str, spoil: Callable[..., Any], *says: str) -> BadInput:
    return BadInput(name, "upload", spoil, code, says)


BAD_UPLOADS = (
    *(_nonfinite(value) for value in (np.nan, np.inf, -np.inf)),
    _nonfinite(np.nan, np.float32),
    *(
        _row(f"2D nodes with {k} columns", _SHAPE, _part("nodes", "", "", np.zeros((3, k)), item="nodes"), f"(3, {k})")
        for k in (0, 1, 3, 200)
    ),
    _row("nodes as integers", _DTYPE, _part("nodes", "", "", np.zeros((3, 2), int), item="nodes"), "float", "int64"),
    _row("cells as floats", _DTYPE, _part("cells", "triangle", "", _TRIANGLE * 1.0, name="triangle"), "integer"),
    _row("global ids as floats", _DTYPE, _part("global_ids", "", "", _INDEX * 1.0, item="global_ids"), "integer"),
    _row("a patch as floats", _DTYPE, _part("patch", "left", "moving", _INDEX * 1.0, name="left"), "integer"),
    _row(
        "triangles of 4 nodes", _SHAPE, _part("cells", "triangle", "", np.zeros((1, 4), int), name="triangle"), "(1, 4)"
    ),
    _row("quads of 3 nodes", _SHAPE, _part("cells", "quad", "", _TRIANGLE, name="quad"), "(k, 4)", "(1, 3)"),
    _row("a patch of two columns", _SHAPE, _part("patch", "left", "moving", np.zeros((2, 2), int), name="left"), "1"),
    *(
        _row(f"{name!r} cells in 2D", _VALUE, _part("cells", name, "", np.zeros((1, k), int), type=name), repr(name))
        for name, k in (("tetra", 4), ("hexahedron", 8), ("line", 2), ("polygon", 5), ("", 3), ("Triangle", 3))
    ),
    _row("a patch without a name", _VALUE, _part("patch", "", "fixed", _INDEX, item="patch"), "name"),
    _row("a patch without a role", _VALUE, _part("patch", "new", "", _INDEX, patch="new"), "new", "role"),
    _row("an unknown role", _VALUE, _part("patch", "new", "sliding", _INDEX, field="role"), "sliding"),
    _row("another role", _VALUE, _part("patch", "left", "fixed", _INDEX, patch="left"), "left", "fixed", "moving"),
    _row("nodes with a name", _VALUE, _part("nodes", "left", "", _POINTS, item="nodes"), "left"),
    _row("cells with a role", _VALUE, _part("cells", "triangle", "fixed", _TRIANGLE, role="fixed"), "fixed"),
    _row("an unknown item", _VALUE, _part("edges", "", "", _INDEX, field="item"), "edges"),
    _row("an endless name", _VALUE, _part("patch", "p" * 257, "fixed", _INDEX, field="name"), "256"),
    *(_wire(f"dtype {dtype!r}", _DTYPE, Rows(_POINTS, dtype=dtype), "<f8", dtype) for dtype in _DTYPES),
    *(
        _wire(f"shape {shape}", _SHAPE, Rows(_POINTS, shape=shape))
        for shape in ([6], [3, 2, 1], [], [-3, -2], [3, True], [3.0, 2], [1 << 48, 0], ["3", 2])
    ),
    _row("no rows of 2⁴⁷ columns", _SHAPE, _part("nodes", "", "", Rows(np.empty((0, 2)), shape=[0, 1 << 47]))),
    _row("2⁴⁷ rows without columns", _SHAPE, _part("nodes", "", "", Rows(np.empty((0, 2)), shape=[1 << 47, 0]))),
    _row("2⁹⁴ numbers", _BYTES, _part("nodes", "", "", Rows(_POINTS, shape=[1 << 47, 1 << 47])), str(1 << 97)),
    *(
        _row(f"{len(_POINTS)} rows declared as {k}", _FRAMES, _part("nodes", "", "", Rows(_POINTS, shape=[k, 2])), says)
        for k, says in ((2, "32 bytes"), (4, "64 bytes"), (0, "0 frames"))
    ),
    _row("more than a session may hold", _BYTES, _too_many, str(1 << 16)),
)
