import errno
import io
import os
from pathlib import Path

import pytest
from mesh_motion_client import Mesh, Patch, Server, Unavailable, connect
from mesh_motion_protocol.errors import InvalidInput

from mesh_motion_server.cases.inspect import inspect_folder, list_sessions
from mesh_motion_server.files import read_mesh
from mesh_motion_server.session import inspection
from mesh_motion_server.watch.terminal.console import console


def client_mesh(path: Path) -> Mesh:
    mesh = read_mesh(path)
    roles = {"block": "moving", "outer": "fixed"}
    return Mesh(mesh.points, mesh.cells, {name: Patch(roles[name], nodes) for name, nodes in mesh.patches.items()})


def test_the_sessions_of_a_server_are_listed(make_case, server: Server) -> None:
    with server.open(client_mesh(make_case().parent / "mesh.npz"), label="of a test") as session:
        found = list_sessions(server.endpoint, 10.0)
        listed = [s["label"] for s in found.values["sessions"]]  # tests that share the server may leave sessions
        assert listed.count("of a test") == 1
        assert found.table.row_count == len(listed)
        session.close("discard")


def test_no_server_at_the_endpoint(tmp_path: Path) -> None:
    with pytest.raises(Unavailable, match="no server answers"):
        list_sessions(f"ipc://{tmp_path}/no-server", 0.2)


def test_stored_sessions_are_judged(make_case, tmp_path: Path) -> None:
    state = tmp_path / "state"
    with connect(state=state) as server:
        server.open(client_mesh(make_case().parent / "mesh.npz"), label="kept").close("keep")
    found = inspect_folder(state)
    assert [(s["label"], s["state"], s["step"]) for s in found.values["sessions"]] == [("kept", "whole", 0)]
    assert found.damaged == []
    [folder] = (state / "sessions").iterdir()
    assert inspect_folder(folder).values["session"] == folder.name
    data = bytearray((folder / "mesh.bin").read_bytes())
    data[len(data) // 2] ^= 1
    (folder / "mesh.bin").write_bytes(data)
    assert inspect_folder(state).damaged == [folder.name]
    assert inspect_folder(folder).damaged == [folder.name]


def test_one_damaged_session_hides_no_other_and_is_named(make_case, tmp_path: Path) -> None:
    state = tmp_path / "state"
    with connect(state=state) as server:
        for label in ("lost", "damaged", "whole"):
            server.open(client_mesh(make_case().parent / "mesh.npz"), label=label).close("keep")
    found = {s["label"]: s for s in inspect_folder(state).values["sessions"]}
    lost, damaged = (Path(found[label]["folder"]) for label in ("lost", "damaged"))
    (lost / "spec.json").unlink()
    raw = (damaged / "spec.json").read_bytes()
    (damaged / "spec.json").write_bytes(raw.replace(b'"dimension"', b'"dimensioo"'))
    after = inspect_folder(state)
    assert sorted(after.damaged) == sorted([lost.name, damaged.name])
    assert [s["label"] for s in after.values["sessions"] if s["state"] == "whole"] == ["whole"]
    for folder, reason in ((lost, "No such file"), (damaged, "does not match its digest")):
        (check,) = (c for c in inspect_folder(folder).values["checks"] if not c["passed"])
        assert check["name"] == "spec"
        assert reason in check["message"]


def test_a_long_label_shortens_no_session_id(make_case, tmp_path: Path) -> None:
    state = tmp_path / "state"
    with connect(state=state) as server:
        server.open(client_mesh(make_case().parent / "mesh.npz"), label="x" * 200).close("keep")
        listed = list_sessions(server.endpoint, 10.0)
    [folder] = (state / "sessions").iterdir()
    for found in (listed, inspect_folder(state)):
        shown = console(width=80, file=io.StringIO())
        shown.print(found.table)
        assert folder.name in shown.file.getvalue()


def test_what_is_no_session_among_sessions_hides_none(
    make_case, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    state = tmp_path / "state"
    with connect(state=state) as server:
        server.open(client_mesh(make_case().parent / "mesh.npz"), label="kept").close("keep")
    [kept] = (state / "sessions").iterdir()
    (state / "sessions" / f"{1:032x}").write_text("no folder")
    os.mkfifo(state / "sessions" / f"{2:032x}")
    (state / "sessions" / f"{3:032x}").symlink_to(tmp_path / "nothing")
    alone = state / "sessions" / f"{4:032x}"
    alone.mkdir()
    (alone / "spec.json").write_bytes((kept / "spec.json").read_bytes())  # it names the other session
    found = inspect_folder(state)
    assert [(s["label"], s["state"]) for s in found.values["sessions"]] == [("kept", "damaged"), ("kept", "whole")]
    assert found.damaged == [alone.name]
    looked = inspection.is_missing

    def denied(path: Path) -> bool:
        if path.parent == alone:
            raise PermissionError(errno.EACCES, "Permission denied", str(path))
        return looked(path)

    monkeypatch.setattr(inspection, "is_missing", denied)
    assert inspect_folder(state).damaged == [alone.name]


def test_any_other_folder_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InvalidInput, match="neither a session's folder nor"):
        inspect_folder(tmp_path)
    with pytest.raises(InvalidInput, match="neither"):
        inspect_folder(tmp_path / "none")
