"""Turek and Hron's channel: quads in a boundary layer around cylinder and flag, triangles outside. Needs gmsh."""

from __future__ import annotations

import math
import tempfile
from pathlib import Path

import gmsh

from mesh_motion_server.files import read_mesh, write_npz

LENGTH, HEIGHT = 2.5, 0.41
CENTRE, RADIUS = (0.2, 0.2), 0.05
FLAG_END, FLAG_HALF = 0.6, 0.01

SIZE_BODY, SIZE_CHANNEL = 0.008, 0.03
LAYER, ROWS, GROWTH = 0.012, 6, 1.3  # thickness of the boundary layer, its rows of quads, their growth
ALONG = {"arc": 20, "flag": 52, "tip": 6}  # cells along half of the cylinder, one side of the flag, its end


def main() -> None:
    """Write mesh.npz into the folder of this file."""
    gmsh.initialize()
    gmsh.option.setNumber("General.Terminal", 0)
    gmsh.option.setNumber("Mesh.Algorithm", 6)
    channel, (body, rim, layer) = channel_curves(), boundary_layer()
    outside = gmsh.model.geo.addPlaneSurface([gmsh.model.geo.addCurveLoop(c) for c in (channel, rim)])
    gmsh.model.geo.synchronize()
    lower, outlet, upper, inlet = channel
    patches = {"walls": [lower, upper], "inlet": [inlet], "outlet": [outlet], "cylinder": body[:2], "flag": body[2:]}
    for name, curves in patches.items():
        gmsh.model.addPhysicalGroup(1, curves, name=name)
    gmsh.model.addPhysicalGroup(2, [outside, *layer], name="fluid")
    gmsh.model.mesh.generate(2)
    with tempfile.TemporaryDirectory() as folder:
        gmsh.write(f"{folder}/mesh.msh")
        write_npz(Path(__file__).with_name("mesh.npz"), read_mesh(f"{folder}/mesh.msh"))
    gmsh.finalize()


def channel_curves() -> list[int]:
    """Lower wall, outlet, upper wall, inlet."""
    corners = [(0.0, 0.0), (LENGTH, 0.0), (LENGTH, HEIGHT), (0.0, HEIGHT)]
    points = [gmsh.model.geo.addPoint(x, y, 0.0, SIZE_CHANNEL) for x, y in corners]
    return [gmsh.model.geo.addLine(points[i], points[(i + 1) % 4]) for i in range(4)]


def boundary_layer() -> tuple[list[int], list[int], list[int]]:
    """The body's curves, the curves at the layer's rim, and the layer's five transfinite surfaces between them."""
    body_points, body = outline(0.0)
    rim_points, rim = outline(LAYER)
    rays = [gmsh.model.geo.addLine(a, b) for a, b in zip(body_points, rim_points, strict=True)]
    for ray in rays:
        gmsh.model.geo.mesh.setTransfiniteCurve(ray, ROWS + 1, "Progression", GROWTH)
    layer = []
    for i, cells in enumerate(ALONG[kind] for kind in ("arc", "arc", "flag", "tip", "flag")):
        for curve in (body[i], rim[i]):
            gmsh.model.geo.mesh.setTransfiniteCurve(curve, cells + 1)
        loop = gmsh.model.geo.addCurveLoop([body[i], rays[(i + 1) % 5], -rim[i], -rays[i]])
        layer.append(gmsh.model.geo.addPlaneSurface([loop]))
        gmsh.model.geo.mesh.setTransfiniteSurface(layer[-1])
        gmsh.model.geo.mesh.setRecombine(2, layer[-1])
    return body, rim, layer


def outline(distance: float) -> tuple[list[int], list[int]]:
    """Points and curves around the body at a distance: two arcs from above the flag to below it, the flag's sides."""
    (x, y), radius, half, end = CENTRE, RADIUS + distance, FLAG_HALF + distance, FLAG_END + distance
    root = x + math.sqrt(radius**2 - half**2)
    places = [(root, y + half), (x - radius, y), (root, y - half), (end, y - half), (end, y + half)]
    centre = gmsh.model.geo.addPoint(x, y, 0.0)
    above, front, below, *tip = points = [gmsh.model.geo.addPoint(*place, 0.0, SIZE_BODY) for place in places]
    arcs = [gmsh.model.geo.addCircleArc(a, centre, b) for a, b in ((above, front), (front, below))]
    sides = [gmsh.model.geo.addLine(a, b) for a, b in ((below, tip[0]), (tip[0], tip[1]), (tip[1], above))]
    return points, [*arcs, *sides]


if __name__ == "__main__":
    main()
