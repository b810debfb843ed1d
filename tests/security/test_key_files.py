"""Key files and the allow-list: written files can be read, unsafe or wrong files are refused."""

import os
import stat
import time

import pytest
import zmq
from mesh_motion_client import InvalidInput as ClientInvalidInput
from mesh_motion_client import Keys
from mesh_motion_protocol.errors import InvalidInput, SessionError
from mesh_motion_protocol.key_files import KeyFileError, PublicKey, SecretKey

from mesh_motion_server.security import key_folder
from mesh_motion_server.security.allow_list import AllowList, Entry, Everybody, read_entries, write_entries
from mesh_motion_server.security.key_folder import admit, make_client_keys, make_server_keys, read_list, revoke

# Fixed, for they stand in the names of tests: those are the same in every process and every run.
KEY = "rq:rM>}U?@Lns47E1%kR.o@n%FcmmsL/@{H8]yf7"
OTHER = "Yne@$w-vo<fVvi]a<NY6T1ed:M$fCG*[IaLV{hID"
ALICE = '{ name = "alice", roles = ["owner"] }'
#: Every character that Z85 has, 40 at a time.
Z85 = "0123456789abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ.-:+=^!/*?&<>()[]{}@%$#"
ALL = [Z85[:40], Z85[40:80], Z85[-40:]]


def mode(path):
    return stat.S_IMODE(path.stat().st_mode)


def test_keys_are_made_with_the_modes_they_need(tmp_path):
    before = os.umask(0)
    try:
        public = make_server_keys(tmp_path / "server")
        make_client_keys("alice", tmp_path / "alice")
    finally:
        os.umask(before)
    assert mode(tmp_path / "server") == mode(tmp_path / "alice") == 0o700
    assert mode(tmp_path / "server" / "server.secret") == mode(tmp_path / "alice" / "alice.secret") == 0o600
    assert mode(tmp_path / "server" / "allow.toml") == 0o644
    secret = SecretKey.load(tmp_path / "server" / "server.secret")
    assert zmq.curve_public(secret.key.encode()).decode() == public.key
    assert PublicKey.load(tmp_path / "server" / "server.public") == public
    assert secret.key not in repr(secret)
    assert read_list(tmp_path / "server") == {}


def test_keys_are_never_overwritten(tmp_path):
    make_server_keys(tmp_path)
    secret = (tmp_path / "server.secret").read_text()
    with pytest.raises(InvalidInput, match="never overwritten"):
        make_server_keys(tmp_path)
    assert (tmp_path / "server.secret").read_text() == secret


@pytest.mark.parametrize("name", ["", "../x", "a b", "server", "-x", "x" * 65, "ä", 'a"'])
def test_wrong_names_are_refused(tmp_path, name):
    with pytest.raises(InvalidInput, match="name"):
        make_client_keys(name, tmp_path)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("bits", [0o640, 0o604, 0o660, 0o644, 0o601])
def test_a_secret_that_others_may_read_is_refused(tmp_path, bits):
    make_client_keys("alice", tmp_path)
    (tmp_path / "alice.secret").chmod(bits)
    with pytest.raises(KeyFileError, match="owner alone"):
        SecretKey.load(tmp_path / "alice.secret")
    with pytest.raises(ClientInvalidInput, match="owner alone"):
        Keys.load(tmp_path / "alice.secret", KEY)


@pytest.mark.parametrize(
    "text",
    ["", KEY, f"mesh-motion-public {KEY}", f"mesh-motion-public {KEY[:-1]} a", f"mesh-motion-secret {KEY} a", "\xff"],
)
def test_files_without_a_public_key_are_refused(tmp_path, text):
    path = tmp_path / "key"
    path.write_bytes(text.encode("latin-1"))
    with pytest.raises(KeyFileError) as error:
        PublicKey.load(path)
    assert KEY not in str(error.value)  # it might be a secret that was taken for a public key


@pytest.mark.parametrize("key", ALL)
def test_every_character_of_a_key_survives_both_files(tmp_path, key):
    PublicKey("a", key).save(tmp_path / "a.public")
    assert PublicKey.load(tmp_path / "a.public").key == key
    write_entries(tmp_path / "allow.toml", {key: Entry("a")})
    assert read_entries(tmp_path / "allow.toml") == {key: Entry("a")}


def test_admit_and_revoke(tmp_path):
    make_server_keys(tmp_path)
    alice = make_client_keys("alice", tmp_path / "c")
    assert admit(str(tmp_path / "c" / "alice.public"), tmp_path) == Entry("alice", ("owner",))
    assert admit(KEY, tmp_path, name="eye", roles=["monitor", "admin", "monitor"]) == Entry("eye", ("monitor", "admin"))
    assert admit(alice.key, tmp_path, name="alice", roles=["admin"]).roles == ("admin",)
    assert set(read_list(tmp_path)) == {alice.key, KEY}
    with pytest.raises(InvalidInput, match="name of another key"):
        admit(OTHER, tmp_path, name="eye")
    with pytest.raises(InvalidInput, match="role must be one of"):
        admit(OTHER, tmp_path, name="x", roles=["root"])
    with pytest.raises(InvalidInput, match="cannot be read"):
        admit("missing.public", tmp_path)
    assert revoke("eye", tmp_path).name == "eye"
    with pytest.raises(InvalidInput, match="names alice"):
        revoke("eye", tmp_path)
    assert revoke(alice.key, tmp_path).name == "alice"
    assert read_list(tmp_path) == {}


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("keys = 1", "table \\[keys\\]"),
        ("", "table \\[keys\\]"),
        ("[keys]\n[more]", "more"),
        ("[keys", "TOML"),
        ('[keys]\n"abc" = { name = "a", roles = ["owner"] }', "40 characters"),
        (f'[keys]\n"{KEY}" = "alice"', "name = "),
        (f'[keys]\n"{KEY}" = {{ name = "alice" }}', "name = "),
        (f'[keys]\n"{KEY}" = {{ name = "alice", roles = [] }}', "must be some of owner"),
        (f'[keys]\n"{KEY}" = {{ name = "alice", roles = ["root"] }}', "must be some of owner"),
        (f'[keys]\n"{KEY}" = {{ name = "alice", roles = "owner" }}', "must be some of owner"),
        (f'[keys]\n"{KEY}" = {{ name = "a b", roles = ["owner"] }}', "a name must be"),
        (f'[keys]\n"{KEY}" = {{ name = "alice", roles = ["owner"], until = 1 }}', "name = "),
        (f'[keys]\n"{KEY}" = {ALICE}\n"{OTHER}" = {ALICE}', "two keys"),
        ("#" * ((1 << 20) + 1), "at most"),
    ],
)  # fmt: skip
def test_a_wrong_allow_list_admits_no_key(tmp_path, text, says):
    path = tmp_path / "allow.toml"
    path.write_text(text)
    path.chmod(0o644)
    with pytest.raises(InvalidInput, match=says):
        read_entries(path)
    with pytest.raises(SessionError, match="no key is admitted") as error:
        AllowList(path).roles(KEY)
    assert error.value.code == "UNAVAILABLE"


def test_a_change_is_seen_at_the_next_question(tmp_path):
    path = tmp_path / "allow.toml"
    write_entries(path, {})
    allow_list = AllowList(path)
    for round_ in range(20):  # faster than any clock of a file system ticks
        entries = {KEY: Entry("alice", ("owner",) if round_ % 2 else ("admin",))}
        write_entries(path, entries)
        assert allow_list.roles(KEY) == entries[KEY].roles
        assert (allow_list.name(KEY), allow_list.name(OTHER)) == ("alice", OTHER)
        path.write_text("[keys]\n")
        assert allow_list.roles(KEY) == ()


def test_an_unchanged_list_is_not_read_again(tmp_path, monkeypatch):
    path = tmp_path / "allow.toml"
    write_entries(path, {KEY: Entry("alice")})
    hour_ago = time.time() - 3600
    os.utime(path, (hour_ago, hour_ago))
    allow_list = AllowList(path)
    assert allow_list.roles(KEY) == ("owner",)
    monkeypatch.setattr("mesh_motion_server.security.allow_list.read_entries", None)
    assert allow_list.roles(KEY) == ("owner",)


def test_without_keys_everybody_is_one_owner():
    assert Everybody().roles("") == ("owner",)
    assert Everybody().roles(KEY) == ()


def test_the_environment_names_a_clients_keys(tmp_path, monkeypatch):
    monkeypatch.delenv("MESH_MOTION_KEY", raising=False)
    monkeypatch.delenv("MESH_MOTION_SERVER_KEY", raising=False)
    assert Keys.from_environment() is None
    make_client_keys("alice", tmp_path)
    monkeypatch.setenv("MESH_MOTION_KEY", str(tmp_path / "alice.secret"))
    with pytest.raises(ClientInvalidInput, match="both, or neither"):
        Keys.from_environment()
    monkeypatch.setenv("MESH_MOTION_SERVER_KEY", KEY)
    keys = Keys.from_environment()
    assert (keys.name, keys.server) == ("alice", KEY)
    assert keys.secret not in repr(keys)


def test_without_curve_it_says_so(tmp_path, monkeypatch):
    monkeypatch.setattr(zmq, "has", lambda feature: False)
    with pytest.raises(InvalidInput, match="built without"):
        key_folder.make_server_keys(tmp_path)
    with pytest.raises(ClientInvalidInput, match="built without"):
        Keys("alice", KEY, KEY).protect(None)
