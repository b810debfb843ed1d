"""The motion as a function: the right trial for each argument, and PyTorch's own check of its derivatives."""

import importlib
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from client_square import square
from mesh_motion_client import InvalidInput, QualityRefused, connect
from mesh_motion_client.motion_function import MotionFunction
from page_story import ROOT, blocks_of

SIDE = 7


def bulge(size):
    y = np.linspace(0.0, 1.0, SIDE)
    return np.stack([size * np.sin(np.pi * y), 0.2 * size * np.sin(2.0 * np.pi * y)], axis=1)


@pytest.fixture(scope="module")
def session():
    with connect() as server, server.open(square(SIDE)) as opened:
        yield opened


@pytest.fixture
def torch():
    return pytest.importorskip("torch", reason="PyTorch is not installed")


@pytest.fixture
def torch_motion(torch, session):
    return importlib.import_module("mesh_motion_client.torch").Motion(session)


def test_a_derivative_belongs_to_its_argument(session):
    motion, w = MotionFunction(session), np.random.default_rng(1).standard_normal((SIDE * SIDE, 2))
    small, large = bulge(0.1), bulge(0.5)
    at_small = motion.cotangent(small, w)
    at_large = motion.cotangent(large, w)
    assert np.abs(at_large - at_small).max() > 1e-2
    assert motion.cotangent(small, w).tobytes() == at_small.tobytes()
    session.move(bulge(0.3))  # by someone else
    assert motion.cotangent(small, w).tobytes() == at_small.tobytes()
    session.rollback()
    assert motion.tangent(small, small).tobytes() == session.move(small).tangent(small).tobytes()


def test_the_same_argument_is_moved_once(session):
    motion = MotionFunction(session)
    motion.value(bulge(0.2))
    iteration = session.iteration
    motion.value(bulge(0.2))
    motion.tangent(bulge(0.2), bulge(1.0))
    assert session.iteration == iteration


def test_an_argument_that_is_changed_in_place_is_another(session):
    motion, argument = MotionFunction(session), bulge(0.2)
    before = motion.value(argument)
    argument[:] = bulge(0.3)
    assert (motion.value(argument) != before).any()


def test_a_refused_argument_leaves_no_trial_behind(session):
    motion = MotionFunction(session)
    before = motion.value(bulge(0.2))
    with pytest.raises(QualityRefused):
        motion.value(bulge(2.0))
    assert motion.value(bulge(0.2)).tobytes() == before.tobytes()


def test_a_method_without_derivatives_is_refused():
    with (
        connect() as server,
        server.open(square(SIDE), {"correction": "optimised"}) as opened,
        pytest.raises(InvalidInput, match="has no derivatives"),
    ):
        MotionFunction(opened)


@pytest.mark.filterwarnings("ignore:`torch.jit.script`:DeprecationWarning")
@pytest.mark.parametrize("size", [0.1, 0.5], ids=["as interpolated", "corrected"])
def test_pytorch_finds_the_derivatives_right(torch, torch_motion, session, size):
    at = torch.tensor(bulge(size), requires_grad=True)
    corrected = session.move(bulge(size)).correction["method"] == "smooth"
    assert corrected == (size == 0.5)
    assert torch.autograd.gradcheck(
        torch_motion,
        at,
        eps=1e-5,
        atol=1e-5,
        rtol=1e-5,
        check_forward_ad=True,
        check_undefined_grad=False,
        check_batched_grad=False,
    )


def test_pytorch_goes_back_through_two_motions(torch, torch_motion):
    motion, points = torch_motion, torch.tensor(square(SIDE).points)
    size = torch.tensor(0.1, dtype=torch.float64, requires_grad=True)
    shape = torch.tensor(bulge(1.0))

    def objective(size):
        return ((points + motion(size * shape)) ** 2).sum() * (motion(2.0 * size * shape)[:, 0]).sum()

    (gradient,) = torch.autograd.grad(objective(size), size)
    h = 1e-5
    difference = (objective(size + h) - objective(size - h)) / (2.0 * h)
    assert gradient.item() == pytest.approx(difference.item(), rel=1e-7)


def test_pytorch_hands_on_what_the_server_says(torch, torch_motion):
    motion = torch_motion
    with pytest.raises(InvalidInput, match=r"expected torch.float64, got torch.float32"):
        motion(torch.zeros(SIDE, 2))
    with pytest.raises(QualityRefused, match="no valid mesh"):
        motion(torch.tensor(bulge(2.0)))


def test_pytorch_takes_an_array_of_numpy(torch, torch_motion):
    assert torch.equal(torch_motion(bulge(0.1)), torch_motion(torch.tensor(bulge(0.1))))


def test_pytorch_refuses_second_derivatives(torch, torch_motion):
    """Also if the objective has a part that has them: it would be taken for the whole."""
    at = torch.tensor(bulge(0.1), requires_grad=True)

    def objective(x):
        return torch_motion(x).square().sum() + x.square().sum()

    (gradient,) = torch.autograd.grad(objective(at), at, create_graph=True)
    for second in (
        lambda: gradient.sum().backward(),
        lambda: torch.autograd.functional.hessian(objective, at),
        lambda: torch.func.hessian(objective)(at),
        lambda: torch.func.jacrev(torch.func.jacrev(objective))(at),
    ):
        with pytest.raises(InvalidInput, match="no second derivative"):
            second()


def test_pytorch_transforms_it(torch, torch_motion, session, monkeypatch):
    """Forwards and backwards all columns are one request; many displacements are one motion after the other."""
    motion, at = torch_motion, torch.tensor(bulge(0.5))
    asked = []

    def noting(call):
        def noted(rows, *more, **further):
            asked.append(rows.shape)
            return call(rows, *more, **further)

        return noted

    monkeypatch.setattr(session, "tangent", noting(session.tangent))
    monkeypatch.setattr(session, "cotangent", noting(session.cotangent))
    forwards, backwards = torch.func.jacfwd(motion)(at), torch.func.jacrev(motion)(at)
    nodes, moving = forwards.shape[0], len(at)
    assert asked == [(2 * moving, moving, 2), (2 * nodes, nodes, 2)]
    torch.testing.assert_close(forwards, backwards, rtol=0.0, atol=1e-11)
    v = torch.cos(9.0 * at) + 1.0
    np.testing.assert_allclose(torch.func.jvp(motion, (at,), (v,))[1], session.tangent(v.numpy()), rtol=0, atol=1e-13)
    many = torch.stack([at, 0.5 * at])
    torch.testing.assert_close(torch.func.vmap(motion)(many), torch.stack([motion(at), motion(0.5 * at)]))
    gradient = torch.func.grad(lambda x: motion(x).square().sum())
    torch.testing.assert_close(torch.func.vmap(gradient)(many), torch.stack([gradient(at), gradient(0.5 * at)]))


def test_the_page_is_as_it_says(torch, capsys):
    page = (ROOT / "docs/derivatives.md").read_text(encoding="utf-8")
    exec("\n".join(block.text for block in blocks_of(page) if block.language == "python"), {})
    assert capsys.readouterr().out == "(441, 2) (21, 2)\nTrue\ntensor(True)\n"


@pytest.mark.nightly
def test_jax_finds_the_derivatives_right():
    """In a separate process, because of its threads and its switch to double precision."""
    pytest.importorskip("jax", reason="JAX is not installed")
    checks = Path(__file__).with_name("run_jax.py")
    here = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    done = subprocess.run([sys.executable, checks], capture_output=True, text=True, check=False, env=here)
    assert (done.returncode, done.stdout.split()) == (0, ["checked:", "6"]), done.stdout + done.stderr


@pytest.mark.parametrize("name", ["torch", "jax"])
def test_where_the_package_is_missing_the_way_to_it_is_named(monkeypatch, name):
    monkeypatch.setitem(sys.modules, name, None)
    monkeypatch.delitem(sys.modules, f"mesh_motion_client.{name}", raising=False)
    with pytest.raises(ImportError, match=rf"needs {name}, .* \(pip install 'mesh-motion-client\[{name}\]'\)"):
        importlib.import_module(f"mesh_motion_client.{name}")
