"""NGSolve: Stokes flow past a flap that bends, on a mesh that the mesh-motion server moves.

Netgen makes the mesh once. Each step bends the flap, the server answers with the displacement of every vertex, and
``mesh.SetDeformation`` applies it to the finite elements: no element is built again. python moving_flap.py [--server …]
"""

from __future__ import annotations

import argparse
import sys

import numpy as np
from mesh_motion_client import Mesh, Patch, connect
from netgen.geom2d import SplineGeometry
from ngsolve import (
    H1,
    BilinearForm,
    CoefficientFunction,
    Grad,
    GridFunction,
    InnerProduct,
    Integrate,
    VectorH1,
    div,
    dx,
    y,
)
from ngsolve import Mesh as NGMesh

LENGTH, HEIGHT = 4.0, 1.0
FLAP_LEFT, FLAP_RIGHT, FLAP_TOP = 1.45, 1.55, 0.6
VISCOSITY = 1.0
ROLES = {"flap": "moving", "inlet": "fixed", "outlet": "fixed", "walls": "fixed"}


def channel(size: float) -> NGMesh:
    """A channel with a flap on its floor."""
    corners = [(0, 0), (FLAP_LEFT, 0), (FLAP_LEFT, FLAP_TOP), (FLAP_RIGHT, FLAP_TOP), (FLAP_RIGHT, 0), (LENGTH, 0),
               (LENGTH, HEIGHT), (0, HEIGHT)]  # fmt: skip
    names = ["walls", "flap", "flap", "flap", "walls", "outlet", "walls", "inlet"]
    geometry = SplineGeometry()
    points = [geometry.AppendPoint(*corner) for corner in corners]
    for number, name in enumerate(names):
        geometry.Append(["line", points[number], points[(number + 1) % len(points)]], bc=name)
    return NGMesh(geometry.GenerateMesh(maxh=size))


def server_mesh(mesh: NGMesh) -> Mesh:
    """The solver's mesh for the server: vertices, triangles, and the vertices of each boundary."""
    points = np.array([vertex.point for vertex in mesh.vertices])
    triangles = np.array([[vertex.nr for vertex in element.vertices] for element in mesh.Elements()])
    patches = {}
    for name, role in ROLES.items():
        edges = mesh.Boundaries(name).Elements()
        patches[name] = Patch(role, np.unique([vertex.nr for edge in edges for vertex in edge.vertices]))
    return Mesh(points, {"triangle": triangles}, patches)


def bent(points: np.ndarray, deflection: float) -> np.ndarray:
    """(p, 2) displacement of the flap's points: a parabola along it, with the flap's height reduced by bending."""
    along = points[:, 1] / FLAP_TOP
    return deflection * np.stack([along**2, -2.0 / 3.0 * deflection / FLAP_TOP * along**3], axis=1)


def stokes_force(mesh: NGMesh) -> np.ndarray:
    """Force of the flow on the flap, from the reaction of the discrete equations."""
    velocity = VectorH1(mesh, order=2, dirichlet="inlet|walls|flap")
    space = velocity * H1(mesh, order=1)
    (u, p), (v, q) = space.TnT()
    form = BilinearForm(space)
    form += (VISCOSITY * InnerProduct(Grad(u), Grad(v)) - div(u) * q - div(v) * p) * dx
    form.Assemble()
    flow = GridFunction(space)
    flow.components[0].Set(CoefficientFunction((4 * y * (HEIGHT - y), 0)), definedon=mesh.Boundaries("inlet"))
    residual = form.mat.CreateColVector()
    residual.data = form.mat * flow.vec
    flow.vec.data -= form.mat.Inverse(space.FreeDofs()) * residual
    residual.data = form.mat * flow.vec
    force = []
    for direction in ((1, 0), (0, 1)):
        test = GridFunction(space)
        test.components[0].Set(CoefficientFunction(direction), definedon=mesh.Boundaries("flap"))
        force.append(-InnerProduct(residual, test.vec))
    return np.array(force)


def deform(mesh: NGMesh, deformation: GridFunction, displacement: np.ndarray) -> None:
    """Apply the vertices' displacement (n, 2) to the mesh."""
    for component, values in zip(deformation.components, displacement.T, strict=True):
        component.vec.FV().NumPy()[:] = values  # of order 1: one value a vertex, in the vertices' order
    mesh.SetDeformation(deformation)


def main() -> int:
    """Bend the flap in steps; print the force on it for each."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--server", help="endpoint; default: a private server")
    parser.add_argument("--steps", type=int, default=5)
    parser.add_argument("--size", type=float, default=0.1, help="length of the triangles' edges")
    parser.add_argument("--deflection", type=float, default=0.3, help="final deflection of the flap's tip")
    options = parser.parse_args()
    mesh = channel(options.size)
    deformation = GridFunction(VectorH1(mesh, order=1))
    whole = server_mesh(mesh)
    with connect(options.server) as server, server.open(whole, {"displacement": "absolute"}) as session:
        flap = whole.points[session.moving_nodes]
        for step in range(1, options.steps + 1):
            moved = session.move(bent(flap, options.deflection * step / options.steps))
            deform(mesh, deformation, moved.displacement)
            drag, lift = stokes_force(mesh)
            quality = session.commit().quality["size_skew"]["min"]
            area = Integrate(CoefficientFunction(1.0), mesh)
            sys.stdout.write(f"step {step}  area {area:.9f}  drag {drag:.6f}  lift {lift:.6f}  "
                             f"min size-skew {quality:.3f}\n")  # fmt: skip
        session.close("discard")
    return 0


if __name__ == "__main__":
    sys.exit(main())
