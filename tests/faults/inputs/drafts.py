"""The requests of a good session in wire form; a case changes them before they are sent.

The meshes are small, because there are hundreds of cases. Nothing here is checked; a draft holds bad values as well as
good ones.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]


@dataclass
class Rows:
    """An array in wire form: declaration and bytes may be inconsistent.

    ``values``: its bytes are sent unchanged; ``dtype``, ``shape``: declared; None: those of ``values``.
    """

    values: Array
    dtype: str | None = None
    shape: list[Any] | None = None

    def declaration(self, name: str) -> dict[str, Any]:
        """The content of frame 0."""
        dtype = self.values.dtype.newbyteorder("<").str if self.dtype is None else self.dtype
        return {"name": name, "dtype": dtype, "shape": list(self.values.shape) if self.shape is None else self.shape}


@dataclass
class Part:
    """One UPLOAD: item, name, role, rows."""

    item: str
    name: str
    role: str
    rows: Rows


@dataclass
class Draft:
    """All messages of a good session.

    ``opening``: fields of OPEN; ``parts``: uploads by partition; ``step``, ``frame``: of the MOVE; ``displacement``: by
    partition.
    """

    opening: dict[str, Any]
    parts: list[list[Part]]
    displacement: list[Rows]
    step: int = 1
    frame: str = "committed"
    extra: dict[str, Any] = field(default_factory=dict)

    def part(self, item: str, name: str = "", partition: int = 0) -> Part:
        return next(p for p in self.parts[partition] if (p.item, p.name) == (item, name))

    def rows(self, item: str, name: str = "", partition: int = 0) -> Array:
        return self.part(item, name, partition).rows.values

    def drop(self, item: str, name: str = "", partition: int = 0) -> Part:
        part = self.part(item, name, partition)
        self.parts[partition].remove(part)
        return part

    def replace(self, item: str, name: str, values: Array, partition: int = 0) -> None:
        self.part(item, name, partition).rows = Rows(values)

    def add_patch(self, name: str, role: str, nodes: Any, partition: int = 0) -> None:
        self.parts[partition].append(_patch(name, role, nodes))

    def set_settings(self, **settings: Any) -> None:
        self.opening["settings"] = self.opening["settings"] | settings

    @property
    def points(self) -> Array:
        """(n, d) coordinates of the first partition, to be changed in place."""
        return self.rows("nodes")

    @property
    def moved(self) -> Array:
        """(k, d) displacement of the first partition, to be changed in place."""
        return self.displacement[0].values


def _patch(name: str, role: str, nodes: Any) -> Part:
    return Part("patch", name, role, Rows(np.asarray(nodes, dtype=np.int64).reshape(-1, 1)))


def _draft(points: Array, cells: dict[str, Array], patches: dict[str, tuple[str, Any]], size: float = 0.05) -> Draft:
    """A draft of one partition, its moving nodes displaced smoothly."""
    parts = [Part("nodes", "", "", Rows(points))]
    parts += [Part("cells", name, "", Rows(np.asarray(nodes, dtype=np.int64))) for name, nodes in cells.items()]
    parts += [_patch(name, role, nodes) for name, (role, nodes) in patches.items()]
    moving = np.unique(np.concatenate([nodes for role, nodes in patches.values() if role == "moving"]))
    dimension = points.shape[1]
    displacement = size * np.sin(
        1.0 + points[moving] @ np.arange(1.0, 1.0 + dimension**2).reshape(dimension, dimension)
    )
    return Draft({"dimension": dimension, "settings": {}}, [parts], [Rows(displacement)])


def grid_points(count: int, dimension: int) -> Array:
    """(countᵈ, d) nodes of a unit square or cube, x fastest."""
    axes = np.meshgrid(*[np.linspace(0.0, 1.0, count)] * dimension, indexing="ij")
    return np.stack([axis.ravel() for axis in reversed(axes)], axis=1)


def _corners(count: int, dimension: int) -> Array:
    index = np.arange(count**dimension).reshape((count,) * dimension)
    return index[(slice(-1),) * dimension].ravel()


def grid_triangles(count: int) -> Array:
    low = _corners(count, 2)
    lower = np.stack([low, low + 1, low + count], axis=1)
    return np.concatenate([lower, np.stack([low + 1, low + count + 1, low + count], axis=1)])


def side(points: Array, axis: int, value: float) -> Array:
    return np.flatnonzero(points[:, axis] == value)


def square() -> Draft:
    """The unit square of 5 × 5 nodes in triangles: the left side moves, the others are fixed."""
    points = grid_points(5, 2)
    left = side(points, 0, 0.0)
    rim = np.flatnonzero(((points == 0.0) | (points == 1.0)).any(axis=1))
    patches = {"left": ("moving", left), "walls": ("fixed", np.setdiff1d(rim, left))}
    return _draft(points, {"triangle": grid_triangles(5)}, patches)


def quads() -> Draft:
    """The same square in quadrilaterals and, in its last row, triangles."""
    draft = square()
    low = _corners(5, 2)
    quad = np.stack([low, low + 1, low + 6, low + 5], axis=1)[:12]
    last = low[12:]
    triangles = np.concatenate(
        [np.stack([last, last + 1, last + 5], axis=1), np.stack([last + 1, last + 6, last + 5], axis=1)]
    )
    draft.replace("cells", "triangle", triangles)
    draft.parts[0].append(Part("cells", "quad", "", Rows(quad)))
    return draft


def cube() -> Draft:
    """The unit cube of 3 × 3 × 3 nodes in hexahedra: the bottom moves, the top is fixed, the sides slip."""
    points, low = grid_points(3, 3), _corners(3, 3)
    base = np.stack([low, low + 1, low + 4, low + 3], axis=1)
    bottom, top = side(points, 2, 0.0), side(points, 2, 1.0)
    patches = {"bottom": ("moving", bottom), "top": ("fixed", top)}
    patches |= {f"slip{axis}{int(v)}": ("slip", side(points, axis, v)) for axis in (0, 1) for v in (0.0, 1.0)}
    return _draft(points, {"hexahedron": np.concatenate([base, base + 9], axis=1)}, patches, 0.02)


def line() -> Draft:
    """Five nodes in 1D, the first moves."""
    nodes = np.arange(5)
    cells = np.stack([nodes[:-1], nodes[1:]], axis=1)
    return _draft(
        np.linspace(0.0, 1.0, 5)[:, None], {"line": cells}, {"left": ("moving", [0]), "right": ("fixed", [4])}
    )


def periodic() -> Draft:
    """The square with periodic bottom and top, the left side moves, the right one is fixed."""
    points = grid_points(5, 2)
    patches = {
        "left": ("moving", side(points, 0, 0.0)),
        "right": ("fixed", side(points, 0, 1.0)),
        "low": ("periodic", side(points, 1, 0.0)),
        "high": ("periodic", side(points, 1, 1.0)),
    }
    draft = _draft(points, {"triangle": grid_triangles(5)}, patches)
    draft.moved[:] = [0.05, 0.01]
    return draft


def symmetric() -> Draft:
    draft = square()
    points = draft.points
    bottom, walls = side(points, 1, 0.0), draft.rows("patch", "walls")[:, 0]
    draft.replace("patch", "walls", np.setdiff1d(walls, bottom[1:-1])[:, None])
    draft.add_patch("mirror", "symmetry", bottom)
    draft.moved[0, 1] = 0.0
    return draft


def hole() -> Draft:
    """The square of 7 × 7 nodes with a square hole, whose rim moves; all else is fixed."""
    points, low = grid_points(7, 2), _corners(7, 2)
    centre = points[grid_triangles(7)].mean(axis=1)
    kept = grid_triangles(7)[(np.abs(centre - 0.5) > 1 / 6).any(axis=1)]
    used = np.unique(kept)
    number = np.full(len(points), -1)
    number[used] = np.arange(len(used))
    points, low = points[used], number[low]
    outer = np.flatnonzero(((points == 0.0) | (points == 1.0)).any(axis=1))
    inner = np.flatnonzero((np.abs(points - 0.5) < 0.2).all(axis=1))
    return _draft(points, {"triangle": number[kept]}, {"body": ("moving", inner), "walls": ("fixed", outer)}, 0.02)


def halves() -> Draft:
    """The square in two partitions, cells below and above the diagonals; both move the left side."""
    whole = square()
    points, cells, ids = whole.points, whole.rows("cells", "triangle"), np.arange(25)
    parts = []
    for own in (cells[:16], cells[16:]):
        nodes = np.unique(own)
        local = np.full(25, -1)
        local[nodes] = np.arange(len(nodes))
        mine = [Part("nodes", "", "", Rows(points[nodes])), Part("global_ids", "", "", Rows(ids[nodes][:, None]))]
        mine.append(Part("cells", "triangle", "", Rows(local[own])))
        for name, role in (("left", "moving"), ("walls", "fixed")):
            held = np.intersect1d(whole.rows("patch", name)[:, 0], nodes)
            mine.append(_patch(name, role, local[held]))
        parts.append(mine)
    draft = Draft(whole.opening | {"partitions": 2}, parts, [])
    for mine in parts:
        at = mine[0].rows.values[np.sort(mine[3].rows.values[:, 0])]
        draft.displacement.append(Rows(0.05 * np.sin(1.0 + at @ np.array([[1.0, 2.0], [3.0, 4.0]]))))
    return draft


#: Good sessions by name.
DRAFTS: dict[str, Callable[[], Draft]] = {
    make.__name__: make for make in (square, quads, cube, line, periodic, symmetric, hole, halves)
}
