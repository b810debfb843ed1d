"""The motion that is a smooth function of the boundary: interpolation, and a correction where cells would become bad.

A correction that starts at one threshold and stops at another makes nodes jump from step to step, and a flow solver
takes every jump for a mesh velocity. Here the corrected mesh is a minimum that depends on the boundary alone::

    y = argmin  Σ_c w_c ψ(f_c(y)) + a/2 Σ_c w_c [ |∇v|²_F + mean_k |v_k|² / ((l h_c)² σ_k) ],      v = y − y_plain

f_c is the distortion of a corner simplex against the cell at rest (:mod:`.distortion`), with its barrier. It is
smallest at rest, for triangles too: a better shape is possible in several ways, and nodes would jump from one to
another. For quads and hexahedra f_c also grows with the loss of their angles: by the shape alone a squeezed rectangle
would be as bad as a sheared one, but for a flow solver it is better. w_c is one over the number of a cell's corners,
h_c its size at rest. Cells do not resist until f_c exceeds the onset::

    ψ'' = (1 + k s / K)^K − 1,      ψ(onset) = ψ'(onset) = 0,      s = max(f − onset, 0)

σ is 1 at the cells that resist in the plain mesh, spreads over a fixed number of rings as averages, and is exactly 0
beyond: there v has infinite mass, so the nodes stay in their plain positions. ψ and σ have two continuous derivatives,
so y is a continuously differentiable function of the boundary; where no cell of the plain mesh is beyond the onset,
y = y_plain exactly, at the cost of the plain motion. The result does not depend on the path or on the number of steps:
a start only changes the computing time.

For small s the power is like an exponential; for large s it grows less. If a whole gap is squeezed, with an exponential
some cells would resist 1e16 times as much as others that hardly differ, and the minimum would not be determined.

Nodes on plane slip and symmetry walls are also free, along the wall; periodic images are free and move together. On
curved walls that are straight in one direction, as a cylinder's, nodes are free along it. On other curved walls they
keep their plain positions: a polygon's tangents are not a smooth function of the boundary.

Newton's iterations use the exact Hessian near the minimum; farther away the negative part of every corner's Hessian is
dropped. If the function is not convex, only so much of it is dropped that the matrix is positive definite: without the
rest of the negative part a mesh stays near a saddle (bodies that pass each other) for a hundred iterations. The
iterations end when the step is below :data:`_TOLERANCE`; otherwise the result says that they did not converge.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import dataclass, field, replace
from functools import cache, cached_property

import mesh_motion_kernels as kernels
import numpy as np
from scipy.sparse import csr_matrix

from mesh_motion_numerics.arrays import Floats, Integers, Marks
from mesh_motion_numerics.correction.boundary_constraint import BoundaryConstraint
from mesh_motion_numerics.correction.distortion import (
    CornerSimplices,
    PNorm,
    corner_distortions,
    corner_simplices,
    distortion_gradient,
)
from mesh_motion_numerics.correction.free_region import free_region, gathered
from mesh_motion_numerics.correction.part_of_mesh import Elsewhere
from mesh_motion_numerics.correction.smooth_region import ROUGH, SmoothRegion
from mesh_motion_numerics.mesh.cells import CellTable
from mesh_motion_numerics.mesh.points import marks_at
from mesh_motion_numerics.quality.metrics import corner_quality, reference_sizes
from mesh_motion_numerics.stopwatch import check_time

RINGS = 8
"""Rings of cells around the resisting cells in which nodes are free."""

RAMP = 0.6
"""Range of f over which a cell of the plain mesh becomes active."""
FAR = 1e3
"""Part of this range, from its start, that does not count."""
_ONSET = 0.9  # quality at which a cell resists …
_LARGE, _LATE_ONSET = 30_000, 0.5  # … and in a mesh of more nodes: fewer are free there, or a step takes seconds
_CHUNK = 1 << 21  # corners whose neighbours are counted together: a few hundred megabytes
_PINNED = 1e-8  # σ below which a node keeps its plain position
_TOLERANCE = 1e-10  # largest Newton step of a node, as a share of the region's extent
_ITERATIONS = 40
_NEAR, _FEW = 1e-3, 16  # the same of a mesh where another correction begins
_ARMIJO, _HALVINGS = 1e-4, 40
_CONVEX = (0.0, 1 / 64, 1 / 16, 1 / 4, 1.0)  # parts of a Hessian, tried in turn until it is positive definite
_ALL = len(_CONVEX) - 1


def onset_of(n_nodes: int) -> float:
    """The quality of the worst corner at which a cell begins to resist, in a mesh with this number of nodes."""
    return _ONSET if n_nodes <= _LARGE else _LATE_ONSET


@dataclass(frozen=True)
class Law:
    """The resistance ψ of a cell."""

    onset: float = -math.log(_ONSET)  # Distortion at which a cell begins to resist
    #: stiffness, power: k and K
    stiffness: float = 15.0
    power: float = 5.0
    norm: PNorm = field(default_factory=lambda: PNorm(1.0, 16.0))  # Weight and sharpness of the size in f

    @classmethod
    def of(cls, n_nodes: int) -> Law:
        """The law for a mesh with this number of nodes."""
        return cls(onset=-math.log(onset_of(n_nodes)))

    @cached_property
    def limit(self) -> float:
        """The quality of a cell's worst corner above which the cell does not resist."""
        return math.exp(-self.onset) * (1.0 + 1e-9)  # far above the rounding

    def resistance(self, distortion: Floats) -> tuple[Floats, Floats, Floats]:
        """ψ, ψ′ and ψ″ for distortions (c,); ψ is inf where the distortion is inf."""
        k, n = self.stiffness, self.power
        x = k * np.clip(distortion - self.onset, 0.0, FAR)
        grown, bent, bulged = np.expm1(np.multiply.outer(n + np.arange(3.0), np.log1p(x / n)))
        bend, small = (n - 1) / n, x < 1e-3  # below, the differences would lose all digits
        value = (
            np.where(
                small, x**3 / 6 * (1 + bend * x / 4), n * n / ((n + 1) * (n + 2)) * bulged - n / (n + 1) * x - x * x / 2
            )
            / k**2
        )
        slope = np.where(small, x * x / 2 * (1 + bend * x / 3), n / (n + 1) * bent - x) / k
        return np.where(np.isfinite(distortion), value, np.inf), slope, grown


@dataclass(frozen=True, eq=False)
class Smoothed:
    """A corrected motion."""

    points: Floats  # (n, d), mesh length unit
    freed: int = 0  # Number of nodes that were free
    iterations: int = 0
    converged: bool = True  # Whether the iterations ended at the minimum
    residual: float = 0.0  # mesh length unit. The last Newton step's largest displacement of a node


@dataclass(eq=False)
class SmoothMotion:
    """The correction of one mesh; its result depends on the plain motion only."""

    reference: Floats  # (n, d), mesh length unit. Nodes of the reference mesh
    cells: CellTable
    held: Marks  # (n,). Nodes that keep their plain positions
    law: Law = field(default_factory=Law)
    #: The constraint of nodes that are not held but slide along planes or move together.
    constraint: BoundaryConstraint | None = None
    elsewhere: Elsewhere | None = None  # The rest of the mesh, if this is a region of it
    _later: SmoothMotion | None = None
    _last: tuple[bytes, SmoothRegion] | None = None  # of the latest free nodes: the next ones are often the same

    @classmethod
    def build(
        cls, reference: Floats, cells: CellTable, held: Marks, constraint: BoundaryConstraint | None
    ) -> SmoothMotion:
        """Build the correction of a mesh; the ``held`` (n,) nodes move only as the ``constraint`` allows."""
        smooth = None if constraint is None else constraint.smooth()
        held = held if smooth is None else held & ~smooth.released
        return cls(reference, cells, held, Law.of(len(reference)), smooth)

    def later(self, shift: float) -> SmoothMotion:
        """Return the same correction with the onset increased by the ``shift``."""
        if shift == 0.0:
            return self
        self._later = self._later or copy(self)  # keep the prepared data
        self._later.law = replace(self.law, onset=self.law.onset + shift)
        return self._later

    @cached_property
    def _sizes(self) -> Floats:
        return reference_sizes(self.reference, self.cells)

    def correct(
        self,
        plain: Floats,
        starts: Sequence[Callable[[], Floats]] = (),
        distorted: Integers | None = None,
        *,
        rough: bool = False,
    ) -> Smoothed:
        """The corrected motion.

        Raises RegionTooSmall if the mesh is a region of another one, and nodes with cells elsewhere would be free.

        Parameters
        ----------
        plain : (n, d) array, mesh length unit
            y_plain.
        starts : sequence of callable
            Make meshes (n, d) near the result, with the held nodes of ``plain``, if some cell resists: the iterations
            begin at the first one that is not tangled.
        distorted : (k,) int64 array, optional
            All cells whose worst corner is below :attr:`Law.limit` in y_plain, if known; it may contain others.
        rough : bool
            Whether a mesh near the minimum, or after a few iterations, is enough: another correction begins there.

        Returns
        -------
        Smoothed
            Not converged if the iterations could not begin because all meshes are tangled, or did not end.
        """
        region = self.region(plain, distorted)
        if region is None:
            return Smoothed(plain)
        nodes, n = region.free.nodes, region.free.n_free
        rest = plain[nodes]
        for start in (*starts, None):
            begin = rest if start is None else region.admitted(np.concatenate([start()[nodes[:n]], rest[n:]]))
            if np.isfinite(corner_distortions(begin, region.free.simplices, self.law.norm).max()):
                break
        else:
            return Smoothed(plain, n, 0, False, math.inf)
        found = self._descend(begin, rest, region, rough=rough)
        points = plain.copy()
        points[nodes[:n]] = found.points[:n]
        return replace(found, points=points)

    # --- region ------------------------------------------------------------------------------------------------------

    def region(self, plain: Floats, distorted: Integers | None = None) -> SmoothRegion | None:
        """Return the free nodes with their penalty; None if no cell of the plain mesh resists."""
        activations = self.activations(plain, distorted)
        if not activations:
            return None
        sigma = activations[-1][self.alike]
        if self.elsewhere is not None:
            self.elsewhere.require_here(sigma > 0.0)
        marked = (sigma > _PINNED) & ~self.held
        if not marked.any():
            return None
        key = np.packbits(marked).tobytes()
        if self._last is None or self._last[0] != key:
            free = free_region(self.reference, self.cells, self._sizes, marked, at_rest=True)
            constraint = None if self.constraint is None else self.constraint.of(free)
            self._last = key, SmoothRegion.build(free, constraint, self.reference)
        return self._last[1].of_motion(plain, sigma)

    def activations(self, plain: Floats, distorted: Integers | None = None) -> list[Floats]:
        """σ (n,) of the plain mesh (n, d) before and after each ring, equal for images; none if all are 0."""
        simplices = self.distorted_corners(plain, distorted)
        if simplices is None:
            return []
        distortion = corner_distortions(plain, simplices, self.law.norm)
        x = np.clip((np.minimum(distortion, FAR) - self.law.onset) / RAMP, 0.0, 1.0)
        active = np.flatnonzero(x)
        if not len(active):
            return []
        x, corners = x[active], self.alike[simplices.nodes[active]]
        calm = np.ones(len(plain))
        np.multiply.at(calm, corners, (1.0 - x**3 * (10.0 + x * (6.0 * x - 15.0)))[:, None])
        found = [1.0 - calm]
        for _ in range(RINGS):
            found.append(found[-1] + (1.0 - found[-1]) * (self.averages @ found[-1]))
        return found

    def distorted_corners(self, plain: Floats, distorted: Integers | None = None) -> CornerSimplices | None:
        """The corners of cells that resist in the plain mesh (n, d), and of some others; None if no cell resists.

        Nothing is stored for the other cells: in a large mesh the maps of all corners would take most of the memory.
        """
        if distorted is None:
            distorted = np.flatnonzero(corner_quality(plain, self.cells, self.reference) < self.law.limit)
        if not len(distorted):
            return None
        marked = marks_at(len(self.cells), distorted)
        sizes = self._sizes[marked]
        return corner_simplices(self.reference, self.cells.chosen(marked), sizes, at_rest=True, angles=True)

    @cached_property
    def alike(self) -> Integers:
        """(n,) the node whose activation each node uses: periodic images use the same one."""
        own = np.arange(len(self.reference))
        periodic = None if self.constraint is None else self.constraint.periodic
        return own if periodic is None else periodic.root_of(own)

    @cached_property
    def averages(self) -> csr_matrix:
        """(n, n) matrix of the mean over a node's neighbours, weighted by the number of shared corners."""
        n, corners = len(self.reference), self.cells.corner_nodes
        pairs = csr_matrix((n, n))
        for first in range(0, len(corners), _CHUNK):
            nodes = self.alike[corners[first : first + _CHUNK]].astype(np.int32)
            starts = np.arange(0, nodes.size + 1, nodes.shape[1], dtype=np.int32)
            of_corners = csr_matrix((np.ones(nodes.size), nodes.ravel(), starts), shape=(len(nodes), n))
            pairs = pairs + of_corners.T.tocsr() @ of_corners
        pairs.setdiag(0.0)
        pairs.eliminate_zeros()
        pairs.sort_indices()
        pairs.data /= np.repeat(np.asarray(pairs.sum(axis=1)).ravel(), np.diff(pairs.indptr))
        return pairs

    # --- minimum -----------------------------------------------------------------------------------------------------

    def _descend(self, points: Floats, rest: Floats, region: SmoothRegion, *, rough: bool) -> Smoothed:
        """Newton's iterations; ``rough`` as in :meth:`correct`."""
        n, extent = region.free.n_free, float(np.ptp(rest, axis=0).max())
        tolerance, enough, most = _TOLERANCE * extent, _NEAR * extent if rough else 0.0, _FEW if rough else _ITERATIONS
        energy, distortion = self._energy(points, rest, region)
        part, far, residual, last = 0, False, math.inf, math.inf  # last: the step before, if exact
        accuracy = ROUGH  # of conjugate gradients; the next step can be as small as an exact one
        for done in range(most):
            check_time()
            try:
                step, slope, part = self._step(points, rest, region, distortion, accuracy, part)
            except ArithmeticError:
                return Smoothed(points, n, done, False, residual)
            residual = float(np.abs(step).max())
            length = 1.0
            for _ in range(_HALVINGS):
                trial = points.copy()
                trial[:n] += length * step
                trial = region.admitted(trial)
                lower, after = self._energy(trial, rest, region)
                if lower <= energy + _ARMIJO * length * slope + 1e-14 * abs(energy):
                    break
                length *= 0.5
            else:
                if part == _ALL:
                    return Smoothed(points, n, done, residual < 1e3 * tolerance, residual)
                part = _ALL
                continue
            points, energy, distortion = trial, lower, after
            exact = part == 0
            whole = exact and length == 1.0
            if whole and residual < enough:
                return Smoothed(points, n, done + 1, True, residual)
            shrunk = (residual / last) ** 2 if whole and last < math.inf else math.inf
            next_step = residual * max(shrunk, 0.0 if region.is_factorized else accuracy)
            if (residual < tolerance and (exact or residual < 1e-2 * tolerance)) or next_step < 1e-2 * tolerance:
                return Smoothed(points, n, done + 1, True, residual)
            last, accuracy = (residual, min(ROUGH, shrunk)) if whole else (math.inf, ROUGH)
            if length < 1.0 or -slope >= 0.5 * max(energy, 1e-12):
                part, far = _ALL, True
            else:
                part, far = 0 if far or not region.is_factorized else max(0, part - 2), False
        return Smoothed(points, n, most, rough, residual)

    def _step(
        self, points: Floats, rest: Floats, region: SmoothRegion, distortion: Floats, accuracy: float, part: int
    ) -> tuple[Floats, float, int]:
        """Newton's step (f, d), the slope along it, and the number of the convex part; ``part`` is tried first.

        Between the Hessian and the positive parts of its corners there are matrices that are positive definite and only
        a little stiffer than the Hessian: with them the iterations leave a saddle in few steps.
        """
        model = cache(lambda exact: self.model(points, rest, region, distortion, exact=exact))
        while True:
            gradient, hessian = model(part == 0)
            if 0 < part < _ALL:
                exact, positive = model(True)[1], model(False)[1]
                hessian = exact + _CONVEX[part] * (positive - exact)
            try:
                step = region.solver(points, hessian, accuracy)(-gradient)
            except ArithmeticError:
                if part == _ALL:
                    raise
            else:
                slope = float(np.vdot(gradient, step))
                if slope < 0.0 or part == _ALL:
                    return step, slope, part
            part = part + 1 if region.is_factorized else _ALL

    def _energy(self, points: Floats, rest: Floats, region: SmoothRegion) -> tuple[float, Floats]:
        """The function to minimise at the local positions (l, d), and the corners' distortions."""
        distortion, n = corner_distortions(points, region.free.simplices, self.law.norm), region.free.n_free
        if not np.isfinite(distortion).all():
            return math.inf, distortion
        active = np.flatnonzero(distortion > self.law.onset)
        resistance = float(region.weights[active] @ self.law.resistance(distortion[active])[0])
        return resistance + region.pull(points[:n] - rest[:n])[0], distortion

    def model(
        self, points: Floats, rest: Floats, region: SmoothRegion, distortion: Floats, *, exact: bool
    ) -> tuple[Floats, Floats]:
        """Gradient (f, d) and Hessian (b, d, d) in the region's pattern."""
        n, d, adjacency = region.free.n_free, points.shape[1], region.free.adjacency
        active = np.flatnonzero(distortion > self.law.onset)
        _, slope, bend = self.law.resistance(distortion[active])
        weights = region.weights[active]
        simplices = region.free.simplices.of(active)
        shares = np.zeros((len(distortion), d + 1, d))
        shares[active] = distortion_gradient(points, simplices, weights * slope, self.law.norm)
        gradient = gathered(adjacency, shares) + region.pull(points[:n] - rest[:n])[1]
        blocks = self.corner_hessians(points, simplices, weights * slope, weights * bend, exact=exact)
        rows = np.full(len(distortion), -1, dtype=np.int32)
        rows[active] = np.arange(len(active))
        hessian = region.blocks.copy()
        kernels.add_corners(adjacency.starts, adjacency.entries, adjacency.slots, rows, blocks, hessian)
        return gradient, hessian

    def corner_hessians(
        self, points: Floats, simplices: CornerSimplices, slope: Floats, bend: Floats, *, exact: bool
    ) -> Floats:
        """(c, d², d²) second derivatives of the resistance by corner edges, as in :func:`.corner_blocks`.

        ``slope`` and ``bend`` (c,) are w ψ′ and w ψ″; a block that is not exact is positive semi-definite.
        """
        d = points.shape[1]
        blocks = np.empty((len(simplices), d * d, d * d))
        arrays = points, simplices.nodes, simplices.ideal, simplices.angles, slope, bend
        kernels.corner_hessians(*arrays, self.law.norm.m, self.law.norm.size_weight, exact, blocks)
        return blocks
