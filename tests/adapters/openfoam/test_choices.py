"""Roles that follow from a patch's type, polygons in 2D, and choices apart from the method."""

import re

import numpy as np
import pytest
from mesh_motion_client import Credentials, connect

from tests.faults.waiting import wait_until

HEADER = "FoamFile {{ version 2.0; format ascii; class dictionary; object {}; }}\n"


def change(case, name, *changes):
    """Replace words of a file of the case; each word must be there."""
    path = case.folder / name
    text = path.read_text()
    for was, becomes in changes:
        assert was in text, was
        text = text.replace(was, becomes)
    path.write_text(text)


def points_of(case, patch):
    faces = case.faces()
    return np.unique([point for i in case.patch(patch) for point in faces[i]])


def no_flow(case):
    """Fields of a flow name the patches too; the mesh alone needs none."""
    for name in "U", "p":
        (case.folder / "0" / name).unlink()


def test_symmetry_is_what_its_patches_type_says(make_case):
    case = make_case(steps=2)
    no_flow(case)
    change(case, "system/blockMeshDict", ("walls\n    {\n        type wall;", "walls\n    {\n        type symmetry;"))
    change(case, "0/pointDisplacement", ("walls            { type slip; }", "walls { type symmetry; }"))
    change(case, "constant/dynamicMeshDict", ("walls   slip;", ""))
    case.method("support_radius 0.8; quality_threshold 0.2;")
    case.run("blockMesh")
    case.run("moveDynamicMesh")
    start, moved = case.numbers("constant/polyMesh/points", 3), case.points("0.1")
    walls = points_of(case, "walls")
    np.testing.assert_allclose(moved[walls, 1], start[walls, 1], rtol=0, atol=1e-14)
    assert np.abs(moved[walls, 0] - start[walls, 0]).max() > 1e-3
    assert "Mesh OK." in case.run("checkMesh", "-latestTime")


def test_cyclic_patches_stay_images_of_each_other(make_case):
    case = make_case(steps=2)
    no_flow(case)
    change(
        case,
        "system/blockMeshDict",
        ("inlet\n    {\n        type patch;", "inlet\n    {\n        type cyclic; neighbourPatch outlet;"),
        ("outlet\n    {\n        type patch;", "outlet\n    {\n        type cyclic; neighbourPatch inlet;"),
    )
    change(
        case,
        "0/pointDisplacement",
        ('"(inlet|outlet)" { type fixedValue; value uniform (0 0 0); }', '"(inlet|outlet)" { type cyclic; }'),
    )
    change(case, "constant/dynamicMeshDict", ("inlet   fixed;", ""), ("outlet  fixed;", ""))
    case.method("support_radius 1.5; quality_threshold 0.2;")
    case.run("blockMesh")
    case.run("moveDynamicMesh")
    start, moved = case.numbers("constant/polyMesh/points", 3), case.points("0.1")
    by_height = [points_of(case, name) for name in ("inlet", "outlet")]
    left, right = (points[np.lexsort(np.round(start[points, 1:], 9).T)] for points in by_height)
    np.testing.assert_allclose(start[right] - start[left], np.broadcast_to([2, 0, 0], (len(left), 3)), atol=1e-12)
    np.testing.assert_allclose(moved[right] - moved[left], start[right] - start[left], rtol=0, atol=1e-13)
    assert np.abs(moved[left] - start[left]).max() > 1e-3
    assert "Mesh OK." in case.run("checkMesh", "-latestTime")


@pytest.mark.parametrize(("gap", "words"), [("1e-10", ""), ("1e-3", "lies on moving patches that move it")])
def test_two_moving_patches_agree_where_they_meet(make_case, gap, words):
    case = make_case(steps=2)
    no_flow(case)
    still = "{ type fixedValue; value uniform (0 0 0); }"
    change(
        case,
        "0/pointDisplacement",
        (f'"(inlet|outlet)" {still}', f"inlet {{ type fixedValue; value uniform (0 {gap} 0); }} outlet {still}"),
        ("walls            { type slip; }", f"walls {still}"),
    )
    change(case, "constant/dynamicMeshDict", ("inlet   fixed;", "inlet moving;"), ("walls   slip;", "walls moving;"))
    case.run("blockMesh")
    assert words in case.run("moveDynamicMesh", expect=1 if words else 0)
    if not words:
        start, moved = case.numbers("constant/polyMesh/points", 3), case.points("0.1")
        both = np.intersect1d(points_of(case, "inlet"), points_of(case, "walls"))
        np.testing.assert_allclose(moved[both, 1] - start[both, 1], float(gap), rtol=1e-5)


@pytest.mark.parametrize("elsewhere", ["0", "1e-9"])
def test_a_fixed_patch_may_have_what_a_moving_one_gives_their_common_points(make_case, elsewhere):
    """A coupling's checkpoint copies the point there; any other point of a fixed patch must stay."""
    case = make_case(steps=2)
    no_flow(case)
    case.run("blockMesh")
    faces = case.faces()
    walls = list(dict.fromkeys(point for i in case.patch("walls") for point in faces[i]))
    common = np.isin(walls, points_of(case, "inlet"))
    assert 0 < common.sum() < len(walls)
    values = " ".join(f"(0 {'1e-3' if there else elsewhere} 0)" for there in common)
    still = "{ type fixedValue; value uniform (0 0 0); }"
    change(
        case,
        "0/pointDisplacement",
        (f'"(inlet|outlet)" {still}', f"inlet {{ type fixedValue; value uniform (0 1e-3 0); }} outlet {still}"),
        (
            "walls            { type slip; }",
            f"walls {{ type fixedValue; value nonuniform List<vector> {len(walls)}({values}); }}",
        ),
    )
    change(case, "constant/dynamicMeshDict", ("inlet   fixed;", "inlet moving;"), ("walls   slip;", "walls fixed;"))
    said = case.run("moveDynamicMesh", expect=int(elsewhere != "0"))
    if elsewhere != "0":
        assert "patch walls has the role fixed, but pointDisplacement moves it by 1e-09" in said
        return
    start, moved = case.numbers("constant/polyMesh/points", 3), case.points("0.1")
    expected = np.outer(np.where(common, 1e-3, 0.0), [0.0, 1.0, 0.0])
    np.testing.assert_allclose(moved[walls] - start[walls], expected, rtol=0, atol=1e-12)


def test_polygons_in_the_plane(make_case):
    case = make_case(steps=2)
    no_flow(case)
    action = "{ name some; type cellSet; action new; source boxToCell; box (0.4 0.1 -1) (1.3 0.9 1); }"
    plan = (
        "set some; coordinateSystem global; globalCoeffs { tan1 (1 0 0); tan2 (0 1 0); }\n"
        "directions (tan1 tan2); useHexTopology no; geometricCut yes; writeMesh no;\n"
    )
    (case.folder / "system/topoSetDict").write_text(HEADER.format("topoSetDict") + f"actions ({action});\n")
    (case.folder / "system/refineMeshDict").write_text(HEADER.format("refineMeshDict") + plan)
    case.run("topoSet")
    case.run("refineMesh", "-overwrite")
    faces = case.faces()
    assert {len(faces[i]) for i in case.patch("frontAndBack")} >= {4, 5}
    case.run("moveDynamicMesh")
    start, moved = case.numbers("constant/polyMesh/points", 3), case.points("0.1")
    plate = points_of(case, "plate")
    angle = 0.7 * np.sin(2 * np.pi * 0.1)
    turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    origin = np.array([0.85, 0.5, 0])
    np.testing.assert_allclose(moved[plate], (start[plate] - origin) @ turn.T + origin, rtol=0, atol=1e-12)
    np.testing.assert_array_equal(moved[:, 2], start[:, 2])
    assert "Mesh OK." in case.run("checkMesh", "-latestTime")


@pytest.mark.parametrize(("commit", "steps"), [("timeStep", 2), ("everyMove", 6)])
def test_every_move_is_a_step_where_asked(make_case, commit, steps):
    case = make_case(steps=2)
    case.method("quality_threshold 0.3;", f"commit {commit};")
    case.run("moveDynamicMesh")
    state = (case.folder / "0.1/uniform/remoteMeshMotion/state").read_text()
    assert re.search(r"step\s+(\d+);", state)[1] == str(steps)


def test_the_end_of_the_run_is_sent(make_case, mesh_motion_server):
    case = make_case(steps=2)
    case.method("quality_threshold 0.3;", "atEnd keep;")
    case.run("moveDynamicMesh")
    held = Credentials.load(case.folder / "0.1/uniform/remoteMeshMotion/credentials")
    with connect(mesh_motion_server.endpoint) as server, server.resume(held) as session:
        assert session.status().report["final_step"] == 2
        session.close("discard")


@pytest.mark.parametrize(("at_end", "label"), [("keep", "keepIt"), ("discard", '"let it go"')])
def test_a_session_is_kept_or_discarded(make_case, mesh_motion_server, at_end, label):
    case = make_case(steps=2)
    case.method("quality_threshold 0.3;", f"atEnd {at_end}; label {label};")
    case.run("moveDynamicMesh")
    with connect(mesh_motion_server.endpoint) as server:

        def kept():
            return [entry["step"] for entry in server.sessions() if entry["label"] == label.strip('"')]

        # the list shows the end of a session once its worker has ended
        wait_until(lambda: kept() == ([2] if at_end == "keep" else []), f"the session after {at_end}")


@pytest.mark.parametrize(
    ("further", "words"),
    [
        ("atEnd discrad;", ["atEnd is keep or discard; got discrad"]),
        ("commit always;", ["commit is timeStep or everyMove; got always"]),
        ("onServerLos wait 100;", ["there is no entry onServerLos", "onServerLoss"]),
        ("onServerLoss retry;", ["onServerLoss is fail, or wait and the seconds; got retry"]),
        ("onServerLoss wait 5 seconds;", ["wait and the seconds; got wait 5 seconds"]),
        ("durability none;", ["durability", "none"]),
    ],
)
def test_a_wrong_choice_is_named(make_case, further, words):
    case = make_case(steps=1)
    case.method("quality_threshold 0.3;", further)
    case.run("moveDynamicMesh", expect=1)
    assert "FOAM FATAL" in case.output
    for word in words:
        assert word in case.output


@pytest.mark.parametrize(
    ("was", "becomes", "words"),
    [
        ("quality_threshold 0.3;", "quality_threshold 0.3 0.1;", "method: quality_threshold must be a number"),
        ("quality_threshold 0.3;", "quality_threshold { value 0.3; }", "method: quality_threshold must be a number"),
        ("walls   slip;", 'walls slip; "wallls.*" fixed;', r'there is no patch "wallls\.\*"'),
        ("motionSolver      ", "commit everyMove;\nmotionSolver      ", "commit stands outside of"),
    ],
    ids=["two values", "a dictionary", "a pattern", "outside of the coefficients"],
)
def test_settings_without_an_effect_are_refused(make_case, was, becomes, words):
    case = make_case(steps=1)
    change(case, "constant/dynamicMeshDict", (was, becomes))
    case.run("moveDynamicMesh", expect=1)
    assert "FOAM FATAL IO ERROR" in case.output
    assert re.search(words, case.output)


WEDGE = """scale 1;
vertices ((0 0 0) (2 0 0) (2 1 -0.1) (0 1 -0.1) (2 1 0.1) (0 1 0.1));
blocks (hex (0 1 2 3 0 1 4 5) (8 6 1) simpleGrading (3 1 1));
boundary (
  back { type wedge; faces ((0 3 2 1)); } front { type wedge; faces ((0 1 4 5)); }
  axis { type empty; faces ((0 1 1 0)); }
  ends { type patch; faces ((0 5 3 0) (1 2 4 1)); } wall { type wall; faces ((3 5 4 2)); }
);
"""
WEDGE_FIELD = """dimensions [0 1 0 0 0 0 0]; internalField uniform (0 0 0);
boundaryField
{
    "(back|front)" { type wedge; } axis { type empty; } ends { type slip; }
    wall { type oscillatingDisplacement; amplitude (0 -0.3 0); omega 15.7079632679; value uniform (0 0 0); }
}
"""


def make_wedge(make_case, name):
    """A cylinder as a wedge whose wall moves towards the axis."""
    case = make_case(name, steps=2)
    no_flow(case)
    (case.folder / "system/blockMeshDict").write_text(HEADER.format("blockMeshDict") + WEDGE)
    head = HEADER.format("pointDisplacement").replace("dictionary", "pointVectorField")
    (case.folder / "0/pointDisplacement").write_text(head + WEDGE_FIELD)
    path = case.folder / "constant/dynamicMeshDict"
    path.write_text(re.sub(r"patches\s*\{[^}]*\}", "patches { wall moving; ends slip; }", path.read_text()))
    case.run("blockMesh")
    return case


def test_a_wedge_is_moved_as_a_plane_on_one_rank_and_on_two(make_case):
    serial, parallel = make_wedge(make_case, "serial"), make_wedge(make_case, "parallel")
    serial.run("moveDynamicMesh")
    start, moved = serial.numbers("constant/polyMesh/points", 3), serial.points("0.1")
    wall, axis = start[:, 1] > 1 - 1e-9, start[:, 1] < 1e-9
    np.testing.assert_allclose(moved[wall, 1], 0.7, rtol=0, atol=1e-9)
    np.testing.assert_array_equal(moved[axis, 1:], 0.0)
    np.testing.assert_allclose(moved[:, 2], np.sign(start[:, 2]) * 0.1 * moved[:, 1], rtol=0, atol=1e-12)
    ends = np.abs(start[:, 0] - 1) > 1 - 1e-9
    np.testing.assert_allclose(moved[ends, 0], start[ends, 0], rtol=0, atol=1e-12)
    assert "Mesh OK." in serial.run("checkMesh", "-latestTime")
    parallel.run("decomposePar")
    parallel.run("moveDynamicMesh", ranks=2)
    parallel.check_ranks("0.1", serial.points("0.1"))


@pytest.mark.parametrize("entry", ["onServerLos wait 100;", "diffusivity uniform;"])
def test_entries_without_a_dictionary_of_their_own(make_case, entry):
    case = make_case(steps=1)
    path = case.folder / "constant/dynamicMeshDict"
    text = path.read_text().replace("remoteMeshMotionCoeffs\n{", "").rstrip().removesuffix("}")
    path.write_text(text + "updateControl timeStep;\n")
    case.run("moveDynamicMesh")
    path.write_text(text + entry)
    case.run("moveDynamicMesh", expect=1)
    assert f"there is no entry {entry.split()[0]}" in case.output
    assert "onServerLoss" in case.output


def test_a_misspelt_entry_of_a_coupled_patch(make_case):
    case = make_case(steps=1)
    path = case.folder / "0/pointDisplacement"
    coupled = 'plate { type coupledDisplacement; endpoint "ipc:///no-server"; rho 1; pReff 0; value uniform (0 0 0); }'
    path.write_text(re.sub(r"plate\s*\{[^}]*\}", coupled, path.read_text()))
    case.run("moveDynamicMesh", expect=1)
    assert "there is no entry pReff" in case.output
