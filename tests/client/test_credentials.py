"""The data for RESUME is a secret in a file."""

import stat

import pytest
from mesh_motion_client import Credentials, InvalidInput


def test_they_come_back_and_only_the_owner_reads_them(tmp_path):
    credentials = Credentials("ab" * 16, bytes(range(32)))
    path = tmp_path / "credentials"
    (tmp_path / "credentials.part").touch(0o644)  # left by an earlier program, readable by everybody
    credentials.save(path)
    assert Credentials.load(path) == credentials
    assert stat.S_IMODE(path.stat().st_mode) == 0o600


def test_the_token_is_not_shown():
    assert "token" not in repr(Credentials("ab" * 16, bytes(range(32))))


@pytest.mark.parametrize("text", ["", "{}", "[]", '{"session": "a", "token": "xyz"}'])
def test_other_files_are_refused(tmp_path, text):
    path = tmp_path / "credentials"
    path.write_text(text)
    with pytest.raises(InvalidInput, match="must hold a session and a token"):
        Credentials.load(path)
