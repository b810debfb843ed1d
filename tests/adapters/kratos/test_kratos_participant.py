"""The participant with a stand-in for Kratos' model part, against a real server."""

import json
import time

import numpy as np
import pytest
from mesh_motion_client import Mesh, Patch, connect
from mesh_motion_kratos.errors import MotionError, PartError, SettingsError
from mesh_motion_kratos.participant import Participant, roles_of
from mesh_motion_kratos.session_file import StoredSession
from mesh_motion_kratos.settings import RemoteSettings


@pytest.fixture
def begin(mesh_motion_server, stand_in, tmp_path):
    begun, said = [], []

    def start(part=stand_in, *, restarted=False, **settings):
        given = RemoteSettings(endpoint=mesh_motion_server.endpoint, **settings)
        participant = Participant(part, given, restarted=restarted, warn=said.append)
        begun.append(participant)
        participant.said = said
        return participant

    yield start
    for participant in begun:
        participant.close()


def push(part, plate, displacement):
    part.values[plate.boundary] = displacement[plate.boundary]


def bent(plate, amount):
    """The right side moves to the right, most in its middle."""
    x, y = plate.points.T
    return np.column_stack([amount * x * np.sin(np.pi * y), np.zeros_like(x)])


def client_answers(endpoint, plate, motions, method):
    """Results of the Python client for the same motions, each committed."""
    mesh = Mesh(plate.points, {"triangle": plate.triangles}, {"edge": Patch("moving", plate.boundary)})
    with connect(endpoint) as server, server.open(mesh, method) as session:
        answers = []
        for motion in motions:
            answers.append(session.move(motion[session.moving_nodes], frame="reference").displacement)
            session.commit()
        return answers


def test_answers_are_the_clients_to_the_bit(begin, stand_in, plate, mesh_motion_server):
    motions = [bent(plate, amount) for amount in (0.1, 0.2, -0.1)]
    participant = begin(method={"quality_threshold": 0.4})
    for motion, expected in zip(
        motions, client_answers(mesh_motion_server.endpoint, plate, motions, {"quality_threshold": 0.4}), strict=True
    ):
        push(stand_in, plate, motion)
        participant.move()
        participant.commit()
        assert np.array_equal(stand_in.values, expected)


def test_iterations_start_from_the_committed_mesh(begin, stand_in, plate):
    participant = begin()
    push(stand_in, plate, bent(plate, 0.1))
    participant.move()
    first = stand_in.values.copy()
    push(stand_in, plate, bent(plate, -0.3))
    participant.move()
    push(stand_in, plate, bent(plate, 0.1))
    participant.move()
    assert np.array_equal(stand_in.values, first)
    assert participant.session.iteration == 3
    participant.commit()
    assert (participant.session.step, participant.commit()) == (1, None)


def test_restart_goes_on_as_if_it_had_not_been(begin, stand_in, plate, tmp_path):
    file = str(tmp_path / "mesh.session")
    amounts = (0.1, 0.25)
    whole = []
    participant = begin()
    for amount in amounts:
        push(stand_in, plate, bent(plate, amount))
        participant.move()
        participant.commit()
        whole.append(stand_in.values.copy())
    stand_in.set_displacements(np.zeros_like(plate.points))
    for number, amount in enumerate(amounts):
        part = begin(restarted=number > 0, session_file=file)
        assert part.resumed == (number > 0)
        push(stand_in, plate, bent(plate, amount))
        part.move()
        part.commit()
        part.close()
        assert np.array_equal(stand_in.values, whole[number])


class OpensAnew(Exception):
    """Replaces a new session in tests of the steps before it."""


def test_a_restart_that_cannot_go_on_says_why_and_begins_a_new_session(begin, stand_in, plate, tmp_path, monkeypatch):
    file = str(tmp_path / "mesh.session")
    participant = begin(session_file=file)
    push(stand_in, plate, bent(plate, 0.1))
    participant.move()
    participant.commit()
    committed = stand_in.values.copy()
    participant.close()

    def opens(self):
        raise OpensAnew

    monkeypatch.setattr(Participant, "_open", opens)

    def refused(**settings):
        with pytest.raises(OpensAnew):
            begin(restarted=True, **settings)
        return participant.said[-1]

    stand_in.set_displacements(0.5 * committed)
    assert "has gone on to step 1, with another mesh" in refused(session_file=file)
    stand_in.set_displacements(committed)
    stand_in.fixed[24] = True
    assert "other nodes are prescribed" in refused(session_file=file)
    stand_in.fixed[24] = False
    assert "another method" in refused(session_file=file, method={"basis": "wendland-c4"})
    assert "cannot be read" in refused(session_file=str(tmp_path / "none"))
    assert 'no "session_file" is set' in refused()
    assert begin(restarted=True, session_file=file).resumed


def test_displacements_count_from_the_initial_mesh_after_a_new_start(begin, stand_in, plate):
    """A session that begins with a moved mesh: its reference differs from the part's."""
    stand_in.set_displacements(plate.turned(0.2))
    participant = begin(method={"basis": "tps"})
    push(stand_in, plate, plate.turned(0.35))
    participant.move()
    np.testing.assert_allclose(stand_in.values, plate.turned(0.35), atol=1e-12)


def test_session_file_is_its_owners_and_goes_with_the_session(begin, stand_in, mesh_motion_server, tmp_path):
    file = tmp_path / "mesh.session"
    kept, left = begin(session_file=str(file)), begin()
    names = [participant.session.credentials.session for participant in (kept, left)]
    assert file.stat().st_mode & 0o777 == 0o600
    assert StoredSession.load(file).credentials == kept.session.credentials
    kept.close()
    left.close()
    with connect(mesh_motion_server.endpoint) as server:
        deadline = time.monotonic() + 60.0
        while names[1] in (stored := {entry["session"] for entry in server.sessions()}):
            assert time.monotonic() < deadline, "the discarded session is still there"
            time.sleep(0.05)
    assert names[0] in stored
    with pytest.raises(PartError, match="closed"):
        kept.move()


def test_refusal_names_kratos_elements_and_leaves_the_mesh(begin, stand_in, plate):
    participant = begin(method={"correction": "none", "sub_steps": "never"})
    folded = np.zeros_like(plate.points)
    folded[plate.at(0, 1.0)] = [-1.5, 0.0]
    push(stand_in, plate, folded)
    before = stand_in.values.copy()
    with pytest.raises(MotionError, match=r"worst elements: 10\d\d"):
        participant.move()
    assert np.array_equal(stand_in.values, before)
    push(stand_in, plate, bent(plate, 0.1))
    participant.move()


def test_roles(stand_in, plate):
    """Prescribed nodes move; a sliding part may have some prescribed nodes; a fixed part stays."""
    inner = np.setdiff1d(plate.at(1, 1.0), plate.at(0, 0.0))
    stand_in.fixed[inner, 0] = False
    with pytest.raises(PartError, match=f"node {stand_in.node_ids[inner[0]]} has some components"):
        roles_of(stand_in, RemoteSettings())
    roles = roles_of(stand_in, RemoteSettings(roles={"top": "slip", "left": "fixed"}))
    assert np.array_equal(roles.fixed, plate.at(0, 0.0))
    assert np.array_equal(roles.moving, np.setdiff1d(plate.boundary, np.union1d(inner, plate.at(0, 0.0))))
    stand_in.fixed[:] = False
    with pytest.raises(PartError, match="no node has all components"):
        roles_of(stand_in, RemoteSettings())


def test_sliding_nodes_stay_on_their_line(begin, stand_in, plate):
    inner = np.setdiff1d(plate.at(1, 1.0), np.union1d(plate.at(0, 0.0), plate.at(0, 1.0)))
    stand_in.fixed[inner, 0] = False
    participant = begin(roles={"top": "slip"})
    right = np.zeros_like(plate.points)
    right[plate.at(0, 1.0)] = [0.3, 0.0]
    push(stand_in, plate, right)
    participant.move()
    assert np.abs(stand_in.values[inner, 1]).max() < 1e-12
    assert stand_in.values[inner, 0].max() > 0.1


def test_a_fixed_part_may_not_be_moved_and_fixity_may_not_change(begin, stand_in, plate):
    participant = begin(roles={"left": "fixed"})
    stand_in.values[plate.at(0, 0.0)[2]] = [0.1, 0.0]
    with pytest.raises(PartError, match="role fixed is to move"):
        participant.move()
    participant.check_roles()
    stand_in.fixed[plate.at(0, 1.0)[3]] = False
    with pytest.raises(PartError, match=r"node \d+ is no longer prescribed"):
        participant.check_roles()


@pytest.mark.parametrize(
    ("block", "words"),
    [
        ({"endpont": ""}, 'no setting "endpont"'),
        ({"endpoint": 7440}, '"endpoint" must be a text'),
        ({"method": "wendland-c2"}, '"method" must be a block'),
        ({"timeout": 0}, "positive number of seconds, got 0"),
        ({"compute_timeout": "long"}, "positive number of seconds"),
        ({"roles": {"top": "moving"}}, "must be one of fixed, slip, symmetry"),
    ],
)
def test_settings_that_are_wrong_are_named(block, words):
    with pytest.raises(SettingsError, match=words):
        RemoteSettings.from_json(json.dumps(block))


def test_endpoint_from_the_environment(monkeypatch):
    settings = RemoteSettings.from_json('{"endpoint": "$SOME_ENDPOINT", "timeout": 5}')
    with pytest.raises(SettingsError, match="environment"):
        _ = settings.address
    monkeypatch.setenv("SOME_ENDPOINT", "tcp://127.0.0.1:7440")
    assert (settings.address, settings.timeout) == ("tcp://127.0.0.1:7440", 5)


@pytest.mark.parametrize("text", ["", "{}", '{"session": "a", "token": "zz", "opened_with": ""}', "[1]"])
def test_session_file_that_is_none(tmp_path, text):
    path = tmp_path / "file"
    path.write_text(text)
    with pytest.raises(SettingsError, match="is none"):
        StoredSession.load(path)


def test_session_file_that_cannot_be_written(tmp_path):
    stored = StoredSession.load(_written(tmp_path))
    with pytest.raises(SettingsError, match="cannot be written"):
        stored.save(tmp_path / "missing" / "file")


def _written(folder):
    path = folder / "written"
    path.write_text(json.dumps({"session": "ab", "token": "00ff", "opened_with": "x"}))
    return path
