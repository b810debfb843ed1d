"""Whole sessions at log level debug, with refusals and crashes: the log has events, but no data of the clients."""

import base64
import json
import os
import signal
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mesh_motion_client import Keys, MeshMotionError, connect
from served import Served, small_mesh

from mesh_motion_server.security.key_folder import admit, make_client_keys, make_server_keys

FIELDS = {"event", "level", "timestamp", "role"}
#: Numbers that occur nowhere by chance, written out far enough.
OFFSET, PUSH = 0.73105857863, 0.01234567891


def secrets_of(folder: Path) -> list[str]:
    return [path.read_text().split()[1] for path in folder.rglob("*.secret")]


def forms_of(number: float) -> list[str]:
    return [f"{number:.9f}".lstrip("0."), np.float64(number).tobytes().hex()]


def use(server: Served, keys: Keys) -> list[Any]:
    """Two sessions with all possible errors; return their tokens."""
    mesh = small_mesh()
    mesh.points[:] += OFFSET
    with connect(server.endpoint, timeout=90, keys=keys) as client:
        session = client.open(mesh, {"support_radius": 1.0}, label="a beam")
        rows = np.full((len(session.moving_nodes), 2), PUSH)
        session.move(rows)
        session.commit()
        for wrong in (rows[:2], rows * np.nan, rows * 1e30, rows * 100):
            with pytest.raises(MeshMotionError):
                session.move(wrong)
        with pytest.raises(MeshMotionError):
            client.open(mesh, {"support_radius": -OFFSET})
        os.kill(server.events("worker_started")[0]["worker"], signal.SIGKILL)
        session.move(rows, frame="reference")
        session.commit()
        resumed = client.resume(session.credentials)
        with pytest.raises(MeshMotionError) as fenced:
            session.commit()
        assert fenced.value.code == "ABORTED.FENCED"
        session.close()
        resumed.close("discard")
        return [session.credentials.token]


@pytest.mark.slow
def test_no_line_has_a_payload_and_each_is_whole(serve: Any, tmp_path: Path) -> None:
    folder = tmp_path / "keys"
    make_server_keys(folder / "server")
    public = make_client_keys("alice", folder / "alice")
    admit(public.key, folder / "server", name="alice", roles=["owner"])
    keys = Keys.load(folder / "alice" / "alice.secret", folder / "server" / "server.public")
    server = serve(keys_folder=str(folder / "server"), level="debug")
    tokens = use(server, keys)
    assert server.stop() == 0

    text = server.log_path.read_text()
    lines = [json.loads(line) for line in text.splitlines()]  # each is JSON
    assert [line for line in lines if not line.keys() >= FIELDS] == []
    assert {line["role"] for line in lines} >= {"supervisor", "gateway", "worker"}
    events = {line["event"] for line in lines}
    assert {"ready", "self_test_passed", "open", "served", "worker_ended", "resume", "stopped"} <= events
    about_one = [line for line in lines if line["event"] in ("open", "resume", "worker_ended", "served", "lease_ended")]
    assert [line for line in about_one if len(line["session"]) != 32] == []

    forbidden = [form for number in (OFFSET, PUSH, OFFSET + 0.25, OFFSET + PUSH) for form in forms_of(number)]
    forbidden += [form for token in tokens for form in (token.hex(), base64.b64encode(token).decode(), repr(token))]
    secrets = secrets_of(folder)
    assert len(secrets) >= 2
    assert [form for form in forbidden + secrets if form in text] == []
