"""Where the data endpoints are, seen from here."""

import pytest
from mesh_motion_client.control import Control


@pytest.mark.parametrize(
    ("control", "told", "reached"),
    [
        ("tcp://server:7440", "tcp://0.0.0.0:40001", "tcp://server:40001"),
        ("tcp://[::1]:7440", "tcp://[::]:40001", "tcp://[::1]:40001"),
        ("tcp://127.0.0.1:7440", "tcp://127.0.0.1:40001", "tcp://127.0.0.1:40001"),
        ("ipc:///run/mm/control", "ipc:///run/mm/w12.ipc", "ipc:///run/mm/w12.ipc"),
    ],
)
def test_a_wildcard_stands_for_the_host_of_the_control_endpoint(control, told, reached):
    assert Control(control).data_endpoint(told) == reached
