"""Do nodes that slide or move in pairs give better meshes, and do they stay on their walls and pairs?"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from mesh_motion_numerics.mesh.cells import CellTable
from mesh_motion_numerics.mesh.roles import Patch
from mesh_motion_numerics.method import Method
from mesh_motion_numerics.motion.motion import MotionModel
from mesh_motion_numerics.motion.motion_found import Motion
from mesh_motion_numerics.quality.metrics import cell_quality
from numpy.typing import NDArray

from docs.studies.study import Cell, Outcome, Picture, Study, Table

Floats = NDArray[np.float64]

#: Corners of a box in units, by dimension.
_SQUARE = ((0, 0), (1, 0), (1, 1), (0, 1))
_CORNERS: dict[int, tuple[tuple[int, ...], ...]] = {
    2: _SQUARE,
    3: tuple((*corner, z) for z in (0, 1) for corner in _SQUARE),
}
_CELL = {2: "quad", 3: "hexahedron"}
BEND = 1.2  # radians, of the curved duct
SECTORS = 6
SHIFT = (0.12, 0.24, 0.05)


@dataclass(frozen=True, eq=False)
class Duct:
    """A block in a duct; the duct's walls (y, in 3D also z) get a role, its ends in x are fixed."""

    points: Floats
    straight: Floats
    cells: CellTable
    body: NDArray[np.int64]

    @classmethod
    def build(cls, d: int, n: int, bend: float) -> Duct:
        """n boxes along each axis of the unit square or cube, without [0.4, 0.6]ᵈ; the axis bent to an arc."""
        axis = np.linspace(0.0, 1.0, n + 1)
        points = np.stack(np.meshgrid(*[axis] * d, indexing="ij"), axis=-1).reshape(-1, d)
        number = np.arange(len(points)).reshape((n + 1,) * d)
        boxes = np.stack([number[tuple(slice(a, a + n) for a in c)].ravel() for c in _CORNERS[d]], axis=1)
        boxes = boxes[~(np.abs(points[boxes].mean(axis=1) - 0.5) < 0.1).all(axis=1)]
        used, renumbered = np.unique(boxes, return_inverse=True)
        straight = points[used]
        body = np.flatnonzero((np.abs(straight - 0.5) < 0.1 + 1e-9).all(axis=1))
        cells = CellTable.from_arrays({_CELL[d]: renumbered.reshape(boxes.shape)})
        return cls(_bent(straight, bend), straight, cells, body)

    def on(self, axis: int, end: float) -> NDArray[np.int64]:
        """Nodes of a side."""
        return np.flatnonzero(self.straight[:, axis] == end)

    def model(self, walls: str, ends: str = "fixed") -> MotionModel:
        """The mesh with one role for the walls in y, another for all other sides."""
        patches = {"body": Patch("moving", self.body)}
        for axis in range(self.points.shape[1]):
            role = ends if axis == 0 else "slip" if walls == "periodic" and axis == 2 else walls
            for end in (0, 1):
                patches[f"{'xyz'[axis]}{end}"] = Patch(role, self.on(axis, end))
        method = Method(
            support_radius=1.0,
            displacement="absolute",
            correction_target="maximum",
            quality_metric="size-skew",
            quality_threshold=0.95,
        )
        return MotionModel.build(self.points, self.cells, patches, method)

    def worst_at_walls(self, model: MotionModel, motion: Motion) -> float:
        """Smallest size-skew of the cells with a node on a wall in y."""
        quality = cell_quality(motion.points, self.cells, model.reference_sizes).metric("size-skew")
        wall = np.isin(self.cells.blocks[0].nodes, np.concatenate([self.on(1, 0), self.on(1, 1)])).any(axis=1)
        return float(quality[wall].min())

    def off_walls(self, motion: Motion) -> float:
        """Largest distance of a wall node from the reference wall (in 3D in the plane of the bend) over the extent."""
        worst = 0.0
        for end in (0, 1):
            nodes = self.on(1, end)
            _, first = np.unique(self.straight[nodes, 0], return_index=True)  # one a place along the axis, in order
            corners = self.points[nodes[first], :2]
            worst = max(worst, float(_to_polyline(motion.points[nodes, :2], corners).max()))
        return worst / float(np.ptp(self.points, axis=0).max())


def _bent(points: Floats, bend: float) -> Floats:
    """The duct's axis as an arc of an angle."""
    if bend == 0.0:
        return points.copy()
    out = points.copy()
    angle, radius = bend * (points[:, 0] - 0.5), 1.0 / bend + points[:, 1] - 0.5
    out[:, 0], out[:, 1] = radius * np.sin(angle), radius * np.cos(angle) - 1.0 / bend
    return out


def _to_polyline(points: Floats, corners: Floats) -> Floats:
    """Distance (m,) of points (m, 2) to the polyline of corners (c, 2), over all segments."""
    a, edge = corners[:-1], np.diff(corners, axis=0)
    t = np.einsum("mfi,fi->mf", points[:, None] - a, edge) / np.sum(edge**2, axis=1)
    near = a + np.clip(t, 0.0, 1.0)[..., None] * edge
    return np.asarray(np.linalg.norm(points[:, None] - near, axis=2).min(axis=1))


def _compared(duct: Duct) -> Iterator[tuple[str, MotionModel, Motion]]:
    """The walls fixed, sliding in the standard motion only, sliding in the correction too."""
    fixed, slip = duct.model("fixed"), duct.model("slip")
    for name, model in (("fixed", fixed), ("slip, held", replace(slip, constraint=None)), ("slip, corrected", slip)):
        targets = duct.points[duct.body] + np.array(SHIFT[: duct.points.shape[1]])
        yield name, model, model.move(duct.points, targets)


def run(quick: bool) -> Outcome:
    sizes = {2: 10, 3: 5} if quick else {2: 20, 3: 10}
    rows: list[list[Cell]] = []
    drawn: dict[str, tuple[Duct, Floats]] = {}
    for d, n in sizes.items():
        for shape, bend in (("planar", 0.0), ("curved", BEND)):
            duct = Duct.build(d, n, bend)
            for name, model, motion in _compared(duct):
                minimum = motion.corrected.metric.min
                walls = duct.worst_at_walls(model, motion)
                rows.append([f"{d}D {shape}", name, motion.standard.metric.min, minimum, walls, duct.off_walls(motion)])
                if (d, shape) == (2, "curved"):
                    drawn[name] = (duct, motion.points)
    columns = ("walls", "nodes on them", "standard", "corrected", "at the walls", "off the walls")
    slip = Table(columns, rows, "Minimum size-skew; distance off the reference walls as a share of the domain.", 3)
    periodic, row = _periodic(sizes)
    drawn["periodic sector"] = row
    return Outcome((slip, periodic), (Picture(lambda f: _draw(f, drawn), _CAPTION, (8.0, 2.6)),))


def _periodic(sizes: dict[int, int]) -> tuple[Table, tuple[Duct, Floats]]:
    """Fixed against periodic sides, a row and a sector."""
    rows: list[list[Cell]] = []
    for d, n in sizes.items():
        for shape in ("row", "sector"):
            duct = Duct.build(d, n, 0.0)
            if shape == "sector":
                duct = replace(duct, points=_sector(duct.straight))
            for walls in ("fixed", "periodic"):
                model = duct.model(walls)
                motion = model.move(duct.points, duct.points[duct.body] + _across(shape, d))
                error = _pair_error(duct, shape, motion.points) if walls == "periodic" else None
                rows.append([f"{d}D {shape}", walls, motion.standard.metric.min, motion.corrected.metric.min, error])
            if (d, shape) == (2, "sector"):
                drawn = (duct, motion.points)
    columns = ("domain", "sides", "standard", "corrected", "pair error")
    caption = "Minimum size-skew; largest distance of a node from its pair's image, as a share of the domain."
    return Table(columns, rows, caption, 3), drawn


def _across(shape: str, d: int) -> Floats:
    """The shift (d,), mostly across the periodic sides; in a sector it is turned to the sector's middle."""
    shift = np.array(SHIFT[:d])
    if shape == "sector":
        c, s = np.cos(np.pi / SECTORS), np.sin(np.pi / SECTORS)
        shift[:2] = [c * shift[0] - s * shift[1], s * shift[0] + c * shift[1]]
    return shift


def _sector(straight: Floats) -> Floats:
    """Map to a sector: x is the radius minus 1, y the angle of one of six sectors."""
    out = straight.copy()
    angle, radius = straight[:, 1] * 2.0 * np.pi / SECTORS, 1.0 + straight[:, 0]
    out[:, 0], out[:, 1] = radius * np.cos(angle), radius * np.sin(angle)
    return out


def _pair_error(duct: Duct, shape: str, points: Floats) -> float:
    """Largest difference of the displacements of the sides in y, turned if the domain is a sector."""
    step = points - duct.points
    first, second = duct.on(1, 0), duct.on(1, 1)  # both in the order of the other coordinates
    turn = np.eye(points.shape[1])
    if shape == "sector":
        c, s = np.cos(2.0 * np.pi / SECTORS), np.sin(2.0 * np.pi / SECTORS)
        turn[:2, :2] = [[c, -s], [s, c]]
    return float(np.abs(step[second] - step[first] @ turn.T).max() / np.ptp(duct.points, axis=0).max())


_CAPTION = (
    "A block in a bent duct: nodes on its walls fixed, sliding in the standard motion, sliding in the correction; a "
    "sector."
)


def _draw(figure: Any, drawn: dict[str, tuple[Duct, Floats]]) -> None:
    from matplotlib.collections import PolyCollection  # noqa: PLC0415

    for ax, (name, (duct, points)) in zip(figure.subplots(1, len(drawn)), drawn.items(), strict=True):
        quads = points[duct.cells.blocks[0].nodes]
        ax.add_collection(PolyCollection(quads, facecolors="#dfe9f3", edgecolors="#22303c", linewidths=0.4))  # type: ignore[arg-type]
        ax.set_title(name, fontsize=9)
        ax.autoscale_view()
        ax.set_aspect("equal", anchor="N")
        ax.set_axis_off()


def claims(outcome: Outcome) -> None:
    slip, periodic = outcome.tables
    for domain in dict.fromkeys(slip.column("walls")):
        fixed, held, corrected = ([float(str(c)) for c in row[2:]] for row in slip.rows if row[0] == domain)
        assert corrected[1] > held[1] > 0.0, domain
        assert corrected[1] > fixed[1], domain
        assert max(held[3], corrected[3]) <= 1e-6, domain
    for domain in dict.fromkeys(periodic.column("domain")):
        fixed_row, free_row = (row for row in periodic.rows if row[0] == domain)
        gain = float(str(free_row[3])) - float(str(fixed_row[3]))
        assert gain > 0.1 if domain.endswith("row") else abs(gain) < 0.02, domain  # see the page
        assert float(str(free_row[4])) <= 1e-12, domain


STUDY = Study(
    "What do sliding walls and periodic sides gain, in the standard motion and in the correction?",
    "Beyond the thesis, whose boundary nodes are prescribed",
    run,
    claims,
    (
        "mesh_motion_numerics.correction.boundary_constraint.BoundaryConstraint",
        "mesh_motion_numerics.mesh.sliding.SlidingSurfaces",
        "mesh_motion_numerics.interpolation.periodic_interpolant.PeriodicFactorization",
        "mesh_motion_numerics.mesh.periodic_pairs.periodic_pairs",
    ),
)
