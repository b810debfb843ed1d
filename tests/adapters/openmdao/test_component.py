"""The component: OpenMDAO's own check of its derivatives, and an optimiser that finds a known surface again."""

from pathlib import Path

import numpy as np
import pytest
from client_square import SIDE, square
from page_story import blocks_of, play

om = pytest.importorskip("openmdao.api", reason="OpenMDAO is not installed")

from mesh_motion_client import connect  # noqa: E402
from mesh_motion_openmdao.component import MeshMotion  # noqa: E402


@pytest.fixture(autouse=True)
def _writes_elsewhere(tmp_path, monkeypatch):
    """OpenMDAO writes a folder into its working folder."""
    monkeypatch.chdir(tmp_path)


@pytest.fixture
def session():
    with connect() as server, server.open(square()) as opened:
        yield opened


def problem(session, *others):
    built = om.Problem(reports=None)
    built.model.add_subsystem("mesh", MeshMotion(session=session), promotes=["*"])
    for name, other in others:
        built.model.add_subsystem(name, other, promotes=["*"])
    return built


def bulged(size):
    points = square().points[:SIDE].copy()
    points[:, 0] += size * np.sin(np.pi * points[:, 1])
    return points.ravel()


def test_openmdao_finds_the_derivatives_right(session):
    built = problem(session)
    built.setup(force_alloc_complex=False)
    built.set_val("x_aero", bulged(0.25))
    built.run_model()
    (found,) = built.check_partials(method="fd", form="central", step=1e-5, out_stream=None).values()
    ((of, wrt),) = found
    assert (of, wrt) == ("aero_vol_coords", "x_aero")
    jacobians = found[of, wrt]
    forward, reverse, difference = (jacobians[name] for name in ("J_fwd", "J_rev", "J_fd"))
    np.testing.assert_allclose(forward, reverse, atol=1e-12)
    np.testing.assert_allclose(forward, difference, atol=1e-4)


def test_a_surface_is_found_again_from_the_mesh_that_it_makes(session):
    goal = square().points + session.move((bulged(0.2) - bulged(0.0)).reshape(-1, 2)).displacement
    rest, change = bulged(0.0), bulged(1.0) - bulged(0.0)
    sides = {"x_aero": {"shape": 2 * SIDE}, "rest": rest, "change": change}
    shape = om.ExecComp("x_aero = rest + size * change", size={"val": 0.0}, **sides)
    far = om.ExecComp("far = sum((aero_vol_coords - goal)**2)", aero_vol_coords={"shape": goal.size}, goal=goal.ravel())
    built = om.Problem(reports=None)
    built.model.add_subsystem("shape", shape, promotes=["*"])
    built.model.add_subsystem("mesh", MeshMotion(session=session), promotes=["*"])
    built.model.add_subsystem("objective", far, promotes=["*"])
    built.model.add_design_var("size", lower=-0.5, upper=0.5)
    built.model.add_objective("far")
    built.driver = om.ScipyOptimizeDriver(optimizer="SLSQP", tol=1e-12, disp=False)
    built.setup()
    built.run_driver()
    assert built.get_val("size")[0] == pytest.approx(0.2, abs=1e-6)


def test_a_surface_without_a_mesh_is_an_analysis_error(session):
    built = problem(session)
    built.setup()
    built.set_val("x_aero", bulged(1.5))
    with pytest.raises(om.AnalysisError, match="no valid mesh"):
        built.run_model()
    built.set_val("x_aero", bulged(0.1))
    built.run_model()


def test_a_method_without_derivatives_is_refused():
    with (
        connect() as server,
        server.open(square(), {"correction": "optimised"}) as opened,
        pytest.raises(ValueError, match="has no derivatives"),
    ):
        problem(opened).setup()


def test_the_page_is_as_it_says(tmp_path):
    page = Path(__file__).parents[3] / "adapters" / "openmdao" / "README.md"
    wrong = play(blocks_of(page.read_text(encoding="utf-8")), tmp_path)
    assert not wrong, "\n".join(wrong)
