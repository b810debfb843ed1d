"""Meshes of three dimensions: all types of cells, polyhedra, faces of many points, on one rank and on two."""

import re

import numpy as np
import pytest

from mesh_motion_server.files.openfoam.polymesh import read_face_mesh

HEADER = "FoamFile {{ version 2.0; format ascii; class {}; object {}; }}\n"
# a cube, a prism at its side, a pyramid on top of it and a tetrahedron next to the pyramid, as Gmsh writes them
SHAPES = """$MeshFormat
2.2 0 8
$EndMeshFormat
$Nodes
12
1 0 0 0
2 1 0 0
3 1 1 0
4 0 1 0
5 0 0 1
6 1 0 1
7 1 1 1
8 0 1 1
9 2 0 0
10 2 1 0
11 0.5 0.5 2
12 2 0.5 2
$EndNodes
$Elements
4
1 5 2 1 1 1 2 3 4 5 6 7 8
2 6 2 1 1 2 6 9 3 7 10
3 7 2 1 1 5 6 7 8 11
4 4 2 1 1 6 12 7 11
$EndElements
"""


@pytest.fixture
def make_space_case(make_case):
    """The channel with the plate in it as a coarse 3D mesh."""

    def make(name="space"):
        case = make_case(name, steps=2)
        plan = (case.folder / "system/blockMeshDict").read_text()
        plan = plan.replace("type empty", "type patch").replace(" 0.1)", " 0.3)")
        for fine, coarse in (("14 10", "7 5"), ("8 10", "4 5"), ("20 10", "9 5"), ("14 3", "7 2"), ("20 3", "9 2")):
            plan = plan.replace(f"({fine} 1)", f"({coarse} 3)")
        (case.folder / "system/blockMeshDict").write_text(plan)
        case.set("0/pointDisplacement", amplitude="0.3")
        path = case.folder / "0/pointDisplacement"
        path.write_text(path.read_text().replace("type empty", "type slip"))
        path = case.folder / "constant/dynamicMeshDict"
        path.write_text(path.read_text().replace("walls   slip;", "walls slip; frontAndBack slip;"))
        case.method("support_radius 0.6; quality_threshold 0.05;")
        for flow in "U", "p":
            (case.folder / "0" / flow).unlink()
        case.run("blockMesh")
        return case

    return make


def refine(case):
    """Divide the hexahedra around a corner of the plate into eight: their neighbours are then polyhedra."""
    action = "{ name some; type cellSet; action new; source boxToCell; box (0.5 0.2 -1) (0.9 0.6 0.15); }"
    plan = HEADER.format("dictionary", "topoSetDict") + f"actions ({action});\n"
    (case.folder / "system/topoSetDict").write_text(plan)
    case.run("topoSet")
    case.run("refineHexMesh", "some", "-overwrite")


def check_moved(case, time):
    """The plate is at its prescribed position, the sliding sides are on their planes, and checkMesh accepts the
    mesh.
    """
    start, moved = case.numbers("constant/polyMesh/points", 3), case.points(time)
    faces = case.faces()
    angle = 0.3 * np.sin(2 * np.pi * float(time))
    turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    plate = np.unique([point for i in case.patch("plate") for point in faces[i]])
    origin = np.array([0.85, 0.5, 0])
    np.testing.assert_allclose(moved[plate], (start[plate] - origin) @ turn.T + origin, rtol=0, atol=1e-12)
    sides = np.unique([point for i in case.patch("frontAndBack") for point in faces[i]])
    np.testing.assert_allclose(moved[sides, 2], start[sides, 2], rtol=0, atol=1e-12)
    assert np.abs(moved - start).max() > 0.01
    assert "Mesh OK." in case.run("checkMesh", "-latestTime")


def test_every_type_of_cell(make_case):
    case = make_case(steps=2)
    (case.folder / "shapes.msh").write_text(SHAPES)
    case.run("gmshToFoam", "shapes.msh")
    field = HEADER.format("pointVectorField", "pointDisplacement") + (
        "dimensions [0 1 0 0 0 0 0]; internalField uniform (0 0 0);\n"
        'boundaryField { ".*" { type fixedValue; value uniform (0.1 0.2 0.3); } }\n'
    )
    (case.folder / "0/pointDisplacement").write_text(field)
    path = case.folder / "constant/dynamicMeshDict"
    path.write_text(re.sub(r"patches\s*\{[^}]*\}", 'patches { ".*" moving; }', path.read_text()))
    case.run("moveDynamicMesh")
    start = case.numbers("constant/polyMesh/points", 3)
    assert len(start) == 12
    np.testing.assert_allclose(case.points("0.1") - start, np.broadcast_to([0.1, 0.2, 0.3], start.shape), atol=1e-15)


@pytest.mark.nightly
def test_a_refined_mesh_has_long_faces_on_one_rank_and_on_two(make_space_case):
    serial, parallel = make_space_case("serial"), make_space_case("parallel")
    for case in (serial, parallel):
        refine(case)
    faces = serial.faces()
    assert max(len(faces[i]) for i in serial.patch("plate")) > 4
    serial.run("moveDynamicMesh")
    check_moved(serial, "0.1")
    parallel.run("decomposePar")
    parallel.run("moveDynamicMesh", ranks=2)
    parallel.check_ranks("0.1", serial.points("0.1"))


def displace_a_point(case, height):
    """Move a point of a refined mesh to another height: its cells are bent."""
    refine(case)
    start = case.numbers("constant/polyMesh/points", 3)
    (point,) = np.flatnonzero(np.linalg.norm(start - [0.55, 0.315, 0.1], axis=1) < 1e-9)
    path = case.folder / "constant/polyMesh/points"
    written = re.findall(r"(?m)^\(\S+ \S+ \S+\)$", path.read_text())[point]
    path.write_text(path.read_text().replace(written, f"(0.55 0.315 {height})"))


def test_a_cell_that_its_centre_does_not_see_as_a_whole_is_divided_otherwise(make_space_case):
    """Its quadrilaterals are split, and so are the hexahedra on their other side, on another rank too."""
    serial, parallel = make_space_case("serial"), make_space_case("parallel")
    for case in (serial, parallel):
        displace_a_point(case, 0.19)
    serial.run("moveDynamicMesh")
    rank_of = (read_face_mesh(serial.folder / "constant/polyMesh").volumes_and_centres()[1][:, 0] > 0.55).astype(int)
    ranks = "\n".join(map(str, rank_of))
    text = f"{HEADER.format('labelList', 'ranks')}{len(rank_of)}\n(\n{ranks}\n)\n"
    (parallel.folder / "constant/ranks").write_text(text)
    plan = parallel.folder / "system/decomposeParDict"
    plan.write_text(plan.read_text().partition("method ")[0] + 'method manual; manualCoeffs { dataFile "ranks"; }\n')
    parallel.run("decomposePar")
    parallel.run("moveDynamicMesh", ranks=2)
    # other corners of the divided cells count, in the penalty of nodes that hardly move
    parallel.check_ranks("0.1", serial.points("0.1"), atol=1e-8)


def test_a_cell_that_no_point_of_it_sees_as_a_whole(make_space_case):
    case = make_space_case()
    displace_a_point(case, 0.5)
    case.run("moveDynamicMesh", expect=1)
    assert "FOAM FATAL ERROR" in case.output
    assert re.search(r"cell \d+ at \(0\.5\d* 0\.3\d* 0\.\d*\) cannot be judged: no point", case.output)


@pytest.mark.slow
def test_the_dual_mesh_has_polyhedra(make_space_case):
    case = make_space_case()
    case.run("polyDualMesh", "60", "-overwrite")
    assert re.search(r"polyhedra:\s+[1-9]\d\d", case.run("checkMesh", "-constant"))
    case.run("moveDynamicMesh")
    check_moved(case, "0.1")
