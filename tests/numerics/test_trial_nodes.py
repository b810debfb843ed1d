"""Freed trial nodes: every cell type, the growing region, refusal, repeatability."""

import mesh_motion_kernels as kernels
import numpy as np
import pytest
from box_meshes import CELL_KINDS, box_mesh
from correction_cases import case, moved, rigid, stored
from mesh_motion_numerics.correction.free_region import nodes_of_cells
from mesh_motion_numerics.correction.trial_nodes import LAST_LEVEL, LEVELS, SIZE_WEIGHTS, TrialMesh, polish, reach
from mesh_motion_numerics.mesh.cells import CellTable
from mesh_motion_numerics.quality.metrics import QUALITY_METRICS, reference_sizes

# smallest size-skew that all nodes freed reached when this was written, less a twentieth
BOX_CASES = {
    "quad": (0.68, 0.63, 0.77),
    "hexahedron": (0.75, 0.7, 0.81),
    "wedge": (0.61, 0.51, 0.62),
    "pyramid": (0.48, 0.42, 0.55),
    "tetra": (0.31, 0.33, 0.36),
    "quad + triangle": (0.59, 0.44, 0.65),
    "hexahedron + wedge": (0.65, 0.55, 0.65),
}

METRIC_TARGETS = {"size": 0.3, "skew": 0.6, "size-skew": 0.32, "size-skew-root": 0.42, "size-skew-product": 0.18}


def motion(kind: str, number: int):
    """Translation and rotation, translation, rotation of the body of a box mesh."""
    mesh = box_mesh(kind, 20 if kind.startswith("quad") else 10)
    shift = [0.2, 0.25, 0.0][number]
    return mesh, moved(mesh, rigid(mesh, (shift, *[0.0] * (mesh.points.shape[1] - 1)), [45.0, 0.0, 90.0][number]))


@pytest.mark.parametrize("kind", CELL_KINDS)
@pytest.mark.parametrize("number", range(3))
def test_every_cell_type_is_valid_and_near_its_ceiling(kind: str, number: int) -> None:
    mesh, problem = motion(kind, number)
    trial = mesh.trial
    found = polish(problem.standard, trial, trial.free(~mesh.held))
    assert trial.quality(problem.standard).min() < 0.21
    assert found.minimum == trial.quality(found.points).min()
    assert found.minimum >= BOX_CASES[kind][number]
    assert np.array_equal(found.points[mesh.held], problem.standard[mesh.held])


@pytest.mark.parametrize(("metric", "target"), METRIC_TARGETS.items())
def test_any_metric_may_judge(metric: str, target: float) -> None:
    problem = case("dx -0.3")
    trial = TrialMesh(problem.start, problem.cells, problem.reference_sizes, problem.held, metric)
    assert trial.quality(problem.standard).min() < 0
    assert reach(problem.standard, trial, target).minimum >= target


def test_every_metric_has_its_size_weight() -> None:
    assert SIZE_WEIGHTS.keys() == set(QUALITY_METRICS)


def test_a_threshold_frees_the_bad_cells_only() -> None:
    problem = case("3D box 0.25 + bend")
    trial = stored("correction_box").trial
    mild = problem.start + 0.8 * (problem.standard - problem.start)
    bad = nodes_of_cells(trial.cells, trial.quality(mild) < 0.2, len(mild)) & ~trial.held
    found = reach(mild, trial, 0.2)
    assert found.minimum >= 0.2
    assert found.freed == np.count_nonzero(bad) < 0.3 * np.count_nonzero(~trial.held)
    assert np.array_equal(found.points[~bad], mild[~bad])


def test_a_region_without_room_grows() -> None:
    problem = case("-0.2, -0.2, +60°")
    trial = stored("correction_slab").trial
    found = reach(problem.standard, trial, 0.2)
    sizes = [stage.free for stage in found.history]
    assert found.minimum >= 0.2
    assert sizes == sorted(sizes)
    assert len(set(sizes)) > 1
    assert found.freed < np.count_nonzero(~trial.held)


@pytest.mark.parametrize("degrees", [165.0, 180.0, 195.0])
@pytest.mark.parametrize("name", ["thesis_block", "correction_slab"])
def test_half_turns_are_untangled(name: str, degrees: float) -> None:
    """Systems of 1300 unknowns: rough steps with conjugate gradients do not always untangle them."""
    mesh = stored(name)
    problem = moved(mesh, rigid(mesh, (-0.1, 0.05), degrees))
    assert polish(problem.standard, mesh.trial, mesh.trial.free(~mesh.held), target=0.05).minimum >= 0.05


def test_the_last_level_is_for_the_maximum_of_regions_that_are_not_dear(monkeypatch: pytest.MonkeyPatch) -> None:
    problem, trial = case("-0.2, -0.2, +60°"), stored("correction_slab").trial
    region = trial.free(~trial.held)
    exacting = polish(problem.standard, trial, region)
    threshold = polish(problem.standard, trial, region, target=0.9)
    monkeypatch.setitem(polish.__globals__, "_EXACTING_UNKNOWNS", 1000)
    plain = polish(problem.standard, trial, region)
    last = [found.history[-1].norm.p for found in (exacting, threshold, plain)]
    assert last == [LAST_LEVEL.p, LEVELS[-1].p, LEVELS[-1].p]
    assert exacting.minimum > 1.002 * plain.minimum
    assert np.array_equal(threshold.points, plain.points)


@pytest.mark.parametrize("dx", [-0.46, -0.6, -1.0])
def test_an_impossible_motion_is_given_up_early(dx: float) -> None:
    mesh = stored("thesis_block")
    problem = moved(mesh, rigid(mesh, (dx, 0.0)))
    found = polish(problem.standard, mesh.trial, mesh.trial.free(~mesh.held))
    assert found.minimum < 0
    assert found.iterations <= 44  # of 100


@pytest.mark.parametrize("name", ["-0.2, -0.2, +60°", "3D box + 60° + bend"])
def test_repeatable_to_the_bit_for_any_number_of_threads(name: str) -> None:
    problem = case(name)
    trial = TrialMesh(problem.start, problem.cells, problem.reference_sizes, problem.held)
    before, found = kernels.get_threads(), []
    for threads in (1, before, before):
        kernels.set_threads(threads)
        found.append(polish(problem.standard, trial, trial.free(~trial.held)).points.tobytes())
        found.append(reach(problem.standard, trial, 0.15).points.tobytes())
    kernels.set_threads(before)
    assert len(set(found[::2])) == len(set(found[1::2])) == 1


def test_a_mesh_of_two_separate_parts_ends() -> None:
    """The bad part cannot grow into the other one, and is smaller than the share at which all nodes are freed."""
    mesh = box_mesh("quad", 10)
    shifted = mesh.points + np.array([2.0, 0.0])

    points = np.vstack([mesh.points, shifted])
    nodes = mesh.cells.blocks[0].nodes
    cells = CellTable.from_arrays({"quad": np.vstack([nodes, nodes + len(mesh.points)])})
    trial = TrialMesh(points, cells, reference_sizes(points, cells), np.tile(mesh.held, 2))
    problem = moved(mesh, rigid(mesh, (0.25, 0.0)))
    found = reach(np.vstack([problem.standard, shifted]), trial, 0.9)
    assert 0.4 < found.minimum < 0.9
