"""The coupling's windows, iterations and records, with a fluid of added mass and a solid of springs."""

import csv

import numpy as np
import pytest
from mesh_motion_fsi import (
    ConstantRelaxation,
    Coupling,
    Mapping,
    NotConvergedError,
    QuasiNewton,
    RecordError,
    Request,
    Settings,
    SetupError,
)

DT, MASS, ADDED, SPRING, PUSH = 0.1, 1.0, 3.0, 2.0, 0.5
NODES = np.array([[0.0, 0.0], [0.0, 0.5], [0.0, 1.0]])


class Springs:
    """Masses on springs: implicit Euler in time; the accepted state survives in ``kept``."""

    def __init__(self, kept):
        self.points, self.kept = NODES, kept
        self.displacements, self.velocities, self.windows = kept.get("state", (np.zeros((3, 2)), np.zeros((3, 2)), 0))

    def solve(self, forces, dt):
        velocity = (MASS * self.velocities + dt * (forces - SPRING * self.displacements)) / (MASS + dt**2 * SPRING)
        self.trial = self.displacements + dt * velocity, velocity
        return self.trial[0].copy()

    def advance(self):
        self.displacements, self.velocities = self.trial
        self.windows += 1
        self.kept["state"] = (self.displacements, self.velocities, self.windows)


class AddedMass:
    """A fluid that resists the acceleration of its boundary; faces lie between the points."""

    def __init__(self, kept, correctors=99):
        y = np.linspace(0.0, 1.0, 5)
        self.points = np.stack([0 * y, y, 0 * y], axis=1)
        self.faces = (self.points[1:] + self.points[:-1]) / 2.0
        self.kept, self.correctors, self.refused = kept, correctors, ""

    def start(self, done, windows, dt):
        self.window, self.last, self.iteration, self.waits = done + 1, windows, 0, False
        # like OpenFOAM it continues after any window that it has written
        self.position, self.velocity = self.kept.setdefault("fluid", {0: (0 * self.points, 0 * self.points)})[done]
        self.x = self.position

    def next(self):
        assert not self.waits, "a fluid that waits for its answer sends nothing"
        self.waits = True
        self.iteration += 1
        if self.iteration > 1 and self.final:
            self.velocity, self.position = (self.x - self.position) / DT, self.x
            self.kept["fluid"][self.window] = (self.position, self.velocity)
            self.window, self.iteration = self.window + 1, 1
        if self.window > self.last or self.iteration > self.correctors:
            return None
        acceleration = ((self.x - self.position) / DT - self.velocity) / DT
        force = PUSH * np.array([1.0, 0.0, 0.0]) - ADDED / 4 * (acceleration[1:] + acceleration[:-1]) / 2.0
        return Request(self.window, self.iteration, self.window * DT, DT, force)

    def move(self, displacements, *, final=False):
        self.x, self.final, self.waits = displacements, final, False

    def refuse(self, why):
        self.refused = why


def make(folder, kept, *, acceleration=None, correctors=99, **settings):
    settings = Settings(windows=8, dt=DT, tolerance=1e-9, noise=0.0, **settings)
    return Coupling(AddedMass(kept, correctors), Springs(kept), acceleration or QuasiNewton(), settings, folder)


def test_fluid_and_solid_agree_in_every_window(tmp_path):
    coupling = make(tmp_path, {})
    rows = coupling.run()
    assert [row.window for row in rows] == list(range(1, 9))
    assert max(row.residual for row in rows) <= 1e-9
    # the same state on both sides of the interface
    at_nodes = coupling._fluid.position[[0, 2, 4], :2]
    np.testing.assert_allclose(at_nodes, coupling._solid.displacements, rtol=0, atol=1e-12)


def test_the_windows_are_those_of_the_monolithic_equations(tmp_path):
    """Mass, added mass, springs and both mappings in one linear system a window."""
    kept = {}
    coupling = make(tmp_path, kept, thickness=2.0)
    windows = len(coupling.run())
    fluid = coupling._fluid
    to_points = Mapping(NODES, fluid.points[:, :2]).matrix
    to_faces = Mapping(NODES, fluid.faces[:, :2]).matrix
    mean = (np.eye(5)[1:] + np.eye(5)[:-1]) / 2.0
    resist = 2.0 * to_faces.T @ mean * ADDED / 4.0 / DT**2  # force at the nodes by displacement of the points
    inertia = (MASS + DT**2 * SPRING) / DT**2 * np.eye(3)
    push = 2.0 * PUSH * to_faces.sum(axis=0)
    x = v = np.zeros(3)
    position = velocity = np.zeros(5)
    for _ in range(windows):
        right = inertia @ x + MASS * v / DT - SPRING * x + push + resist @ (position + DT * velocity)
        new = np.linalg.solve(inertia + resist @ to_points, right)
        x, v = new, (new - x) / DT
        position, velocity = to_points @ new, (to_points @ new - position) / DT
    np.testing.assert_allclose(kept["state"][0][:, 0], x, rtol=1e-6)


def test_a_run_that_is_taken_up_gives_the_same_rows(tmp_path):
    whole = make(tmp_path / "whole", {}).run()
    kept = {}

    def stop(row):
        if row.window == 3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        make(tmp_path / "cut", kept).run(stop)
    reported = []
    rows = make(tmp_path / "cut", kept).run(reported.append)
    assert [row.window for row in reported] == [4, 5, 6, 7, 8]
    assert [(row.x, row.y, row.iterations) for row in rows] == [(row.x, row.y, row.iterations) for row in whole]
    assert [path.name for path in (tmp_path / "cut").glob("coupling-*")] == ["coupling-8.npz"]
    assert make(tmp_path / "cut", kept).run() == rows  # nothing is left to do
    with (tmp_path / "cut" / "history.csv").open(newline="") as file:
        assert [int(row["window"]) for row in csv.DictReader(file)] == list(range(1, 9))


def test_a_row_that_a_kill_cut_off_is_written_again(tmp_path):
    kept = {}
    rows = make(tmp_path, kept).run()
    path = tmp_path / "history.csv"
    path.write_text(path.read_text() + "9,0.9,0.12")
    assert make(tmp_path, kept).run() == rows


def test_a_record_that_is_missing_or_broken_is_an_error(tmp_path):
    kept = {}
    make(tmp_path, kept).run()
    (tmp_path / "coupling-8.npz").write_bytes(b"PK")
    with pytest.raises(RecordError, match=r"coupling-8.npz cannot be continued"):
        make(tmp_path, kept).run()


def test_a_window_that_does_not_converge_ends_the_fluid(tmp_path):
    kept = {}
    coupling = make(tmp_path, kept, acceleration=ConstantRelaxation(1.0), most_iterations=6)
    with pytest.raises(NotConvergedError, match=r"window 1 did not converge: residual .* after 6 iterations"):
        coupling.run()
    assert "window 1 did not converge" in coupling._fluid.refused
    assert "state" not in kept


def test_a_fluid_with_too_few_correctors(tmp_path):
    with pytest.raises(SetupError, match="more nOuterCorrectors"):
        make(tmp_path, {}, correctors=2).run()
