"""The first mistakes of new users: each answer names the offender, the expected value, and a way out.

A table of mistakes and their answers: no unrelated traceback, and no long wait.
"""

import re
import socket
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mesh_motion_client import Credentials, Keys, Mesh, MeshMotionError, Patch, Server, Session, connect

from mesh_motion_server.commands.cli import main

ROTATION = Path(__file__).parents[2] / "examples" / "thesis_rotation"
with np.load(ROTATION / "mesh.npz") as _file:
    POINTS, CELLS = _file["points"], _file["cells_triangle"]
    BLOCK, OUTER = _file["patch_block"], _file["patch_outer"]
ROWS = len(np.unique(BLOCK))


def mesh(points: Any = POINTS, cells: Any = None, patches: Any = None) -> Mesh:
    patches = {"block": Patch("moving", BLOCK), "outer": Patch("fixed", OUTER)} if patches is None else patches
    return Mesh(points, {"triangle": CELLS} if cells is None else cells, patches)


# --- what is wrong before a server is asked --------------------------------------------------------------------------

MESHES: dict[str, tuple[Callable[[], Any], str]] = {
    "cells of floats": (lambda: mesh(cells={"triangle": CELLS.astype(float)}), r"whole numbers.*float64.*astype"),
    "cells counted from 1": (lambda: mesh(cells={"triangle": CELLS + 1}), r"0 … 722, got 723 in row 205.*count from 0"),
    "cells in one line": (lambda: mesh(cells={"triangle": CELLS.ravel()}), r"shape \(m, 3\), got \(4026,\)"),
    "a cell type of another tool": (lambda: mesh(cells={"tri": CELLS}), r"triangle, quad, .*got 'tri'"),
    "cells without a type": (lambda: mesh(cells=CELLS), r"cells must be a dict.*shape \(1342, 3\).*cells=\{"),
    "a patch without a role": (lambda: mesh(patches={"b": BLOCK}), r"patch 'b' must be a Patch.*Patch\('moving'"),
    "a patch as a pair": (
        lambda: mesh(patches={"b": ("moving", 1)}),
        r"patch 'b' must be a Patch, got \('moving', 1\)",
    ),
    "patches as a list": (lambda: mesh(patches=[BLOCK]), r"patches must be a dict, name → Patch"),
    "a patch without a name": (lambda: mesh(patches={"": Patch("fixed", OUTER)}), r"name must be a text.*got ''"),
    "a role of another code": (lambda: Patch("wall", BLOCK), r"one of moving, fixed, slip.*got 'wall'"),
    "role and nodes changed over": (
        lambda: Patch(BLOCK, "moving"),
        r"role must be.*shape \(\d+,\).*Patch\(role, nodes\)",
    ),
    "a mask for the nodes": (lambda: Patch("moving", POINTS[:, 0] > 0), r"got dtype bool.*flatnonzero"),
    "a patch beyond the mesh": (
        lambda: mesh(patches={"b": Patch("fixed", [723])}),
        r"patch 'b' must name nodes 0 … 722",
    ),
    "a plane mesh in space": (lambda: mesh(np.c_[POINTS, 0 * POINTS[:, 0]]), r"points \(723, 3\).*points\[:, :2\]"),
    "points lying down": (lambda: mesh(POINTS.T), r"\(n, 2\) or \(n, 3\).*got \(2, 723\)"),
    "no point": (
        lambda: mesh(np.where(POINTS > 0.999, np.nan, POINTS)),
        r"points must be finite, got nan in row",
    ),
    "a path for an endpoint": (
        lambda: connect("/tmp/socket"),
        r"tcp://HOST:PORT.*got '/tmp/socket'.*ipc:///tmp/socket",
    ),
    "an endpoint without tcp": (lambda: connect("localhost:7440"), r"got 'localhost:7440'.*tcp://localhost:7440 is"),
    "an endpoint as in a browser": (lambda: connect("http://127.0.0.1:7440"), r"tcp://127.0.0.1:7440 is that port"),
    "a port that cannot be": (lambda: connect("tcp://localhost:99999"), r"tcp://HOST:PORT.*:99999'.*1 to 65535"),
    "no port": (lambda: connect("tcp://localhost:0"), r"tcp://HOST:PORT.*:0'.*1 to 65535"),
    "letters in a port": (lambda: connect("tcp://localhost:7440x"), r"tcp://HOST:PORT.*got 'tcp://localhost:7440x'"),
    "another transport": (lambda: connect("inproc://control"), r"tcp://HOST:PORT.*got 'inproc://control'"),
    "a port alone": (lambda: connect(7440), r"got 7440"),  # type: ignore[arg-type]
    "no server": (lambda: connect("tcp://127.0.0.1:1", timeout=0.2), r"no server answers at.*mesh-motion serve"),
    "keys that are not there": (lambda: Keys.load("a.secret", "s.public"), r"a\.secret: cannot be read: No such file"),
}


def assert_refused(do: Callable[..., Any], words: str, *whose: Any) -> None:
    with pytest.raises(MeshMotionError) as error:
        do(*whose)
    assert re.search(words, str(error.value)), error.value


@pytest.mark.parametrize("name", MESHES)
def test_before_a_server_is_asked(name: str) -> None:
    assert_refused(*MESHES[name])


# --- what is wrong with a session ------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def session(server: Server) -> Iterator[Session]:
    with server.open(mesh(), {"support_radius": 0.5}) as session:
        yield session


def two_holders(server: Server) -> None:
    """The first client continues after another one has resumed the session."""
    first = server.open(mesh(), {"support_radius": 0.5})
    try:
        with server.resume(first.credentials):
            first.move(np.zeros((ROWS, 2)))
    finally:
        first.close()


def after_close(server: Server, then: Callable[[Session], Any]) -> None:
    session = server.open(mesh(), {"support_radius": 0.5})
    session.close()
    then(session)


OPENS: dict[str, tuple[Callable[[Server], Any], str]] = {
    "no patch moves": (
        lambda s: s.open(mesh(patches={"b": Patch("fixed", BLOCK)})),
        r"'moving' \(patches: 'b'\).*give it",
    ),
    "nodes in another order": (lambda s: s.open(mesh(points=POINTS[::-1])), r"cell \d+ .*inverted or degenerate"),
    "a misspelt setting": (lambda s: s.open(mesh(), {"suport_radius": 1}), r"'suport_radius'.*mean 'support_radius'"),
    "no such level": (lambda s: s.open(mesh(), durability="fast"), r"'full', 'replay', 'relaxed', got 'fast'"),
    "parts without numbers": (lambda s: s.open(mesh(), partitions=2), r"must have global_ids"),
    "two holders": (two_holders, r"resumed by another holder"),
    "move after close": (
        lambda s: after_close(s, lambda x: x.move(np.zeros((ROWS, 2)))),
        r"session is closed.*server\.resume",
    ),
    "commit after close": (lambda s: after_close(s, lambda x: x.commit()), r"session is closed"),
    "no session": (
        lambda s: s.resume(Credentials("0" * 32, bytes(32))),
        r"no session '0000.*check the session id",
    ),
}


@pytest.mark.parametrize("name", OPENS)
def test_when_a_session_is_opened_or_left(server: Server, name: str) -> None:
    assert_refused(*OPENS[name], server)


MOVES: dict[str, tuple[Callable[[Session], Any], str]] = {
    "three coordinates in a plane": (lambda s: s.move(np.zeros((ROWS, 3))), r"shape \(12, 2\).*got \(12, 3\)"),
    "a row for every node": (
        lambda s: s.move(np.zeros((723, 2))),
        r"one row for each moving node, got \(723, 2\).*moving_nodes",
    ),
    "rows lying down": (lambda s: s.move(np.zeros((2, ROWS))), r"got \(2, 12\)"),
    "not a number": (
        lambda s: s.move(np.full((ROWS, 2), np.nan)),
        r"finite, got nan in row 0.*the solver that sent it",
    ),
    "dates": (lambda s: s.move(np.zeros((ROWS, 2), "M8[s]")), r"must be numbers: they are datetime64\[s\]"),
    "text": (lambda s: s.move(np.full((ROWS, 2), "0")), r"must be numbers: they are <U1"),
    "complex numbers": (lambda s: s.move(np.zeros((ROWS, 2), complex)), r"must be numbers: they are complex"),
    "words": (lambda s: s.move("left"), r"must be numbers: they are <U4"),
    "a patch misspelt": (lambda s: s.move({"blok": np.zeros((ROWS, 2))}), r"\['block'\], got \['blok'\]"),
    "another unit": (lambda s: s.move(np.full((ROWS, 2), -100.0)), r"no valid mesh.*no tested fraction"),
    "no such frame": (
        lambda s: s.move(np.zeros((ROWS, 2)), frame="total"),
        r"'committed', 'reference', got 'total'",
    ),  # type: ignore[arg-type]
    "commit without a move": (lambda s: s.commit(), r"no trial to commit \(send MOVE first\)"),
    "points of what": (lambda s: s.points("now"), r"'committed', 'reference', got 'now'"),  # type: ignore[arg-type]
}


@pytest.mark.parametrize("name", MOVES)
def test_within_a_session(session: Session, name: str) -> None:
    assert_refused(*MOVES[name], session)


def test_narrow_and_whole_numbers_are_taken(session: Session) -> None:
    for kind in (np.float32, np.int64):
        assert session.move(np.zeros((ROWS, 2), kind)).displacement.shape == (723, 2)
    session.rollback()


def test_a_closed_server_raises_at_once() -> None:
    server = connect()
    server.close()
    with pytest.raises(MeshMotionError, match="connection to the server is closed"):
        server.open(mesh())


# --- the command line ------------------------------------------------------------------------------------------------

LINES: dict[str, tuple[str, int, str]] = {
    "a case that is not there": ("play none.toml -o out", 2, r"none\.toml: the case file cannot be read: No such file"),
    "a mesh that is not there": ("check none.msh", 2, r"none\.msh: no such mesh file"),
    "a picture for a mesh": ("check mesh.png", 2, r"mesh\.png.*\.msh"),
    "a folder for a case": ("play . -o out", 2, r"\.toml|directory|folder"),
    "a mesh for a case": ("play mesh.npz -o out", 2, r"mesh\.npz: not a TOML file"),
    "no such folder of sessions": ("inspect nowhere", 2, r"nowhere: .*folder"),
    "a file where results go": ("play case.toml -o case.toml", 4, r"case\.toml"),
    "no server": ("inspect --endpoint tcp://127.0.0.1:1 --timeout 0.2", 69, r"no server answers.*mesh-motion serve"),
    "a path to inspect at": ("inspect --endpoint /tmp/socket --timeout 0.2", 2, r"ipc:///tmp/socket is"),
    "a port in use": ("serve --endpoint tcp://127.0.0.1:{taken} --state state", 69, r"{taken}.*in use"),
    "a path to serve at": ("serve --endpoint /tmp/socket --state state", 78, r"got '/tmp/socket'"),
    "no folder of keys": ("serve --keys nowhere --state state", 78, r"nowhere.*mesh-motion keys server"),
    "settings that are none": ("serve --settings case.toml --state state", 78, r"case\.toml: unknown setting"),
}


@pytest.fixture(scope="module")
def taken() -> Iterator[int]:
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        yield int(other.getsockname()[1])


@pytest.mark.parametrize("name", LINES)
def test_at_the_command_line(
    name: str, taken: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    line, status, words = LINES[name]
    for file in ROTATION.glob("*.[nt]*"):
        (tmp_path / file.name).write_bytes(file.read_bytes())
    (tmp_path / "mesh.png").write_bytes(b"\x89PNG\r\n\x1a\n")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["mesh-motion", *line.replace("{taken}", str(taken)).split()])
    with pytest.raises(SystemExit) as ended:
        main()
    error = capfd.readouterr().err
    assert ended.value.code == status, error
    assert "Traceback" not in error
    assert re.search(words.replace("{taken}", str(taken)), error), error


def test_there_are_forty() -> None:
    assert len(MESHES) + len(OPENS) + len(MOVES) + len(LINES) >= 40
