"""Free-form deformation (FFD) of an aerofoil's grid, with exact derivatives of all nodes by all parameters.

A lattice of control points about the aerofoil moves its surface, the mesh-motion server moves the grid. All columns of
the derivative come from one ``tangent``; the derivative of an objective by all parameters from one ``cotangent``.
python morph_aerofoil.py [--mesh mine.su2 --marker wing]
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from mesh_motion_client import Mesh, Patch, Session, connect
from scipy.interpolate import BPoly

from mesh_motion_server.files import read_mesh

sys.path.insert(0, str(Path(__file__).parents[1] / "su2_airfoil"))
from pitching_airfoil import naca0012  # the grid that is used where none is given

#: Control points along the chord; as many above the aerofoil as below. Each moves up and down: a parameter.
ALONG = 6


class Lattice:
    """Free-form deformation: Bernstein polynomials of the control points move the box of the aerofoil."""

    def __init__(self, surface: np.ndarray) -> None:
        low, high = surface.min(axis=0), surface.max(axis=0)
        margin = 0.05 * (high - low)
        self.corner, self.size = low - margin, high - low + 2.0 * margin
        x, y = ((surface - self.corner) / self.size).T
        along = BPoly(np.eye(ALONG)[:, None, :], [0.0, 1.0])(x)
        self.basis = np.concatenate([along * (1.0 - y)[:, None], along * y[:, None]], axis=1)

    def displacement(self, parameters: np.ndarray) -> np.ndarray:
        """(…, k, 2) displacement of the aerofoil's nodes for (…, m) parameters: the map is linear."""
        up = parameters @ self.basis.T
        return np.stack([np.zeros_like(up), up], axis=-1)

    def by_parameters(self, weights: np.ndarray) -> np.ndarray:
        """(m,) derivatives by the parameters from derivatives (k, 2) by the aerofoil's nodes."""
        return weights[:, 1] @ self.basis

    def control_points(self, parameters: np.ndarray) -> np.ndarray:
        """(2, along, 2) the control points below and above."""
        x = np.broadcast_to(self.corner[0] + self.size[0] * np.linspace(0.0, 1.0, ALONG), (2, ALONG))
        y = self.corner[1] + self.size[1] * np.array([[0.0], [1.0]]) + parameters.reshape(2, ALONG)
        return np.stack([x, y], axis=-1)


class Grid:
    """The positions of all nodes as a function of the parameters, with its derivatives."""

    def __init__(self, session: Session, mesh: Mesh) -> None:
        self.session, self.rest = session, mesh.points
        self.lattice = Lattice(mesh.points[session.moving_nodes])

    def places(self, parameters: np.ndarray) -> np.ndarray:
        """(n, 2) positions; makes a trial of the session, at which derivatives are then computed."""
        return self.rest + self.session.move(self.lattice.displacement(parameters)).displacement

    def columns(self) -> np.ndarray:
        """(m, n, 2) derivative of all nodes by each parameter."""
        return self.session.tangent(self.lattice.displacement(np.eye(2 * ALONG)))

    def gradient(self, weights: np.ndarray) -> np.ndarray:
        """(m,) derivative of an objective whose derivative by the nodes' positions is ``weights`` (n, 2)."""
        return self.lattice.by_parameters(self.session.cotangent(weights))


def timed(call, *arguments) -> tuple[np.ndarray, float]:
    """Result of a call, and its seconds."""
    begin = time.perf_counter()
    return call(*arguments), time.perf_counter() - begin


def check(grid: Grid, parameters: np.ndarray) -> str:
    """Compare the columns with extrapolated differences, the gradient with the columns; seconds of each call."""
    along, weights = (np.random.default_rng(1).standard_normal(shape) for shape in (2 * ALONG, grid.rest.shape))
    h = 1e-3 * grid.lattice.size[1]
    coarse, fine = (
        (grid.places(parameters + h * along) - grid.places(parameters - h * along)) / (2.0 * h) for h in (h, h / 2.0)
    )
    expected = (4.0 * fine - coarse) / 3.0
    _, of_move = timed(grid.places, parameters)
    columns, of_columns = timed(grid.columns)
    gradient, of_gradient = timed(grid.gradient, weights)
    by_columns = np.einsum("cni,ni->c", columns, weights)
    wrong = np.abs(np.tensordot(along, columns, 1) - expected).max() / np.abs(expected).max()
    apart = np.abs(by_columns - gradient).max() / np.abs(gradient).max()
    return (
        f"columns against differences {wrong:.1e}, gradient against columns {apart:.1e}\n"
        f"seconds: move {of_move:.3f}, {2 * ALONG} columns {of_columns:.3f}, gradient {of_gradient:.3f}\n"
    )


def fitted(grid: Grid, goal: np.ndarray, steps: int) -> np.ndarray:
    """The parameters whose grid is nearest to the ``goal`` (n, 2), by Gauss–Newton steps; prints a line for each."""
    parameters = np.zeros(2 * ALONG)
    for step in range(steps):
        apart = grid.places(parameters) - goal
        sys.stdout.write(f"step {step}  farthest node {np.abs(apart).max():.3e}\n")
        slopes = grid.columns().reshape(2 * ALONG, -1).T
        parameters = parameters - np.linalg.lstsq(slopes, apart.ravel(), rcond=None)[0]
    return parameters


def draw(grid: Grid, mesh: Mesh, parameters: np.ndarray, path: Path) -> None:
    """The grid at the aerofoil with its lattice, before and after."""
    figure = Figure(figsize=(9, 5.2), layout="constrained")
    axes = figure.subplots(2, 1, sharex=True, sharey=True)
    for axis, at, title in zip(axes, (np.zeros_like(parameters), parameters), ("before", "after"), strict=True):
        points = grid.places(at)
        for cells in mesh.cells.values():
            edges = points[np.concatenate([cells, cells[:, :1]], axis=1)]
            axis.plot(
                *np.insert(edges, edges.shape[1], np.nan, axis=1).reshape(-1, 2).T, color="tab:gray", linewidth=0.3
            )
        for row in grid.lattice.control_points(at):
            axis.plot(*row.T, "o--", color="tab:orange", linewidth=1.0, markersize=4.0)
        axis.set(title=title, xlim=(-0.2, 1.2), ylim=(-0.18, 0.24), aspect="equal")
    figure.savefig(path, dpi=100)


def main() -> int:
    """Check the derivatives at a cambered aerofoil, then recover its parameters from its grid alone."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--server", help="endpoint; default: a private server")
    parser.add_argument(
        "--mesh", type=Path, help="any file that the server reads; default: an O-mesh about a NACA 0012"
    )
    parser.add_argument("--marker", default="airfoil", help="the patch that moves; all others are fixed")
    parser.add_argument("--picture", type=Path, help="where to draw the grid before and after")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        if options.mesh is None:
            options.mesh = Path(folder) / "naca0012.su2"
            naca0012(options.mesh)
        file = read_mesh(options.mesh)
    patches = {name: Patch("moving" if name == options.marker else "fixed", n) for name, n in file.patches.items()}
    mesh = Mesh(file.points, file.cells, patches)
    with connect(options.server) as server, server.open(mesh) as session:
        grid = Grid(session, mesh)
        camber = np.sin(np.pi * np.linspace(0.0, 1.0, ALONG))
        goal = grid.lattice.size[0] * np.concatenate([0.09 * camber, 0.06 * camber])
        sys.stdout.write(f"{len(mesh.points)} nodes, {len(session.moving_nodes)} of the aerofoil\n" + check(grid, goal))
        found = fitted(grid, grid.places(goal), steps=5)
        sys.stdout.write(f"parameters found to {np.abs(found - goal).max():.1e}\n")
        if options.picture:
            draw(grid, mesh, found, options.picture)
        session.close("discard")
    return 0


if __name__ == "__main__":
    sys.exit(main())
