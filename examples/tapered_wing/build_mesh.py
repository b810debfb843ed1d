"""A swept, tapered half wing with the planform of AGARD 445.6 on a symmetry plane, in tetrahedra. Needs gmsh."""

from __future__ import annotations

import tempfile
from pathlib import Path

import gmsh
import numpy as np

from mesh_motion_server.files import read_mesh, write_npz

#: Leading edge x, chord and span position z of root and tip, in metres (AGARD R-765).
ROOT, TIP = (0.0, 0.557784, 0.0), (0.809396, 0.368199, 0.762)
THICKNESS = 0.08  # twice AGARD's: no slivers at the sharp corner of trailing edge and tip
LOW, HIGH = (-1.2, -1.2, 0.0), (2.4, 1.2, 1.8)
SIZE_WING, SIZE_FAR = 0.024, 0.3


def main() -> None:
    """Write mesh.npz into the folder of this file."""
    gmsh.initialize()
    gmsh.option.setNumber("General.Terminal", 0)
    fluid = cut_wing_from_box()
    patches = sort_faces()
    for name, faces in patches.items():
        gmsh.model.addPhysicalGroup(2, faces, name=name)
    gmsh.model.addPhysicalGroup(3, [fluid], name="fluid")
    refine_towards(patches["wing"])
    gmsh.option.setNumber("Mesh.Algorithm3D", 10)  # HXT
    gmsh.model.mesh.generate(3)
    gmsh.model.mesh.optimize("Netgen")
    with tempfile.TemporaryDirectory() as folder:
        gmsh.write(f"{folder}/mesh.msh")
        write_npz(Path(__file__).with_name("mesh.npz"), read_mesh(f"{folder}/mesh.msh"))
    gmsh.finalize()


def cut_wing_from_box() -> int:
    """The volume between the wing and the box around it."""
    wing = gmsh.model.occ.addThruSections([section(*ROOT), section(*TIP)], makeSolid=True, makeRuled=True)
    box = gmsh.model.occ.addBox(*LOW, *(high - low for low, high in zip(LOW, HIGH, strict=True)))
    [(_, fluid)], _ = gmsh.model.occ.cut([(3, box)], wing)
    gmsh.model.occ.synchronize()
    return int(fluid)


def section(x0: float, chord: float, z: float) -> int:
    """A symmetric NACA four-digit section with a closed trailing edge: its wire."""
    s = 0.5 * (1.0 - np.cos(np.linspace(0.0, np.pi, 15)))
    y = 5 * THICKNESS * (0.2969 * np.sqrt(s) - 0.126 * s - 0.3516 * s**2 + 0.2843 * s**3 - 0.1036 * s**4)
    nose, tail = (gmsh.model.occ.addPoint(x0 + chord * end, 0.0, z) for end in (0.0, 1.0))
    sides = []
    for sign in (1.0, -1.0):
        between = [
            gmsh.model.occ.addPoint(x0 + chord * a, sign * chord * b, z) for a, b in zip(s[1:-1], y[1:-1], strict=True)
        ]
        sides.append(gmsh.model.occ.addSpline([nose, *between, tail]))
    return int(gmsh.model.occ.addWire(sides))


def sort_faces() -> dict[str, list[int]]:
    """The faces of each patch, found by their bounding boxes."""
    patches: dict[str, list[int]] = {"wing": [], "symmetry": [], "far": []}
    for _, face in gmsh.model.getEntities(2):
        box = np.array(gmsh.model.getBoundingBox(2, face)).reshape(2, 3)
        if box[1, 2] < 1e-6:
            patches["symmetry"].append(face)
        elif (box[0] > np.array(LOW) - [0, 0, 1] + 0.1).all() and (box[1] < np.array(HIGH) - 0.1).all():
            patches["wing"].append(face)
        else:
            patches["far"].append(face)
    return patches


def refine_towards(faces: list[int]) -> None:
    """Cell size grows with the distance to the wing."""
    distance = gmsh.model.mesh.field.add("Distance")
    gmsh.model.mesh.field.setNumbers(distance, "SurfacesList", faces)
    gmsh.model.mesh.field.setNumber(distance, "Sampling", 60)
    size = gmsh.model.mesh.field.add("Threshold")
    for option, value in {
        "InField": distance, "SizeMin": SIZE_WING, "SizeMax": SIZE_FAR, "DistMin": 0.02, "DistMax": 1.0,
    }.items():  # fmt: skip
        gmsh.model.mesh.field.setNumber(size, option, value)
    gmsh.model.mesh.field.setAsBackgroundMesh(size)
    for option in ("MeshSizeExtendFromBoundary", "MeshSizeFromPoints", "MeshSizeFromCurvature"):
        gmsh.option.setNumber(f"Mesh.{option}", 0)


if __name__ == "__main__":
    main()
