"""A server that is stopped and restarted while clients use it: nothing is lost, and the numbers stay the same."""

import csv
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mesh_motion_client import connect
from mesh_motion_client.session import Session
from mesh_motion_protocol.messages import Uploaded
from served import Served, small_mesh

from tests.faults.waiting import PATIENCE, wait_until

FSI = Path(__file__).parents[2] / "examples" / "mock_fsi"
STEPS = 7


def start_fluid(server: Served, solid: str, out: Path) -> Any:
    options = {"--server": server.endpoint, "--solid": solid, "--steps": STEPS, "--dt": 0.05, "--out": out}
    command = [sys.executable, str(FSI / "fluid.py"), *(str(word) for pair in options.items() for word in pair)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)


def couple(server: Served, out: Path, restarts: tuple[int, ...]) -> str:
    """Run fluid and solid; restart the server in the fluid's step after each of these steps; return fsi.csv."""
    solid_command = [sys.executable, str(FSI / "solid.py"), "--bind", "tcp://127.0.0.1:*", "--dt", "0.05"]
    with subprocess.Popen(solid_command, stdout=subprocess.PIPE, text=True) as solid:
        with start_fluid(server, solid.stdout.readline().rsplit(maxsplit=1)[-1], out) as fluid:
            lines = []
            for line in fluid.stdout:
                lines.append(line)
                if any(line.startswith(f"step {step:3d}") for step in restarts):
                    assert server.stop() == 0
                    server.start()
            assert fluid.wait(PATIENCE) == 0, "".join(lines)
        solid.terminate()
    return (out / "fsi.csv").read_text()


@pytest.mark.nightly
def test_a_coupled_run_is_bitwise_the_same_across_two_restarts(serve: Any, tmp_path: Path) -> None:
    server = serve(real=True)
    undisturbed = couple(server, tmp_path / "undisturbed", ())
    disturbed = couple(server, tmp_path / "disturbed", (2, 4))
    assert len(list(csv.DictReader(undisturbed.splitlines()))) == STEPS
    assert disturbed == undisturbed
    assert len(server.events("stopped")) == 2
    assert len(server.events("resume")) == 2
    assert not server.events("killed")


@pytest.mark.nightly
def test_every_kind_of_session_is_there_after_a_restart(serve: Any, background: Any) -> None:
    server = serve()
    mesh = small_mesh()
    settings = {"support_radius": 1.0}
    with connect(server.endpoint, timeout=90) as client:
        idle, trial = client.open(mesh, settings), client.open(mesh, settings)
        rows = 0.02 * np.sin(1 + mesh.points[idle.moving_nodes])
        idle.move(rows)
        digest = idle.commit().digest
        trial.move(rows)

        assert server.stop() == 0  # idle is at a step, trial has one that is not committed
        wait_until(lambda: server.events("stopped"), "stopped")
        committed = background(trial.commit)  # asks while no server is there
        server.start()
        assert committed().digest == digest
        np.testing.assert_array_equal(idle.points(), trial.points())
        for session in (idle, trial):
            session.move(rows, frame="reference")
        assert idle.commit().digest == trial.commit().digest

        for session in (idle, trial):
            session.close()
    assert [line["event"] for line in server.events() if line["level"] == "error"] == []


@pytest.mark.nightly
def test_an_upload_is_begun_again_at_the_next_server(serve: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    server, honest, opened = serve(), Session.upload, []

    def interrupted(session: Session, *arguments: Any, **options: Any) -> Any:
        opened.append(session.credentials.session)
        if len(opened) == 1:
            parts = iter(mesh.parts(**session._courier.address))
            session._courier.deliver(next(parts), Uploaded, PATIENCE)  # some of the mesh has arrived
            assert server.stop() == 0
            server.start()
        return honest(session, *arguments, **options)

    monkeypatch.setattr(Session, "upload", interrupted)
    mesh = small_mesh()
    with connect(server.endpoint, timeout=90) as client, client.open(mesh, {"support_radius": 1.0}) as session:
        session.move(0.01 * mesh.points[session.moving_nodes])
        assert session.commit().step == 1
    assert len(set(opened)) == 2
    assert [path.name for path in (server.state / "sessions").iterdir()] == opened[1:]
