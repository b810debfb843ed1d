"""Whatever breaks on the way: every request executes once, and the result is that of an undisturbed run."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from mesh_motion_client import Credentials, QualityRefused, SessionError, Timeout, Unavailable, connect
from mesh_motion_client.connection import Connection
from mesh_motion_client.control import Control
from mesh_motion_protocol.digests import request_digest

from proofs.waiting import wait_until

HERE = Path(__file__).parent
UP = np.array([[0.0, 0.25]] * 4)


def kill_worker(server, session):
    os.kill(server.worker_of(session.credentials.session), signal.SIGKILL)


def listed(client, session):
    """What the list says of a session."""
    return next(entry for entry in client.sessions() if entry["session"] == session.credentials.session)


def test_kill_9_of_the_worker_in_the_middle_of_a_move(server, session, background):
    session.move(UP)
    session.commit()
    with server.hold():
        moving = background(lambda: session.move(2 * UP))
        wait_until(lambda: server.moves() == 2, "the move runs")
        kill_worker(server, session)
    moved = moving()
    assert moved.displacement.tolist() == [[0.0, 0.5]] * 16
    assert session.commit().step == 2
    assert session.points()[0, 1] == 0.5


def test_a_commit_whose_trial_died_is_preceded_by_its_move(server, session):
    session.move(2 * UP)
    session.move(UP)
    kill_worker(server, session)
    assert session.commit().step == 1
    assert session.points()[0, 1] == 0.25
    assert server.moves() == 3


def test_a_commit_that_executed_before_the_worker_died_is_not_executed_again(server, client, mesh, proxy, background):
    session = client.open(mesh)
    session.move(UP)
    proxy[-1].deaf = True
    committing = background(session.commit)
    wait_until(lambda: listed(client, session)["step"] == 1, "the commit executed")
    kill_worker(server, session)
    committed = committing()
    assert (committed.step, session.step) == (1, 1)
    assert server.moves() == 1
    assert session.points()[0, 1] == 0.25
    session.close()


def test_a_trial_outlives_a_refused_move_that_a_worker_did_not(server, session, background):
    session.move(UP)
    with server.hold():
        moving = background(lambda: session.move(1000 * UP))
        wait_until(lambda: server.moves() == 2, "the move runs")
        kill_worker(server, session)
    with pytest.raises(QualityRefused):
        moving()
    assert session.commit().step == 1
    assert session.points()[0, 1] == 0.25


def test_kill_9_of_the_whole_server_and_restart(server, session, background, caplog):
    session.move(UP)
    session.commit()
    with server.hold():
        moving = background(lambda: session.move(2 * UP))
        wait_until(lambda: server.moves() == 2, "the move runs")
        server.kill()
    wait_until(lambda: "no server answers at" in caplog.text, "the client says that it waits")
    server.start()
    assert moving().displacement.tolist() == [[0.0, 0.5]] * 16
    session.commit()
    assert (session.step, session.points()[0, 1]) == (2, 0.5)


def test_a_cut_connection_executes_once(server, client, mesh, proxy, background):
    session = client.open(mesh)
    with server.hold():
        moving = background(lambda: session.move(UP))
        wait_until(lambda: server.moves() == 1, "the move runs")
        proxy[-1].cut()
    assert moving().iteration == 1
    assert server.moves() == 1
    proxy[-1].cut()
    assert session.commit().step == 1
    session.close()


def test_a_dead_worker_shows_by_probe_when_the_connection_does_not(server, client, mesh, proxy, background):
    session = client.open(mesh)
    proxy[-1].stubborn = True
    with server.hold():
        moving = background(lambda: session.move(UP))
        wait_until(lambda: server.moves() == 1, "the move runs")
        kill_worker(server, session)
    began = time.monotonic()
    assert moving().displacement.tolist() == [[0.0, 0.25]] * 16
    assert time.monotonic() - began < 15
    session.close()


def test_after_a_timeout_the_same_call_is_the_same_request(server, session):
    with server.hold(), pytest.raises(Timeout, match="no answer to MOVE"):
        session.move(UP, timeout=0.3)
    assert session.move(UP).iteration == 1
    assert server.moves() == 1


def test_after_a_timeout_another_call_is_another_request(server, session):
    with server.hold(), pytest.raises(Timeout):
        session.move(UP, timeout=0.3)
    assert session.move(2 * UP).displacement[0, 1] == 0.5
    assert server.moves() == 2


def test_who_was_fenced_is_told(client, session, tmp_path):
    session.move(UP)
    session.commit()
    session.credentials.save(tmp_path / "credentials")
    with client.resume(Credentials.load(tmp_path / "credentials")) as other:
        assert (other.step, other.moving_nodes.tolist()) == (1, [0, 4, 8, 12])
        with pytest.raises(SessionError, match="resumed") as caught:
            session.move(UP)
        assert caught.value.code == "ABORTED.FENCED"
        other.move(UP)
        assert other.commit().step == 2


def test_nobody_there_is_told_in_time():
    began = time.monotonic()
    with pytest.raises(Unavailable, match=r"no server answers at tcp://127\.0\.0\.1:9"):
        connect("tcp://127.0.0.1:9", timeout=0.5)
    assert time.monotonic() - began < 5


@pytest.mark.nightly
def test_a_server_that_stays_away_ends_the_call_in_time(server, session):
    session.move(UP)
    server.kill()
    began = time.monotonic()
    with pytest.raises((Timeout, Unavailable)):
        session.commit(timeout=1.0)
    assert time.monotonic() - began < 10
    server.start()
    assert session.commit().step == 1


def test_a_commit_that_executed_unheard_is_asked_again_by_the_same_id(server, client, mesh, proxy):
    session = client.open(mesh)
    session.move(UP)
    proxy[-1].deaf = True
    with pytest.raises(Timeout):
        session.commit(timeout=1.0)
    server.kill()
    server.start()
    committed = session.commit()
    assert (committed.step, session.step, server.moves()) == (1, 1, 1)
    session.close()


def test_a_trial_is_made_again_after_the_lease_ended(server, client, mesh, proxy):
    session = client.open(mesh)
    session.move(UP)
    proxy[-1].cut()
    proxy[-1].shut = True
    wait_until(lambda: listed(client, session)["state"] == "SUSPENDED", "the lease ended")
    proxy[-1].shut = False
    assert session.commit().step == 1
    assert session.points()[0, 1] == 0.25
    session.close()


def test_a_resume_that_was_not_heard_does_not_fence_its_sender(server, session, monkeypatch):
    session.move(UP)
    session.commit()
    ask, deaf = Control.ask, [True]

    def unheard(self, kind, *arguments, **fields):
        reply = ask(self, kind, *arguments, **fields)
        if kind.type == "RESUME" and deaf.pop():
            self._unanswered = {request_digest(kind(client=b"c" * 16, sequence=1, **fields)): self._sequence}
            raise Timeout("seeded")
        return reply

    monkeypatch.setattr(Control, "ask", unheard)
    kill_worker(server, session)
    with pytest.raises(Timeout, match="seeded"):
        session.move(UP)
    deaf.append(False)
    assert session.move(UP).iteration == 1
    assert session.commit().step == 2


def test_a_join_that_failed_leaves_no_connection_behind(server, session, monkeypatch):
    request, seeded = Connection.request, ["once"]

    def refused(self, message, *arguments):
        if message.type == "JOIN" and seeded:
            seeded.clear()
            raise SessionError("seeded", code="NOT_FOUND")
        return request(self, message, *arguments)

    monkeypatch.setattr(Connection, "request", refused)
    kill_worker(server, session)
    with pytest.raises(SessionError, match="seeded"):
        session.move(UP)
    assert session.move(UP).iteration == 1


def test_two_ranks_in_two_processes_get_what_one_gets(server, client, mesh, tmp_path):
    points, triangles = mesh.points, mesh.cells["triangle"]
    lower = points[triangles].mean(axis=1)[:, 1] < 0.5
    parts = {f"cells{rank}": triangles[lower if rank == 0 else ~lower] for rank in (0, 1)}
    ids = {f"ids{rank}": np.random.default_rng(rank).permutation(np.unique(parts[f"cells{rank}"])) for rank in (0, 1)}
    sides = {name: patch.nodes for name, patch in mesh.patches.items()}
    np.savez(tmp_path / "mesh.npz", points=points, **parts, **ids, **sides)
    ranks = [
        subprocess.Popen(
            [
                sys.executable,
                HERE / "two_ranks.py",
                server.endpoint,
                tmp_path / "credentials",
                str(rank),
                tmp_path / "mesh.npz",
                tmp_path / f"out{rank}.npy",
            ]
        )
        for rank in (0, 1)
    ]
    assert [rank.wait(60) for rank in ranks] == [0, 0]
    with client.open(mesh) as session:
        x = points[session.moving_nodes]
        for step in range(3):
            session.move(0.01 * (step + 1) * np.stack([x[:, 1], x[:, 0] + 1], axis=1))
            session.commit()
        whole = session.points()
    for rank in (0, 1):
        assert abs(np.load(tmp_path / f"out{rank}.npy") - whole[ids[f"ids{rank}"]]).max() < 1e-12
