"""Only a cellZone is moved, because dynamicMultiMotionSolverFvMesh has a motion solver for each zone."""

import shutil

import numpy as np
import pytest
from scipy.spatial import cKDTree

HEAD = "FoamFile {{ version 2.0; format ascii; class dictionary; object {}; }}\n"
#: The zone reaches from the inlet to a little behind the plate.
ZONE = """
actions
(
    {{ name near; type cellSet; action new; source boxToCell; sourceInfo {{ box (-1 -1 -1) ({} 2 1); }} }}
    {{ name near; type cellZoneSet; action new; source setToCellZone; sourceInfo {{ set near; }} }}
);
"""
SOLVER = """
    cellZone {}; motionSolverLibs ("libremoteMeshMotion.so"); solver remoteMeshMotion;
    remoteMeshMotionCoeffs
    {{
        endpoint "$MESH_MOTION_ENDPOINT"; patches {{ plate moving; inlet fixed; walls slip; {} }}
        method {{ correction none; support_radius 0.5; }}
    }}
"""
OTHERS = "oldInternalFaces fixed;"


@pytest.fixture
def zone_case(make_case):
    """Copies of the tutorial case with the zone ``near``, up to x = end."""

    def make(name="zone", end=1.25, steps=2):
        case = make_case(name, steps=steps)
        case.set("system/controlDict", writeInterval="1", writePrecision="17")
        (case.folder / "system/topoSetDict").write_text(HEAD.format("topoSetDict") + ZONE.format(end))
        case.run("topoSet")
        several(case)
        return case

    return make


def write(case, text):
    (case.folder / "constant/dynamicMeshDict").write_text(HEAD.format("dynamicMeshDict") + text)


def several(case, zone="near", others=OTHERS):
    """A motion solver for each zone: here one."""
    solver = SOLVER.format(zone, others)
    write(
        case,
        f"dynamicFvMesh dynamicMultiMotionSolverFvMesh; dynamicMultiMotionSolverFvMeshCoeffs {{ n {{ {solver} }} }}",
    )


def single(case, zone="near", others=OTHERS):
    """The motion solver of the whole mesh, with the setting to move a zone."""
    write(case, "dynamicFvMesh dynamicMotionSolverFvMesh;" + SOLVER.format(zone, others))


def divide(case, ranks):
    division = f"numberOfSubdomains {ranks}; method simple; simpleCoeffs {{ n ({ranks} 1 1); delta 0.001; }}"
    (case.folder / "system/decomposeParDict").write_text(HEAD.format("decomposeParDict") + division)
    case.run("decomposePar")


@pytest.mark.parametrize("choose", [several, single])
def test_it_moves_as_if_it_were_the_whole_mesh(zone_case, choose):
    case, alone = zone_case(), zone_case("alone")
    choose(case)
    case.run("moveDynamicMesh")
    alone.run("subsetMesh", "near", "-patch", "outlet", "-overwrite")
    shutil.copy(case.folder / "0/pointDisplacement", alone.folder / "0")
    single(alone, "none", "outlet fixed;")
    alone.run("moveDynamicMesh")
    start, end = case.points("constant"), case.points("0.1")
    far, rows = cKDTree(alone.points("constant")).query(start)
    np.testing.assert_array_equal(end[far > 0], start[far > 0])
    np.testing.assert_array_equal(end[far == 0], alone.points("0.1")[rows[far == 0]])
    assert np.abs(end - start).max() > 0.05


_ALL_MOVE = """FoamFile { version 2.0; format ascii; class pointVectorField; object pointDisplacement; }
dimensions [0 1 0 0 0 0 0]; internalField uniform (0 0 0); boundaryField
{
    ".*" { type uniformFixedValue; uniformValue table ((0 (0 0 0)) (1 (0.1 0 0))); }
    frontAndBack { type empty; }
}
"""


def test_points_of_a_moving_patch_outside_it_stay(zone_case):
    """The walls are a patch of the zone and of the other cells."""
    case = zone_case()
    single(case, others="oldInternalFaces free;")
    motion = case.folder / "constant/dynamicMeshDict"
    motion.write_text(motion.read_text().replace("inlet fixed; walls slip", '"(inlet|walls)" moving'))
    (case.folder / "0/pointDisplacement").write_text(_ALL_MOVE)
    case.run("moveDynamicMesh")
    start, end = case.points("constant"), case.points("0.1")
    beyond = start[:, 0] > 1.3
    np.testing.assert_array_equal(end[beyond], start[beyond])
    within = start[:, 0] < 1.2
    moved = np.broadcast_to([0.01, 0.0, 0.0], (within.sum(), 3))
    np.testing.assert_allclose(end[within] - start[within], moved, rtol=0, atol=1e-12)


@pytest.mark.parametrize(("ranks", "end"), [(2, 1.25), (3, 1.05)], ids=["both ranks", "two ranks of three"])
def test_ranks_move_it_as_one_does(zone_case, ranks, end):
    serial, parallel = zone_case(end=end), zone_case("parallel", end)
    serial.run("moveDynamicMesh")
    divide(parallel, ranks)
    parallel.run("moveDynamicMesh", ranks=ranks)
    parallel.check_ranks("0.1", serial.points("0.1"), ranks)


def test_a_restart_goes_on_as_if_it_had_not_been(zone_case):
    whole, parts = zone_case("whole", 1.05), zone_case("parts", 1.05, steps=1)
    whole.run("moveDynamicMesh")
    divide(parts, 3)
    parts.run("moveDynamicMesh", ranks=3)
    assert (parts.folder / "processor0/0.05/uniform/remoteMeshMotion.near/credentials").exists()
    parts.set("system/controlDict", endTime="0.1")
    assert "goes on after step 1" in parts.run("moveDynamicMesh", ranks=3)
    parts.check_ranks("0.1", whole.points("0.1"), 3)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda case: single(case, "far"), ["find cellZone far", "near"]),
        (lambda case: single(case, "near; cellSet near"), ["moves a cellZone, not a cellSet", "setToCellZone"]),
        (lambda case: several(case, others=""), ["patch oldInternalFaces has no role"]),
        (
            lambda case: several(case, others="oldInternalFaces moving;"),
            ["between the cellZone and other cells", "use fixed or free"],
        ),
    ],
    ids=["an unknown zone", "a set", "faces without a role", "faces that move"],
)
def test_a_missing_entry_is_named(zone_case, change, words):
    case = zone_case()
    change(case)
    case.run("moveDynamicMesh", expect=1)
    for word in words:
        assert word in case.output
