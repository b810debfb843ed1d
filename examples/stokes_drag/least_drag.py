"""The body of minimal drag in Stokes flow: an optimiser changes its shape, and the mesh-motion server moves the mesh.

The flow is solved on the moved mesh by scikit-fem. The finite elements give the drag's derivative by the positions of
all nodes; the server's ``cotangent`` turns it into the derivative by the body's nodes. python least_drag.py
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from mesh_motion_client import Mesh, Patch, Session, connect
from scipy.optimize import minimize
from skfem import (
    Basis,
    BilinearForm,
    ElementTriP1,
    ElementTriP2,
    ElementVector,
    LinearForm,
    MeshTri,
    bmat,
    condense,
    solve,
)
from skfem.helpers import ddot, div, grad, mul, trace

#: Radius of the outer circle, on which the velocity is (1, 0); the body begins as a circle of radius 1.
FAR = 10.0
#: Design variables, nodes of the body for each, rings of nodes about it.
DESIGN, EACH, RINGS = 40, 2, 24


def circles() -> Mesh:
    """Triangles between the two circles; the rings are closer to each other at the body."""
    around = DESIGN * EACH
    angle = 2.0 * np.pi * np.arange(around) / around
    radius = FAR ** (np.arange(RINGS + 1) / RINGS)
    points = (radius[:, None, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)).reshape(-1, 2)
    node = np.arange(len(points)).reshape(RINGS + 1, around)
    after = np.roll(node, -1, axis=1)
    a, b, c, d = (corner.ravel() for corner in (node[:-1], node[1:], after[1:], after[:-1]))
    even = np.tile(np.arange(around) // (around // 4) % 2 == 0, RINGS)  # diagonals as symmetric as the circles
    parts = [np.stack(corners, axis=1)[even] for corners in ([a, b, c], [a, c, d])]
    parts += [np.stack(corners, axis=1)[~even] for corners in ([a, b, d], [b, c, d])]
    triangles = np.concatenate(parts)
    return Mesh(points, {"triangle": triangles}, {"body": Patch("moving", node[0]), "far": Patch("fixed", node[-1])})


class Flow:
    """Stokes flow of viscosity 1 past the body: velocities of degree 2, pressures of degree 1."""

    def __init__(self, mesh: Mesh) -> None:
        self.triangles = np.ascontiguousarray(mesh.cells["triangle"].T)
        self.body = mesh.patches["body"].nodes

    def drag(self, points: np.ndarray) -> tuple[float, np.ndarray]:
        """The drag, and its derivative (n, 2) by the positions of all nodes.

        The drag is the dissipation, the minimum of a functional: velocity and pressure make it stationary, so
        its derivative by the nodes is that with both held. The problem is its own adjoint.
        """
        mesh = MeshTri(np.ascontiguousarray(points.T), self.triangles)
        velocities = Basis(mesh, ElementVector(ElementTriP2()), intorder=4)
        pressures, places = (
            velocities.with_element(ElementTriP1()),
            velocities.with_element(ElementVector(ElementTriP1())),
        )
        a, b = _viscous.assemble(velocities), _divergence.assemble(velocities, pressures)
        matrix = bmat([[a, -b.T], [-b, None]], "csr")
        flow, outer = np.zeros(matrix.shape[0]), velocities.get_dofs(lambda x: np.hypot(*x) > 0.9 * FAR)
        flow[outer.all("u^1")] = 1.0
        held = np.concatenate([velocities.get_dofs().all(), [velocities.N]])  # one pressure: only its slope counts
        flow = solve(*condense(matrix, np.zeros_like(flow), x=flow, D=held))
        u, p = velocities.interpolate(flow[: velocities.N]), pressures.interpolate(flow[velocities.N :])
        slope = _by_places.assemble(places, u=u, p=p)
        return float(flow @ matrix @ flow), slope[places.nodal_dofs].T


@BilinearForm
def _viscous(u, v, _):
    return ddot(grad(u), grad(v))


@BilinearForm
def _divergence(u, q, _):
    return div(u) * q


@LinearForm
def _by_places(v, w):
    """∫ |∇u|² − 2 p ∇·u, differentiated along the nodes' velocity v with the coefficients of u and p held."""
    turned = mul(grad(w["u"]), grad(v))
    density = ddot(grad(w["u"]), grad(w["u"])) - 2.0 * w["p"] * div(w["u"])
    return density * div(v) - 2.0 * ddot(grad(w["u"]), turned) + 2.0 * w["p"] * trace(turned)


class Body:
    """The body's nodes by the design: distance of each chosen node from the circle; the others are interpolated."""

    def __init__(self, nodes: np.ndarray) -> None:
        self.circle = nodes
        share = np.arange(len(nodes)) / EACH
        away = np.abs(share[:, None] - np.arange(DESIGN))
        self._hats = (1.0 - np.minimum(away, DESIGN - away)).clip(0.0)

    def displacement(self, design: np.ndarray) -> np.ndarray:
        """(k, 2) positions of the body's nodes."""
        return (self._hats @ design)[:, None] * self.circle

    def by_design(self, weights: np.ndarray) -> np.ndarray:
        """(…, m) derivatives by the design variables from derivatives (…, k, 2) by the body's nodes."""
        return np.sum(weights * self.circle, axis=-1) @ self._hats

    def moments(self, design: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(3,) area and first moments of the body, and their derivatives (3, m)."""
        at = self.circle + self.displacement(design)
        after = np.roll(at, -1, axis=0)
        across = at[:, 0] * after[:, 1] - after[:, 0] * at[:, 1]
        by_first, by_second = after[:, ::-1] * [1.0, -1.0], at[:, ::-1] * [-1.0, 1.0]
        values, slopes = [across.sum() / 2.0], [(by_first + np.roll(by_second, 1, axis=0)) / 2.0]
        for axis in (0, 1):
            arm = (at + after)[:, axis, None]
            slope = arm * by_first + np.roll(arm * by_second, 1, axis=0)
            slope[:, axis] += across + np.roll(across, 1)
            values, slopes = [*values, across @ arm[:, 0] / 6.0], [*slopes, slope / 6.0]
        return np.array(values), self.by_design(np.array(slopes))


class Drag:
    """The drag as a function of the design variables, with its derivative."""

    def __init__(self, session: Session, mesh: Mesh) -> None:
        self.session, self.mesh, self.flow = session, mesh, Flow(mesh)
        self.body = Body(mesh.points[session.moving_nodes])

    def __call__(self, design: np.ndarray) -> tuple[float, np.ndarray]:
        """Move the mesh, solve, and differentiate backwards through both."""
        moved = self.session.move(self.body.displacement(design))
        self.latest, by_places = self.flow.drag(self.mesh.points + moved.displacement)
        return self.latest, self.body.by_design(moved.cotangent(by_places))

    def difference(self, design: np.ndarray, along: np.ndarray, step: float = 1e-5) -> float:
        """The derivative along a direction by a central difference."""
        return (self(design + step * along)[0] - self(design - step * along)[0]) / (2.0 * step)


def tip_angle(points: np.ndarray) -> float:
    """Angle in degrees between the two edges at the body's foremost design variable."""
    tip = len(points) // 2
    ahead, behind = points[tip - EACH] - points[tip], points[tip + EACH] - points[tip]
    return float(np.degrees(np.arccos(ahead @ behind / np.linalg.norm(ahead) / np.linalg.norm(behind))))


def draw(mesh: Mesh, points: np.ndarray, path: Path) -> None:
    """The mesh at the body before and after."""
    figure = Figure(figsize=(10, 4.2), layout="constrained")
    axes = figure.subplots(1, 2, sharex=True, sharey=True)
    for axis, at, title in zip(axes, (mesh.points, points), ("before", "after"), strict=True):
        axis.triplot(*at.T, mesh.cells["triangle"], linewidth=0.4, color="tab:gray")
        axis.fill(*at[mesh.patches["body"].nodes].T, color="tab:blue")
        axis.set(title=title, xlim=(-2.4, 2.4), ylim=(-1.8, 1.8), aspect="equal")
    figure.savefig(path, dpi=110)


def main() -> int:
    """Check the gradient, then minimise; print a line for each iteration."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--server", help="endpoint; default: a private server")
    parser.add_argument("--iterations", type=int, default=60)
    parser.add_argument("--picture", type=Path, help="where to draw the mesh before and after")
    options = parser.parse_args()
    mesh = circles()
    with connect(options.server) as server, server.open(mesh) as session:
        drag, start = Drag(session, mesh), np.zeros(DESIGN)
        along = np.random.default_rng(1).uniform(-1.0, 1.0, (2, DESIGN))
        for at in (start, 0.1 * along[0]):
            exact, difference = drag(at)[1] @ along[1], drag.difference(at, along[1])
            sys.stdout.write(f"derivative {exact:.8f}  by differences {difference:.8f}\n")
        rest, scale = drag.body.moments(start)[0], drag(start)[0]
        sys.stdout.write(f"drag of the circle {scale:.5f}\n")
        fixed = {"type": "eq", "fun": lambda design: drag.body.moments(design)[0] - rest,
                 "jac": lambda design: drag.body.moments(design)[1]}  # fmt: skip
        found = minimize(drag, start, jac=True, method="SLSQP", constraints=fixed, bounds=[(-0.6, 1.0)] * DESIGN,
                         options={"maxiter": options.iterations, "ftol": 1e-7},
                         callback=lambda _: sys.stdout.write(f"drag {drag.latest:.6f}\n"))  # fmt: skip
        body = drag.body.circle + drag.body.displacement(found.x)
        moved = session.move(drag.body.displacement(found.x))
        session.commit()
        area = drag.body.moments(found.x)[0]
        sys.stdout.write(f"drag {found.fun:.5f}, {found.fun / scale:.4f} of the circle's; {found.message}\n"
                         f"area {area[0] / rest[0]:.9f} of the circle's, length {np.ptp(body[:, 0]):.3f}, "
                         f"height {np.ptp(body[:, 1]):.3f}, angle of the tip {tip_angle(body):.1f} degrees\n"
                         f"quality at least {moved.quality['corrected']['metric']['min']:.3f}\n")  # fmt: skip
        if options.picture:
            draw(mesh, mesh.points + moved.displacement, options.picture)
        session.close("discard")
    return 0


if __name__ == "__main__":
    sys.exit(main())
