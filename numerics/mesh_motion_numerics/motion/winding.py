"""Bodies that turn by more than half a turn: the number of their turns, and the plain motion that winds the mesh.

A boundary at 200° is also a boundary at −160°, and there is a mesh for each. The committed mesh shows which of the two
is meant: along a chain of cells from a wall at rest to the body the rotation is continuous. In 2D two cells of positive
size that share an edge differ by less than half a turn, so the turn is counted exactly; in 3D it is counted about the
coordinate axis that is nearest to the rotation's axis. The next turn of a body is the one nearest to this turn. Nothing
is stored, so a mesh continues in the same way after a resume or a rollback.

Interpolation of a displacement cannot wind a mesh: its result is the same after a whole turn. So a turn θ is divided
into two::

    θ = φ + ρ,      φ = θ S(|θ|),      y = c + R(φ g(x)) (x̃ − c)

x̃ is the mesh interpolated to the boundary that is turned back by φ about its centre c. g is 1 at the body and its
layer, 0 at all other boundaries, and at other nodes the mean over a node's neighbours: rings of cells share the turn. S
rises from 0 at a quarter turn to 1 at three quarters with two continuous derivatives; up to a quarter turn φ is exactly
0.

Winding shears all cells. Cells resist only if they lose more than this shear takes (:meth:`Winding.sheared`): if all
cells resisted, there would be many minima.

A body that is attached to nodes that do not move cannot turn that far. Without fixed nodes there is no turn to count.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from itertools import combinations

import numpy as np
from mesh_motion_protocol.errors import QualityRefused
from numpy.typing import NDArray
from scipy.sparse import coo_array, csr_array, eye_array
from scipy.sparse.csgraph import breadth_first_order
from scipy.sparse.linalg import bicgstab
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from mesh_motion_numerics.arrays import Floats, Integers, Marks
from mesh_motion_numerics.blas import one_blas_thread
from mesh_motion_numerics.decomposition import nearest_rotation
from mesh_motion_numerics.mesh.paths import fit_rigid_motion
from mesh_motion_numerics.motion.boundary_layer import BoundaryLayer

UNWOUND = "the mesh cannot be wound further: it continues from the smallest turn to the same boundary, and nodes jump"
"""The warning of a step that could not continue from the committed mesh's turn."""

_FIRST, _ALL = np.pi / 2, 1.5 * np.pi  # |θ| at which S begins to rise from 0, and |θ| at which S is 1
_NARROW = 1.5  # first radius of a tube, in distances between its ends' nodes and their neighbours
_ACCURATE = 1e-12  # tolerance of g
_MOST = 0.9  # share of the cells between a body and the others
_LATER = 1.25  # simplices turned by one ring against the next lose more than their shear takes
_UNCERTAIN = 5 / 6 * np.pi  # two cells of a chain that differ by more may also differ by the rest of a whole turn


@dataclass(frozen=True, eq=False)
class WindingBody:
    """A body that may wind the mesh."""

    rows: Integers  # (b,). Its nodes, as rows among the moving nodes
    #: (p, d + 1). Corner simplices from a wall at rest to the body, each with an edge of the one before.
    chain: NDArray[np.integer]
    edges: Floats  # (p, d, d), mesh length unit. Of these from their first nodes, in the reference mesh


@dataclass(frozen=True, eq=False)
class Turns:
    """The turns of the bodies in one step, with one row for each body."""

    axes: Integers  # (b,). Coordinate axis about which each turns
    #: before, after: (b,), radians. The angles at the committed mesh and at the targets
    before: Floats
    after: Floats
    certain: bool = True  # whether the whole turns could be counted

    def until(self, fraction: float) -> Turns:
        """The same up to a fraction of the step."""
        return replace(self, after=self.before + fraction * (self.after - self.before)) if fraction < 1.0 else self

    @property
    def unwound(self) -> Turns | None:
        """The same with the smallest turns that lead to the same targets; None if these certainly are the smallest."""
        least = self.after - 2.0 * np.pi * np.round(self.after / (2.0 * np.pi))
        return None if self.certain and np.array_equal(least, self.after) else Turns(self.axes, least, least)


@dataclass(eq=False)
class Winding:
    """The bodies of one mesh that may wind it."""

    reference: Floats  # (n, d), mesh length unit
    moving: Integers  # (k,). Nodes of the moving boundary
    held: Marks  # (n,) bool. Boundary nodes and those of layers
    simplices: NDArray[np.integer]  # (c, d + 1). Corner simplices of all cells
    layer: BoundaryLayer | None
    averages: Callable[[], csr_array]  # makes the means (n, n) over nodes' neighbours, when a body first winds the mesh
    bodies: tuple[WindingBody, ...] = field(default=())

    # --- which turn --------------------------------------------------------------------------------------------------

    def turns(self, committed: Floats, targets: Floats) -> Turns | None:
        """The turns of the bodies from the ``committed`` mesh (n, d) to ``targets`` (k, d), by the smallest change.

        None if the plain motion is interpolation alone at both ends.
        """
        if not self._may_wind(committed, targets):
            return None
        axes, before, after, certain = [], [], [], []
        for body in self.bodies:
            rest, was = self.reference[self.moving[body.rows]], committed[self.moving[body.rows]]
            old, new = fitted_rotation(rest, was), fitted_rotation(rest, targets[body.rows])
            chain = self._rotations(body, committed)
            relative = (chain[1:] * chain[:-1].inv()).as_rotvec()
            axis = _axis(chain[0].as_rotvec() + relative.sum(axis=0), old, new, rest.shape[1])
            counted = np.unwrap(np.append(0.0, _twist(chain, axis)))
            axes.append(axis)
            before.append(_nearest(_twist(old, axis), counted[-1]))
            after.append(_nearest(_twist(new, axis), before[-1]))
            certain.append(np.abs(np.diff(counted)).max() < _UNCERTAIN)
        turns = Turns(np.array(axes, dtype=np.int64), np.array(before), np.array(after), all(certain))
        furthest = max(np.abs(turns.before).max(), np.abs(turns.after).max())
        return turns if furthest > _FIRST or not turns.certain else None

    def _may_wind(self, committed: Floats, targets: Floats) -> bool:
        """False if no edge of a body's chain has turned by a quarter turn, and no body will have either."""
        for body in self.bodies:
            edges = committed[body.chain[:, 1:]] - committed[body.chain[:, :1]]
            if not (np.einsum("pij,pij->pi", edges, body.edges) > 0.0).all():
                return True
            if abs(fit_rigid_motion(self.reference[self.moving[body.rows]], targets[body.rows]).angle) > _FIRST:
                return True
        return False

    def _rotations(self, body: WindingBody, points: Floats) -> Rotation:
        """Those (p,) of the chain's simplices when the nodes are at ``points`` (n, d)."""
        edges = points[body.chain[:, 1:]] - points[body.chain[:, :1]]
        turned = nearest_rotation(np.swapaxes(np.linalg.solve(body.edges, edges), 1, 2))
        whole = np.tile(np.eye(3), (len(turned), 1, 1))
        whole[:, : turned.shape[1], : turned.shape[1]] = turned
        return Rotation.from_matrix(whole)

    # --- plain motion ------------------------------------------------------------------------------------------------

    def winds(self, targets: Floats, turns: Turns, fraction: float) -> tuple[Floats, Callable[[Floats], Floats]]:
        """The boundary (k, d) turned back from ``targets``, and a function that winds a mesh (n, d) interpolated to it.

        The bodies are at a ``fraction`` of their ``turns``.
        """
        back, winds = targets.copy(), []
        nearly = turns.before + fraction * (turns.after - turns.before)
        for body, axis, share, near in zip(self.bodies, turns.axes, self.shares, nearly, strict=True):
            own = targets[body.rows]
            angle = wound(_nearest(_twist(fitted_rotation(self.reference[self.moving[body.rows]], own), axis), near))
            if angle != 0.0:
                centre = own.mean(axis=0)
                back[body.rows] += _turn(own, centre, axis, np.full(len(own), -angle))
                winds.append((centre, axis, angle * share))

        def wind(points: Floats) -> Floats:
            found = points + sum(_turn(points, *one) for one in winds)
            found[self.moving] = targets
            return found

        return back, wind

    def sheared(self, turns: Turns) -> float:
        """The distortion log(1 + γ²/d) of cells sheared by γ, an upper limit for most cells at the targets."""
        d = self.reference.shape[1]
        strained = (shear * wound(angle) for shear, angle in zip(self.shears, turns.after, strict=True))
        return float(_LATER * sum(np.log1p(gamma**2 / d) for gamma in strained))

    def sheared_slopes(self, turns: Turns) -> list[float]:
        """The derivatives of :meth:`sheared` by each body's φ."""
        d = self.reference.shape[1]
        both = ((shear, shear * wound(angle)) for shear, angle in zip(self.shears, turns.after, strict=True))
        return [_LATER * 2.0 * gamma * shear / (d + gamma**2) for shear, gamma in both]

    @cached_property
    def shears(self) -> list[float]:
        """|x − c| |∇g| for each body: an upper limit for most cells."""
        nodes = self.simplices
        edges = self.reference[nodes[:, 1:]] - self.reference[nodes[:, :1]]
        found = []
        for body, share in zip(self.bodies, self.shares, strict=True):
            arms = self.reference[nodes].mean(axis=1) - self.reference[self.moving[body.rows]].mean(axis=0)
            slopes = np.linalg.solve(edges, (share[nodes[:, 1:]] - share[nodes[:, :1]])[:, :, None])[:, :, 0]
            shears = np.linalg.norm(arms, axis=1) * np.linalg.norm(slopes, axis=1)
            found.append(float(np.quantile(shears[shears > 0.0], _MOST)))
        return found

    def carried(self, turns: Turns, points: Floats, before: Floats, plain: Floats, begin: float, end: float) -> Floats:
        """A mesh (n, d) carried from one fraction of the ``turns`` to another, as :data:`.Carried`.

        All nodes turn with the bodies by their shares, in 3D about the axis of a body's rotation between ``before`` and
        ``plain``. Held nodes go to their ``plain`` positions; if a correction has moved nodes of a layer away from
        these, this shift turns with them.
        """
        found, corrected = points.copy(), points[self.held] - before[self.held]
        kept, zero = corrected.copy(), np.zeros(points.shape[1])
        for body, axis, share, angle in zip(
            self.bodies, turns.axes, self.shares, (end - begin) * (turns.after - turns.before), strict=True
        ):
            nodes = self.moving[body.rows]
            was, goes = (p[nodes].mean(axis=0) for p in (before, plain))
            turned, by = partial(_turn, axis=axis), angle
            if points.shape[1] == 3:
                about = fitted_rotation(before[nodes], plain[nodes]).as_rotvec()
                turned, by = partial(_turn_about, axis=about), 1.0
            found += turned(points, was, angles=by * share) + share[:, None] * (goes - was)
            kept += turned(corrected, zero, angles=by * share[self.held])
        found[self.held] = plain[self.held] + kept
        return found

    @cached_property
    def shares(self) -> Floats:
        """g (b, n) of the bodies."""
        shares = np.zeros((len(self.bodies), len(self.reference)))
        body_of = np.full(len(self.reference), -1)
        for number, body in enumerate(self.bodies):
            body_of[self.moving[body.rows]] = number
        if self.layer is not None:
            corners, weights = self.layer.tied.places
            foot = corners[np.arange(len(corners)), weights.argmax(axis=1)]
            body_of[self.layer.nodes] = body_of[self.layer.wall.nodes[foot]]
        means, free = self.averages(), np.flatnonzero(~self.held)
        inner = csr_array(means[free][:, free])
        system = eye_array(len(free), format="csr") - inner
        for number, share in enumerate(shares):
            share[body_of == number] = 1.0
            with one_blas_thread():
                found, failed = bicgstab(system, (means @ share)[free], rtol=_ACCURATE, maxiter=100 * len(shares[0]))
            if failed:
                raise QualityRefused("the share of a body's turn at the nodes was not found")
            share[free] = found
        return shares


def winding_body(
    reference: Floats, simplices: NDArray[np.integer], nodes: Integers, rows: Integers, fixed: Integers
) -> WindingBody | None:
    """The body of moving ``nodes`` (b,), at ``rows`` (b,); None if no cells connect it to ``fixed`` (f,) nodes.

    Parameters
    ----------
    reference : (n, d) array, mesh length unit
    simplices : (c, d + 1) int array
        Corner simplices of all cells.
    """
    d = reference.shape[1]
    distances, nearest = cKDTree(reference[fixed]).query(reference[nodes])
    closest = int(np.argmin(distances))
    start, end = reference[nodes[closest]], reference[fixed[nearest[closest]]]
    along = (reference - start) @ (end - start) / max(float((end - start) @ (end - start)), np.finfo(float).tiny)
    apart = np.linalg.norm(reference - start - np.clip(along, 0.0, 1.0)[:, None] * (end - start), axis=1)
    of_body, of_wall = (np.isin(np.arange(len(reference)), some) for some in (nodes, fixed))
    radius = _NARROW * float(np.partition(np.linalg.norm(reference - start, axis=1), 1 + d)[1 + d])
    while True:
        inside = simplices[(apart[simplices] <= radius).any(axis=1)]
        chain = _chain(inside, of_wall[inside].sum(axis=1) >= d, of_body[inside].sum(axis=1) >= d)
        if chain is not None:
            chosen = inside[chain]
            return WindingBody(rows, chosen, reference[chosen[:, 1:]] - reference[chosen[:, :1]])
        if len(inside) == len(simplices):
            return None
        radius *= 2.0


def _chain(simplices: NDArray[np.integer], first: Marks, last: Marks) -> Integers | None:
    """Simplices (c, d + 1) from one marked ``first`` (c,) to one marked ``last``, connected by common edges."""
    if not first.any() or not last.any():
        return None
    edges = np.concatenate([np.sort(simplices[:, pair], axis=1) for pair in combinations(range(simplices.shape[1]), 2)])
    names, edge = np.unique(edges, axis=0, return_inverse=True)
    c, source = len(simplices), len(simplices) + len(names)
    own = np.tile(np.arange(c), len(edges) // c)
    begin = np.flatnonzero(first)
    one, other = np.append(own, begin), np.append(c + edge.ravel(), np.full(len(begin), source))
    graph = coo_array((np.ones(len(one)), (one, other)), shape=(source + 1, source + 1)).tocsr()
    order, before = breadth_first_order(graph, source, directed=False)
    ends = order[order < c]
    ends = ends[last[ends]]
    if not len(ends):
        return None
    chain = [int(ends[0])]
    while (place := int(before[chain[-1]])) != source:
        chain.append(int(before[place]) if place >= c else place)
    return np.array(chain[::-1], dtype=np.int64)


def turned_on(rest: Floats, was: Floats, now: Floats) -> tuple[float, float]:
    """The turn of a body (b, d) at one place, and at another place by the smallest change, radians.

    The first turn is the smallest that leads to its place. Turns are about the coordinate axis nearest to the
    rotation's axis.
    """
    old, new = fitted_rotation(rest, was), fitted_rotation(rest, now)
    axis = _axis(old.as_rotvec(), old, new, rest.shape[1])
    before = float(_twist(old, axis))
    return before, _nearest(_twist(new, axis), before)


def _axis(about: Floats, old: Rotation, new: Rotation, d: int) -> int:
    """The coordinate axis nearest to a rotation's axis ``about`` (3,) and to the smallest one's from old to new."""
    return 2 if d == 2 else int(np.argmax(np.abs(about + (new * old.inv()).as_rotvec())))


def wound(angle: float) -> float:
    """φ for a turn θ, radians."""
    s = _begun(angle)
    return angle * s**3 * (10.0 + s * (6.0 * s - 15.0))


def wound_slope(angle: float) -> float:
    """dφ/dθ at a turn θ, radians."""
    s = _begun(angle)
    return s**3 * (10.0 + s * (6.0 * s - 15.0)) + abs(angle) * 30.0 * (s * (1.0 - s)) ** 2 / (_ALL - _FIRST)


def _begun(angle: float) -> float:
    """The share S of a turn: how far it is on the way from a quarter turn to three quarters."""
    return float(np.clip((abs(angle) - _FIRST) / (_ALL - _FIRST), 0.0, 1.0))


def fitted_rotation(rest: Floats, moved: Floats) -> Rotation:
    """The rotation of a body, fitted to its nodes (b, d)."""
    rigid = fit_rigid_motion(rest, moved)
    return Rotation.from_rotvec(rigid.angle * rigid.axis)


def _twist(rotations: Rotation, axis: int) -> Floats:
    """The angle (…,) of rotations about a coordinate axis."""
    quaternions = rotations.as_quat()
    return np.asarray(2.0 * np.arctan2(quaternions[..., axis], quaternions[..., 3]))


def _nearest(angle: float | Floats, near: float) -> float:
    """The angle plus the whole turns that bring it nearest to another angle."""
    return float(angle + 2.0 * np.pi * np.round((near - angle) / (2.0 * np.pi)))


def _turn_about(points: Floats, centre: Floats, axis: Floats, angles: Floats) -> Floats:
    """(n, 3) displacements of points that turn about a centre by rotation vectors: an axis (3,) times angles (n,)."""
    arms = points - centre
    return np.asarray(Rotation.from_rotvec(angles[:, None] * axis).apply(arms) - arms)


def _turn(points: Floats, centre: Floats, axis: int, angles: Floats) -> Floats:
    """(n, d) displacements of points that turn about a centre and a coordinate axis by angles (n,)."""
    one, other = ((1, 2), (2, 0), (0, 1))[axis]
    out, sine, less = np.zeros_like(points), np.sin(angles), 2.0 * np.sin(angles / 2.0) ** 2
    x, y = points[:, one] - centre[one], points[:, other] - centre[other]
    out[:, one], out[:, other] = -less * x - sine * y, sine * x - less * y
    return out
