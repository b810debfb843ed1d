"""Sessions as a real server tells them to who has no token."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from mesh_motion_client import Keys, Mesh, Patch, connect

from mesh_motion_server.security.key_folder import admit, make_client_keys, make_server_keys
from mesh_motion_server.watch.terminal.endpoint_source import EndpointSource
from mesh_motion_server.watch.terminal.sources import Unreadable
from proofs.server_process import ServerProcess
from proofs.waiting import wait_until

SQUARE = Mesh(
    np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0], [0.5, 0.5]]),
    {"triangle": np.array([[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]])},
    {"low": Patch("moving", np.array([0, 1])), "high": Patch("fixed", np.array([2, 3]))},
)


@pytest.mark.nightly
def test_a_list_without_more_and_a_server_that_goes(tmp_path: Path) -> None:
    with connect(state=tmp_path) as server:
        source = EndpointSource(server.endpoint, timeout=10.0)
        try:
            assert source.sessions() == []
            with server.open(SQUARE, label="square") as session:
                session.move(np.full((2, 2), 0.01))
                session.commit()
                # LIST tells what the session's worker last told of itself: that may come after the reply to the holder
                wait_until(lambda: [line.step for line in source.sessions()] == [1], "the list to tell of the commit")
                (line,) = source.sessions()
                assert (line.label, line.state, line.is_live, line.minimum) == ("square", "READY", True, None)
                details = source.details(line.session, 1.0)
                assert details is not None
                assert details.lacks.startswith("A server without keys tells nobody but its holder more")
                assert len(details.columns["step"]) == 0
            server.close()
            with pytest.raises(Unreadable) as gone:
                source.sessions()
            assert gone.value.code in ("UNAVAILABLE", "DEADLINE_EXCEEDED")
        finally:
            source.close()


@pytest.mark.nightly
def test_a_session_that_nobody_moves_comes_to_rest_while_somebody_watches(tmp_path: Path) -> None:
    make_server_keys(tmp_path / "keys")
    for name, role in (("solver", "owner"), ("viewer", "monitor")):
        make_client_keys(name, tmp_path)
        admit(str(tmp_path / f"{name}.public"), tmp_path / "keys", roles=[role])
    keys = {
        name: Keys.load(tmp_path / f"{name}.secret", tmp_path / "keys/server.public") for name in ("solver", "viewer")
    }
    with ServerProcess(tmp_path / "server", keys_folder=str(tmp_path / "keys"), lease_seconds=1.0) as server:
        source = EndpointSource(server.endpoint, keys["viewer"], timeout=30.0)
        try:
            with connect(server.endpoint, keys=keys["solver"]) as solver:
                session = solver.open(SQUARE, label="square")
                session.move(np.full((2, 2), 0.01))

                def watched() -> str:
                    (line,) = source.sessions()
                    details = source.details(line.session, 30.0)
                    return f"{line.state}, {details.trial if details else ''}"

                wait_until(lambda: watched() == "TRIAL, step 1, iteration 1", "the trial is seen")
                session._courier.disconnect()  # as if its process had ended
                wait_until(lambda: watched().startswith("SUSPENDED"), "the end of the lease")
                with solver.resume(session.credentials) as again:
                    again.move(np.full((2, 2), 0.01))
                    again.commit()
        finally:
            source.close()
