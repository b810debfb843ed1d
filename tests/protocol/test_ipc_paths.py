"""The folders of sockets."""

import os
import tempfile

import pytest
from mesh_motion_protocol.ipc_paths import PATH_BYTES, PREFIX, folder_for_sockets


@pytest.mark.parametrize("characters", [1, 60, 75, 76, 77, 200])
def test_a_private_folder_has_room_for_a_sockets_path(monkeypatch, characters):
    """With letters of two bytes, which count twice."""
    for letter in "xü":
        monkeypatch.setattr(tempfile, "tempdir", folder := "/" + letter * characters)
        found = folder_for_sockets("w4194304.ipc")
        path = f"{found}/{PREFIX}12345678/w4194304.ipc"
        assert len(os.fsencode(path)) <= PATH_BYTES
        assert found in (folder, "/tmp")
        if len(os.fsencode(folder)) <= 72:
            assert found == folder
