"""dolfinx: a channel whose floor rises and sinks, Poisson's equation on the mesh that the mesh-motion server moves.

Each step the server answers with the displacement of every node, and ``mesh.geometry.x`` is updated. The equation is
Laplace's with the boundary values of u = 1 + x + 2 y, which linear elements solve exactly on any valid mesh: the
printed error is that of the linear solver. python3 moving_wall.py [--server …]
"""

from __future__ import annotations

import argparse
import sys

import numpy as np
import ufl
from dolfinx import fem, mesh
from dolfinx.fem.petsc import LinearProblem
from mesh_motion_client import Mesh, Patch, connect
from mpi4py import MPI

LENGTH, HEIGHT = 4.0, 1.0


def server_mesh(domain: mesh.Mesh) -> Mesh:
    """The solver's mesh for the server: nodes, triangles, floor and the other walls."""
    points = domain.geometry.x[:, :2].copy()
    cells = domain.topology.index_map(2).size_local
    triangles = anticlockwise(np.array([domain.geometry.dofmap.links(cell) for cell in range(cells)]), points)
    floor = np.flatnonzero(np.isclose(points[:, 1], 0.0))
    sides = np.isclose(points[:, 0], 0.0) | np.isclose(points[:, 0], LENGTH) | np.isclose(points[:, 1], HEIGHT)
    return Mesh(points, {"triangle": triangles}, {"floor": Patch("moving", floor),
                                                  "walls": Patch("fixed", np.flatnonzero(sides))})  # fmt: skip


def anticlockwise(triangles: np.ndarray, points: np.ndarray) -> np.ndarray:
    """(m, 3) the triangles, with clockwise ones turned: dolfinx accepts both orientations, the server one."""
    a, b, c = (points[triangles[:, corner]] for corner in range(3))
    area = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
    return np.where(area[:, None] > 0.0, triangles, triangles[:, ::-1])


def floor_displacement(points: np.ndarray, height: float) -> np.ndarray:
    """(p, 2) displacement of the floor: a smooth bump, zero at both ends."""
    return np.stack([0.0 * points[:, 0], height * np.sin(np.pi * points[:, 0] / LENGTH) ** 2], axis=1)


def solve_laplace(domain: mesh.Mesh) -> tuple[float, float]:
    """Largest error of the solution at a node, and the area of the domain."""
    space = fem.FunctionSpace(domain, ("Lagrange", 1))
    exact = fem.Function(space)
    exact.interpolate(lambda x: 1.0 + x[0] + 2.0 * x[1])
    domain.topology.create_connectivity(1, 2)
    boundary = fem.locate_dofs_topological(space, 1, mesh.exterior_facet_indices(domain.topology))
    u, v = ufl.TrialFunction(space), ufl.TestFunction(space)
    source = fem.Constant(domain, 0.0)
    problem = LinearProblem(
        ufl.inner(ufl.grad(u), ufl.grad(v)) * ufl.dx,
        source * v * ufl.dx,
        bcs=[fem.dirichletbc(exact, boundary)],
        petsc_options={"ksp_type": "preonly", "pc_type": "lu"},
    )
    error = np.abs(problem.solve().x.array - exact.x.array).max()
    return float(error), float(np.real(fem.assemble_scalar(fem.form(fem.Constant(domain, 1.0) * ufl.dx))))


def main() -> int:
    """One period of the floor; prints a line for each step."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--server", help="endpoint; default: a private server")
    parser.add_argument("--steps", type=int, default=8)
    parser.add_argument("--height", type=float, default=0.5, help="largest height of the bump")
    options = parser.parse_args()
    domain = mesh.create_rectangle(MPI.COMM_SELF, [(0.0, 0.0), (LENGTH, HEIGHT)], (40, 10))
    whole = server_mesh(domain)
    with connect(options.server) as server, server.open(whole, {"displacement": "absolute"}) as session:
        floor = whole.points[session.moving_nodes]
        for step in range(1, options.steps + 1):
            height = options.height * np.sin(2.0 * np.pi * step / options.steps)
            moved = session.move(floor_displacement(floor, height))
            domain.geometry.x[:, :2] = whole.points + moved.displacement
            error, area = solve_laplace(domain)
            quality = session.commit().quality["size_skew"]["min"]
            sys.stdout.write(f"step {step}  area {area:.9f}  error {error:.1e}  min size-skew {quality:.3f}\n")
        session.close("discard")
    return 0


if __name__ == "__main__":
    sys.exit(main())
