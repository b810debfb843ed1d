"""Common properties of all volume reductions."""

import numpy as np
import pytest
from mesh_motion_protocol.errors import InvalidInput
from volume_problems import problem_of

from docs.studies.thesis._volume_reduction import VOLUME_REDUCTIONS, VolumeProblem

NAMES = sorted(VOLUME_REDUCTIONS)


def test_a_wrong_length_is_refused() -> None:
    for length in (0.0, -1.0, np.nan):
        with pytest.raises(InvalidInput, match="length > 0"):
            problem_of(length=length)


def test_a_problem_without_moving_nodes_or_of_mixed_shapes_is_refused() -> None:
    whole = problem_of()
    parts = {name: getattr(whole, name) for name in whole.__dataclass_fields__}
    with pytest.raises(InvalidInput, match="needs a moving node"):
        VolumeProblem(**parts | {"moving": np.zeros_like(whole.moving)})
    with pytest.raises(InvalidInput, match="expected displacements of shape"):
        VolumeProblem(**parts | {"displacement": whole.displacement[1:]})


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("d", [1, 2, 3])
def test_the_moving_boundary_is_exact(name: str, d: int) -> None:
    problem = problem_of(d)
    found = VOLUME_REDUCTIONS[name](problem)(problem.boundary)
    np.testing.assert_allclose(found.displacement[problem.moving], 0.05, rtol=1e-10)
    np.testing.assert_allclose(found.displacement[~problem.moving], 0.0, atol=1e-10)


@pytest.mark.parametrize("name", NAMES)
def test_a_place_s_displacement_does_not_depend_on_the_others(name: str) -> None:
    problem = problem_of(length=0.25)
    field = VOLUME_REDUCTIONS[name](problem)
    whole = field(problem.nodes).displacement
    halves = [field(part).displacement for part in np.array_split(problem.nodes, 2)]
    assert np.array_equal(np.vstack(halves), whole)


@pytest.mark.parametrize("name", NAMES)
def test_it_says_how_many_sums_it_took(name: str) -> None:
    problem = problem_of(length=0.25)
    found = VOLUME_REDUCTIONS[name](problem)(problem.nodes)
    assert 0 < np.count_nonzero(found.evaluated) <= found.places
    assert found.control_points >= np.count_nonzero(problem.moving)
    if name != "background-grid":
        assert found.places == np.count_nonzero(found.evaluated) < len(problem.nodes)
        assert not found.displacement[~found.evaluated].any()
