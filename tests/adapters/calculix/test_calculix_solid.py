"""CalculiX as a participant: the mechanics of a flap, repeatable windows, restarts, and clear errors.

The last test runs what adapters/calculix/README.md shows.
"""

import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from mesh_motion_calculix import DeckError, DivergedError, Options, RunError, Solid, flap_deck
from mesh_motion_calculix.window import JOB, read_motion, window_deck

ADAPTER = Path(__file__).resolve().parents[3] / "adapters" / "calculix"
pytestmark = pytest.mark.skipif(shutil.which("ccx") is None, reason="CalculiX is not installed (Debian: calculix-ccx)")

HEIGHT, WIDTH, YOUNG, POISSON, DENSITY = 1.0, 0.1, 4e6, 0.3, 3000.0
STIFFNESS = YOUNG / (1.0 - POISSON**2) * WIDTH**3 / 12.0  # of a plate strip in bending, per unit of thickness
FIRST_MODE = 1.8751040687  # (k L) of a clamped beam: cos cosh = -1
PERIOD = 2.0 * np.pi / (FIRST_MODE**2 * np.sqrt(STIFFNESS / (DENSITY * WIDTH))) * HEIGHT**2


@pytest.fixture
def flap(tmp_path):
    """Makes participants for a flap; closes them."""
    made = []

    def make(elements=(1, 4), folder="run", text=None, **options):
        deck = tmp_path / "flap.inp"
        deck.write_text(flap_deck(elements) if text is None else text)
        dimensions = options.pop("dimensions", 2)
        made.append(Solid(deck, "INTERFACE", tmp_path / folder, dimensions=dimensions, options=Options(**options)))
        return made[-1]

    yield make
    for solid in made:
        solid.close()


def tip_load(solid, force):
    """A shear force on the tip, distributed like a constant traction."""
    x = solid.points[:, 0]
    tip = np.flatnonzero(solid.points[:, 1] > HEIGHT - 1e-9)
    order = tip[np.argsort(x[tip])]
    lengths = np.diff(x[order])
    shares = np.zeros(len(order))
    shares[:-1] += lengths / 2.0
    shares[1:] += lengths / 2.0
    forces = np.zeros_like(solid.points)
    forces[order, 0] = force * shares / WIDTH
    return forces


def tip(solid, values):
    return values[solid.points[:, 1] > HEIGHT - 1e-9].mean(axis=0)


def play(solid, loads, dt):
    """Run windows with these tip loads; return the displacements of each."""
    history = []
    for load in loads:
        history.append(solid.solve(tip_load(solid, load), dt))
        solid.advance()
    return np.array(history)


def test_flap_under_tip_load_swings_as_the_beam_does(flap):
    """After a sudden load the tip swings about the static deflection F L³ / 3 E' I, with the first mode's period."""
    solid = flap((2, 16))
    force, dt, count = 0.1, PERIOD / 30.0, 45
    deflection = [tip(solid, window)[0] for window in play(solid, [force] * count, dt)]
    times = dt * np.arange(1, count + 1)

    def fit(period):
        basis = np.stack([np.ones(count), np.cos(2 * np.pi * times / period), np.sin(2 * np.pi * times / period)], 1)
        weights, residual, *_ = np.linalg.lstsq(basis, np.array(deflection), rcond=None)
        return residual[0], period, weights

    _, period, weights = min((fit(value) for value in np.linspace(0.9 * PERIOD, 1.1 * PERIOD, 401)), key=lambda f: f[0])
    static = force * HEIGHT**3 / (3.0 * STIFFNESS)
    # a beam of ten widths: shear and rotary inertia lengthen the period by 0.5 %, the trapezoidal rule by (ω dt)²/24 of
    # itself at most times two, the elements shorten the deflection by less than one per cent
    assert weights[0] == pytest.approx(static, rel=0.01)
    assert period == pytest.approx(PERIOD, rel=0.015)
    assert period > PERIOD
    # the first mode alone carries 97 % of the deflection of a tip load
    assert np.hypot(*weights[1:]) == pytest.approx(0.97 * static, rel=0.03)


def test_windows_are_of_second_order(flap):
    """Halving the window quarters the error: the load between two windows is not a step."""
    ends = []
    for windows in (8, 16, 32):
        solid = flap(folder=f"run-{windows}")
        times = np.arange(1, windows + 1) / windows
        ends.append(tip(solid, play(solid, 20.0 * np.sin(np.pi * times) ** 2, PERIOD / windows)[-1])[0])
    order = np.log2((ends[0] - ends[1]) / (ends[1] - ends[2]))
    assert order == pytest.approx(2.0, abs=0.35)


def test_unclamped_flap_falls_as_a_rigid_body(flap):
    """Gravity through step_cards: every node falls alike, as the trapezoidal rule says."""
    text = flap_deck((1, 4)).replace("FOOT, 1, 2\n", "").replace("C3D8I", "C3D8")
    gravity, dt, windows = 9.81, 0.05, 4
    solid = flap(text=text, step_cards=("*DLOAD", f"EALL, GRAV, {gravity}, 0., -1., 0."))
    fallen = play(solid, [0.0] * windows, dt)
    rest = dt * (windows - 1)
    expected = -gravity * (dt**2 / 4.0 + dt / 2.0 * rest + rest**2 / 2.0)  # the load grows through the first window
    np.testing.assert_allclose(fallen[-1][:, 1], expected, rtol=1e-5)
    np.testing.assert_allclose(fallen[-1][:, 0], 0.0, atol=1e-6)
    np.testing.assert_allclose(solid.velocities[:, 1], -gravity * (dt / 2.0 + rest), rtol=1e-5)


def test_repeated_window_is_the_same_in_every_byte(flap, tmp_path):
    solid = flap()
    play(solid, [50.0, 80.0], 0.05)
    kept = []
    for force in (60.0, -500.0, 60.0):
        solid.solve(tip_load(solid, force), 0.05)
        trial = next((tmp_path / "run").glob("trial-*"))
        kept.append([(trial / f"{JOB}.{kind}").read_bytes() for kind in ("dat", "rout")])
    assert kept[0] == kept[2]
    assert kept[0][0] != kept[1][0]


def test_windows_from_restarts_equal_one_uninterrupted_run(flap, tmp_path):
    """Equal in every digit that ccx prints, at large deflections."""
    text = flap_deck((1, 4))
    solid = flap(text=text)
    loads, dt = [200.0, 900.0, 1500.0, 400.0], 0.1
    history = play(solid, loads, dt)
    nodes = solid._columns  # what a force on the interface is on CalculiX' nodes
    steps = []
    for number, load in enumerate(loads):
        model = tuple(text.splitlines()) if number == 0 else ()
        steps.append(window_deck(model, "INTERFACE", solid._loads(tip_load(solid, load)), dt, Options()))
    whole = tmp_path / "whole"
    whole.mkdir()
    (whole / "window.inp").write_text("".join(steps))
    subprocess.run(["ccx", JOB], cwd=whole, env=os.environ | {"OMP_NUM_THREADS": "1"}, check=True, timeout=60,
                   stdout=subprocess.DEVNULL)  # fmt: skip
    motion = read_motion(whole / "window.dat", nodes.ravel())
    expected = motion.displacements.reshape(*nodes.shape, 3).mean(axis=1)[:, :2]
    np.testing.assert_array_equal(history[-1], expected)
    assert abs(tip(solid, history[-1])[0]) > 0.2


def test_far_bent_flap_keeps_its_length(flap):
    """Geometric nonlinearity: linear theory would stretch it by about 0.6 u² / L, here 5 %."""
    solid = flap((1, 8))
    bent = solid.points + play(solid, [1500.0] * 4, 0.1)[-1]
    sides = [bent[np.isclose(solid.points[:, 0], x)] for x in (-WIDTH / 2, WIDTH / 2)]  # ascending in y
    middle = (sides[0] + sides[1]) / 2.0
    assert abs(middle[-1, 0]) > 0.28
    assert np.linalg.norm(np.diff(middle, axis=0), axis=1).sum() == pytest.approx(HEIGHT, rel=0.005)


def test_tolerance_is_that_of_the_window(flap):
    """The default tolerance leaves no noise that a coupling would see; a looser one would."""
    ends = {}
    for tolerance in (0.5, Options().tolerance, 1e-10):
        solid = flap(folder=f"run-{tolerance}", tolerance=tolerance)
        ends[tolerance] = tip(solid, play(solid, [900.0, 1500.0, 600.0], 0.1)[-1])
    exact = ends.pop(1e-10)
    np.testing.assert_allclose(ends.pop(Options().tolerance), exact, rtol=1e-6)
    assert np.abs(ends.pop(0.5) - exact).max() > 1e-5 * np.abs(exact).max()


def test_three_dimensions_give_every_node_its_own_force(flap):
    plane, space = flap(), flap(folder="space", dimensions=3)
    assert len(space.nodes) == 2 * len(plane.nodes)
    forces = tip_load(space, 50.0) * 0.0
    top = space.points[:, 1] > HEIGHT - 1e-9
    forces[top, 0] = 50.0 / top.sum()
    u, v = space.solve(forces, 0.1), plane.solve(tip_load(plane, 50.0), 0.1)
    np.testing.assert_allclose(tip(space, u)[:2], tip(plane, v), rtol=1e-6)
    np.testing.assert_array_equal(u[:, 2], 0.0)


def test_nodes_count_from_zero_and_points_are_theirs(flap):
    solid = flap((1, 2))
    assert solid.nodes.tolist() == [0, 1, 2, 3, 4, 5]
    np.testing.assert_allclose(solid.points[3], [0.05, 0.5])


KILLED = """
import os, signal, sys
import numpy as np
from mesh_motion_calculix import Solid
solid = Solid(sys.argv[1], "INTERFACE", sys.argv[2], dimensions=2)
forces = np.full_like(solid.points, 3.0)
for _ in range(3):
    solid.solve(forces, 0.05)
    solid.advance()
solid.solve(forces * 7.0, 0.05)
os.kill(os.getpid(), signal.SIGKILL)
"""


def test_killed_run_goes_on_at_its_last_accepted_window(flap, tmp_path):
    whole = flap(folder="whole")
    forces = np.full_like(whole.points, 3.0)
    for _ in range(4):
        expected = whole.solve(forces, 0.05)
        whole.advance()
    command = [sys.executable, "-c", KILLED, str(tmp_path / "flap.inp"), str(tmp_path / "run")]
    died = subprocess.run(command, env=os.environ | {"PYTHONPATH": str(ADAPTER)}, check=False, timeout=120)
    assert died.returncode == -signal.SIGKILL
    solid = flap()
    assert (solid.windows, solid.time) == (3, pytest.approx(0.15))
    assert not list((tmp_path / "run").glob("trial-*"))
    np.testing.assert_array_equal(solid.solve(forces, 0.05), expected)
    solid.advance()
    np.testing.assert_array_equal(solid.velocities, whole.velocities)
    assert sorted(path.name for path in (tmp_path / "run").iterdir()) == [
        "accepted-4.dat", "accepted-4.rin", "accepted.json", "lock",
    ]  # fmt: skip


def test_kill_between_the_files_and_the_record_keeps_the_window_before(flap, tmp_path, monkeypatch):
    solid = flap()
    play(solid, [3.0], 0.05)
    first = solid.displacements
    solid.solve(tip_load(solid, 9.0), 0.05)
    monkeypatch.setattr(solid, "_write_state", lambda state: (_ for _ in ()).throw(OSError("killed here")))
    with pytest.raises(RunError, match="window 2 cannot be kept: killed here"):
        solid.advance()
    solid.close()
    assert (tmp_path / "run" / "accepted-2.rin").exists()
    again = flap()
    assert again.windows == 1
    assert not (tmp_path / "run" / "accepted-2.rin").exists()
    np.testing.assert_array_equal(again.displacements, first)
    play(again, [9.0], 0.05)
    assert again.windows == 2


def test_diverging_load_leaves_the_accepted_state(flap):
    solid = flap()
    play(solid, [50.0], 0.05)
    expected = solid.solve(tip_load(solid, 60.0), 0.05)
    with pytest.raises(DivergedError, match=r"ERROR: solution seems to diverge.*a smaller load"):
        solid.solve(tip_load(solid, 1e15), 0.05)
    with pytest.raises(RunError, match="no window to accept"):
        solid.advance()
    np.testing.assert_array_equal(solid.solve(tip_load(solid, 60.0), 0.05), expected)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("*DENSITY\n3000.0\n", "", "ERROR in calinput: no density"),
        ("MATERIAL=FLAP\n", "MATERIAL=OTHER\n", "nonexistent material"),
        ("*ELASTIC\n", "*ELESTIC\n", "does not know the card .ELESTIC"),
        ("4000000.0", "4x0", "ERROR reading .ELASTIC. Card image: 4X0"),
        ("C3D8I", "C3D9", "C3D9 .*unknown element type"),
    ],
)
def test_decks_that_ccx_refuses(flap, old, new, message):
    text = flap_deck((1, 4))
    assert text.count(old)
    solid = flap(text=text.replace(old, new))
    with pytest.raises(DeckError, match=message):
        solid.solve(np.zeros_like(solid.points), 0.1)


def test_programs_that_cannot_be_run(flap):
    solid = flap(executable="no-such-ccx")
    forces = np.zeros_like(solid.points)
    with pytest.raises(RunError, match=r"no-such-ccx was not found .Debian: apt-get install calculix-ccx"):
        solid.solve(forces, 0.1)
    solid.options = Options(executable="/bin/true")
    with pytest.raises(RunError, match="ended with status 0 before its job was finished"):
        solid.solve(forces, 0.1)
    solid.options = Options(timeout=1e-4)
    with pytest.raises(RunError, match=r"did not end within 0.0001 s and was stopped"):
        solid.solve(forces, 0.1)


def test_arguments_are_checked(flap, tmp_path):
    solid = flap()
    with pytest.raises(DeckError, match=r"forces must have shape \(10, 2\), not \(9, 2\)"):
        solid.solve(np.zeros((9, 2)), 0.1)
    with pytest.raises(DeckError, match="the force of row 4 is not finite"):
        solid.solve(np.where(np.arange(10)[:, None] == 4, np.nan, np.zeros((10, 2))), 0.1)
    with pytest.raises(DeckError, match="length must be positive"):
        solid.solve(np.zeros((10, 2)), 0.0)
    with pytest.raises(DeckError, match="no node set WET"):
        Solid(tmp_path / "flap.inp", "wet", tmp_path / "other")
    with pytest.raises(DeckError, match=r"no strip's: there are not two nodes at the .* of node 10"):
        flap(folder="other", text=flap_deck((1, 4)).replace("\n20, 0.05,", "\n20, 0.06,"))


def test_folder_is_one_runs(flap, tmp_path):
    solid = flap()
    with pytest.raises(RunError, match="is used by another run"):
        flap()
    play(solid, [1.0], 0.1)
    solid.close()
    with pytest.raises(RunError, match="was begun with another deck"):
        flap((1, 5))
    path = tmp_path / "run" / "accepted-1.rin"
    path.write_bytes(path.read_bytes()[:-1] + b"x")
    with pytest.raises(RunError, match=r"files of window 1 .* were changed"):
        flap()


def test_start_of_the_readme_runs(tmp_path, monkeypatch, capsys):
    text = (ADAPTER / "README.md").read_text()
    monkeypatch.chdir(tmp_path)
    for _ in range(2):  # the second time all windows are accepted
        exec(text.split("```python\n")[1].split("```")[0], {})
        assert capsys.readouterr().out.startswith("t = 0.10 s, tip at x = 0.0004")
