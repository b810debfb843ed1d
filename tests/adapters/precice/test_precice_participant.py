"""Explicit and implicit coupling, steps within windows, restarts: the written data equals the Python client's results.

The reference is a separate session, moved and committed once per window with the converged data of the other
participants; repeated windows must have no effect on it.
"""

from types import SimpleNamespace

import numpy as np
import pytest
from mesh_motion_client import InvalidInput, QualityRefused
from mesh_motion_precice import Participant, read_configuration, resume_session
from mesh_motion_precice.participant import load_mesh
from precice_stub import PreciceError, Script

VOLUME = ("Volume", "NodeDisplacement")


@pytest.fixture
def play(server, case, stub):
    """Couple with the stub; return the windows, the stub, and the session's committed points."""

    def run(*arguments, file=None, credentials=None, restart=False, **more):
        configuration = read_configuration(file or case())
        mesh = load_mesh(configuration)
        precice = stub(*arguments, **more)
        participant = Participant(precice, mesh, configuration)
        levels = {"bdf1": ""}.get(configuration.velocity_scheme, configuration.velocity_scheme)
        opened = server.open(mesh, configuration.method, time_levels=levels) if not restart else None
        session = opened or resume_session(server, mesh, credentials)
        if credentials and not restart:
            session.credentials.save(credentials)
        with session:
            participant.begin(session)
            windows = list(participant.windows())
            return windows, precice, session.points("committed")

    return run


@pytest.fixture
def direct(server, square, script):
    """The client's results for the converged displacements at these fractions of each window."""

    def run(iterations, frame="reference", fractions=(1.0,), displacement="absolute", **more):
        partner = Script(script(iterations, **more))
        history = []
        with server.open(square, {"support_radius": 0.8, "displacement": displacement}) as session:
            places = square.points[session.moving_nodes]
            for window in range(len(iterations)):
                for fraction in fractions:
                    rows = partner.displacement(places, window, iterations[window], fraction)
                    history.append(session.move(rows, frame=frame).displacement)
                session.commit()
            final = session.points("committed")
            session.close("discard")
        return history, final

    return run


def converged(precice):
    """Data written in the last iteration of each window, step by step."""
    last = precice.script.iterations
    return [written[VOLUME] for window, iteration, _, written in precice.history if iteration == last[window]]


@pytest.mark.parametrize(("iterations", "explicit"), [([1, 1], True), ([3, 1, 4], False)], ids=["explicit", "implicit"])
def test_converged_windows_are_those_of_the_client(iterations, explicit, play, direct):
    windows, precice, final = play(iterations, explicit=explicit)
    expected, points = direct(iterations)
    assert [window.iterations for window in windows] == iterations
    assert [window.number for window in windows] == list(range(1, len(iterations) + 1))
    np.testing.assert_array_equal(converged(precice), expected)
    np.testing.assert_array_equal(final, points)
    assert precice.state == "finalized"
    kept, restored = precice.calls.count("write checkpoint"), precice.calls.count("read checkpoint")
    assert (kept, restored) == ((0, 0) if explicit else (len(iterations), sum(iterations) - len(iterations)))
    if iterations[0] == 3:  # what had not converged differs, or nothing would have been compared
        first, second, third = (written[VOLUME] for *_, written in precice.history[:3])
        assert np.abs(first - third).max() > 1.9 * np.abs(second - third).max() > 1e-4


def couple_steps_within_windows(case, play, direct):
    """Three steps a window, the second window twice, against what the client gives; relative: commits are seen."""
    iterations, file = [1, 2], case("time_step = 0.04", method='displacement = "relative"')
    windows, precice, final = play(iterations, file=file)
    expected, points = direct(iterations, fractions=(1 / 3, 2 / 3, 1.0), displacement="relative")
    assert [round(3 * fraction) for _, _, fraction, _ in precice.history[:3]] == [1, 2, 3]
    np.testing.assert_allclose(converged(precice), expected, atol=1e-15)  # 0.1 / 3 three times is not 0.1
    np.testing.assert_allclose(final, points, atol=1e-15)
    assert windows[-1].time == pytest.approx(0.2)


def test_steps_within_a_window_start_where_it_began(case, play, direct):
    """A committed step cannot be taken back: each step is a trial, the last of them is committed."""
    couple_steps_within_windows(case, play, direct)


class Seeded(Participant):
    def begin(self, session):
        super().begin(session)
        getattr(self, self.bug)()

    def repeated_windows_are_committed(self):
        self._session.rollback = self._session.commit

    def a_step_reads_where_it_begins(self):
        self._boundary = lambda _, read=self._boundary: read(0.0)

    def nodes_in_another_order(self):
        self._boundary = lambda time, read=self._boundary: read(time)[::-1]

    def the_last_answer_is_late(self):
        moves, move = [], self._session.move

        def late(*arguments, **options):
            moves.append(move(*arguments, **options))
            return moves[-2:][0]

        self._session.move = late

    def a_window_is_one_step(self):
        self._step = lambda rest: rest


BUGS = sorted(set(vars(Seeded)) - set(vars(Participant)))


@pytest.mark.nightly
@pytest.mark.parametrize("bug", BUGS)
def test_a_seeded_bug_is_found(bug, case, play, direct, monkeypatch):
    monkeypatch.setattr(Seeded, "bug", bug, raising=False)
    monkeypatch.setitem(globals(), "Participant", Seeded)
    with pytest.raises((AssertionError, InvalidInput)):
        couple_steps_within_windows(case, play, direct)


def test_displacement_since_the_last_window(case, play, direct):
    file = case('frame = "committed"')
    _, precice, final = play([2, 2], file=file, since_window=True)
    expected, points = direct([2, 2], frame="committed", since_window=True)
    np.testing.assert_array_equal(converged(precice), expected)
    np.testing.assert_array_equal(final, points)


def test_a_solver_s_own_mesh_in_its_own_order(case, play, direct, square):
    order = np.random.default_rng(1).permutation(len(square.points))[:70]  # a part of it, as one rank may have
    blurred = square.points[order] + 1e-5
    _, precice, _ = play([2, 1], file=case(volume="received = true"), received=blurred)
    expected, _ = direct([2, 1])
    np.testing.assert_array_equal(converged(precice), [nodes[order] for nodes in expected])


def test_a_restart_goes_on_as_if_it_had_not_been(case, play, direct, server, stub, square, tmp_path):
    """The first run is cut off in its third window, after a trial; the second begins with initial data.

    By default each step starts from the mesh of the last one, so that the final mesh depends on all of them.
    """
    file, credentials = case(), tmp_path / "session"
    configuration = read_configuration(file)
    session = server.open(square, configuration.method)
    session.credentials.save(credentials)
    first = stub([2, 2, 2, 2])
    first.advance = cut_off_after(first, 5)
    participant = Participant(first, square, configuration)
    participant.begin(session)
    with pytest.raises(KeyboardInterrupt):
        list(participant.windows())
    session.close()
    restarted = {"begin": 2, "initial_data": True, "credentials": credentials, "restart": True}
    windows, second, final = play([2, 2], file=file, **restarted)
    expected, points = direct([1, 1, 1, 1])
    assert [window.number for window in windows] == [3, 4]
    np.testing.assert_allclose(second.initial[VOLUME], expected[1], atol=1e-15)
    np.testing.assert_array_equal(converged(second), expected[2:])
    np.testing.assert_array_equal(final, points)


def cut_off_after(precice, steps):
    advance = precice.advance

    def cut(length):
        if len(precice.history) == steps:
            raise KeyboardInterrupt
        advance(length)

    return cut


def test_a_refused_motion_leaves_the_last_window(case, play, server, tmp_path, square):
    credentials = tmp_path / "session"
    with pytest.raises(QualityRefused):
        play([1, 1], window=3.0, motion=[[5.0, 0.0], [0.0, 5.0]], credentials=credentials)
    session = resume_session(server, square, credentials)
    assert session.step == 1
    session.close("discard")


def test_a_restart_with_another_mesh_or_from_nothing_is_refused(server, case, square, tmp_path):
    configuration = read_configuration(case())
    with pytest.raises(InvalidInput, match="nothing to restart from"):
        resume_session(server, square, tmp_path / "none")
    with server.open(square, configuration.method) as session:
        session.credentials.save(tmp_path / "session")
    with np.load(tmp_path / "mesh.npz") as file:
        arrays = dict(file)
    np.savez(tmp_path / "mesh.npz", **arrays | {"points": arrays["points"] * 1.01})
    with pytest.raises(InvalidInput, match="is not that of the mesh file"):
        resume_session(server, load_mesh(configuration), tmp_path / "session")


def test_the_velocity_is_the_displacement_of_the_step_over_its_time(case, play, script):
    meshes = script([1])["meshes"]
    meshes["Volume"]["data"].append("NodeVelocity")
    for frame, since_window in (("reference", False), ("committed", True)):
        file = case(f'frame = "{frame}"\ntime_step = 0.05', volume='velocity = "NodeVelocity"')
        _, precice, _ = play([2, 1], file=file, meshes=meshes, since_window=since_window)
        found = [written["Volume", "NodeVelocity"] for *_, written in precice.history]
        moved = [written[VOLUME] for *_, written in precice.history]
        last = np.zeros_like(moved[0]) if since_window else moved[3]
        expected = [moved[0], moved[1] - moved[0], moved[2], moved[3] - moved[2], moved[4] - last, moved[5] - moved[4]]
        np.testing.assert_allclose(found, np.array(expected) / 0.05, atol=1e-12)
        assert np.abs(found).max() > 1e-3


@pytest.mark.parametrize("scheme", ["bdf1", "bdf2", "bossak"])
def test_the_velocity_is_that_of_the_server_s_scheme(scheme, case, play, script, tmp_path):
    """Its earlier levels outlive a restart."""
    meshes = script([1])["meshes"]
    meshes["Volume"]["data"].append("NodeVelocity")
    file, same = case(f'velocity_scheme = "{scheme}"', volume='velocity = "NodeVelocity"'), {"meshes": meshes}

    def velocities(precice):
        last = precice.script.iterations
        written = [written for window, iteration, _, written in precice.history if iteration == last[window]]
        return [each["Volume", "NodeVelocity"] for each in written], [each[VOLUME] for each in written]

    _, precice, _ = play([2, 1, 3, 1], file=file, **same)
    found, x = velocities(precice)
    rest, dt = np.zeros_like(x[0]), 0.1
    first = [(x[0] - rest) / dt, *(np.diff(x, axis=0) / dt)]
    if scheme == "bdf1":
        expected = first
    elif scheme == "bdf2":
        levels = np.array([rest, *x])
        expected = [first[0], *((1.5 * levels[2:] - 2.0 * levels[1:-1] + 0.5 * levels[:-2]) / dt)]
    else:
        expected, before, velocity, acceleration = [], rest, rest, rest
        for now in x:  # Newmark's rule
            new = ((now - before) / dt**2 - velocity / dt - (0.5 - 0.4225) * acceleration) / 0.4225
            velocity = velocity + dt * (0.2 * acceleration + 0.8 * new)
            before, acceleration = now, new
            expected.append(velocity)
    np.testing.assert_allclose(found, expected, atol=1e-11)
    assert np.abs(np.array(expected) - first).max() > 1e-3 or scheme == "bdf1"
    credentials = tmp_path / "session"
    play([1, 2], file=file, credentials=credentials, **same)
    _, second, _ = play([1, 2], file=file, begin=2, credentials=credentials, restart=True, **same)
    np.testing.assert_array_equal(velocities(second)[0], found[2:])


@pytest.fixture
def participant(case, stub, square):
    """A participant, and a session without requests."""

    def make(file=None, moving=None, **more):
        moving = np.union1d(square.patches["lower"].nodes, square.patches["upper"].nodes) if moving is None else moving
        session = SimpleNamespace(moving_nodes=moving, step=0)
        return Participant(stub([1], **more), square, read_configuration(file or case())), session

    return make


def test_a_configuration_that_does_not_fit_the_mesh_is_refused(participant, case, square):
    with pytest.raises(InvalidInput, match="has 3 dimensions, the mesh file 2"):
        participant(dimensions=3)
    made, session = participant(moving=np.arange(3))
    with pytest.raises(InvalidInput, match="the moving node 0 is on no patch that is read"):
        made.begin(session)
    received = case(volume="received = true")
    for points, words in [
        (square.points + 1e-4, "vertex 0 of mesh 'Volume' at .* lies on no node"),
        (square.points + 10.0, "has no vertex near"),
    ]:
        made, session = participant(received, received=points)
        with pytest.raises(InvalidInput, match=words):
            made.begin(session)
    made, session = participant(received, received=square.points, initial_data=True)
    with pytest.raises(InvalidInput, match="initial data cannot be written"):
        made.begin(session)


def test_a_node_of_two_patches_is_read_alike_from_both(participant, square):
    follower, session = participant()
    follower.begin(session)
    lower, upper = (surface.read for surface in follower._surfaces)
    shared = np.flatnonzero(np.isin(square.patches["upper"].nodes, square.patches["lower"].nodes))

    def off(size):
        def read(coupling, time):
            rows = upper(coupling, time)
            rows[shared[0], 1] += size
            return rows

        follower._surfaces = [SimpleNamespace(**vars(s), read=r) for s, r in zip(wet, (lower, read), strict=True)]

    wet, exact = list(follower._surfaces), follower._boundary(0.0)
    row = np.searchsorted(session.moving_nodes, square.patches["upper"].nodes[shared[0]])
    off(9e-8)
    assert follower._boundary(0.0)[row, 1] == exact[row, 1] + 9e-8
    off(2e-7)
    with pytest.raises(InvalidInput, match="is read from the preCICE meshes 'Lower' and 'Upper', which move it"):
        follower._boundary(0.0)


def test_connectivity_is_given_where_a_mapping_uses_it(stub, square, case):
    configuration = read_configuration(case())
    precice = stub([1], connectivity=True)
    Participant(precice, square, configuration)
    assert {name: len(cells) for name, cells in precice.connected.items()} == {
        "Lower": len(square.patches["lower"].nodes) - 1,
        "Upper": len(square.patches["upper"].nodes) - 1,
        "Volume": len(square.cells["triangle"]),
    }
    precice = stub([1])
    Participant(precice, square, configuration)
    assert not precice.connected


@pytest.mark.parametrize(
    ("mesh", "change", "words"),
    [
        ("Lower", {"data": ["Displacements"]}, "Data .Displacement. is unknown"),
        ("Lower", {"scalar": "Displacement"}, "the data 'Displacement' is not a vector"),
        ("Volume", {"read_only": ["NodeDisplacement"]}, "attempted to write"),
    ],
)
def test_data_are_checked_before_there_is_a_session(mesh, change, words, participant, script):
    meshes = script([1])["meshes"]
    meshes[mesh] = meshes[mesh] | change
    with pytest.raises((InvalidInput, PreciceError), match=words):
        participant(meshes=meshes)
