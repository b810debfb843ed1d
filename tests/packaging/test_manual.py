"""The manual pages agree with the commands, and every example of a command works unchanged."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from bare_environment import ROOT
from mesh_motion_client import Mesh, Patch, connect
from page_story import free_port

from tools.manual_pages import FOLDER, commands, examples, pages

#: Shown lines that are not run here, and why.
ELSEWHERE = {
    "mesh-motion plot ~/.local/state/mesh-motion/sessions/0123… -o mesh.png --show mesh --size page": "pictures",
    "mesh-motion conform --endpoint tcp://127.0.0.1:7440 --quiet": "the whole suite: tests/conformance",
    'mesh-motion conform --client "python -m mesh_motion_client.conformance"': "the whole suite: tests/conformance",
    "mesh-motion demo --out out/demo": "is what tests/cases/test_demo.py runs",
}
SHOWN = [line for command in commands().values() for line in examples(command.help) if line not in ELSEWHERE]


def _square(count: int) -> str:
    """A Gmsh file of a square of triangles, enough of them for as many partitions as an example shows."""
    number = np.arange(1, count * count + 1).reshape(count, count)
    low, right, top, over = (
        part.ravel() for part in (number[:-1, :-1], number[1:, :-1], number[:-1, 1:], number[1:, 1:])
    )
    cells = np.concatenate([np.stack([low, right, over], axis=1), np.stack([low, over, top], axis=1)])
    nodes = [f"{k} {x} {y} 0" for k, (x, y) in enumerate(np.ndindex(count, count), start=1)]
    wall = f"1 1 2 1 1 {number[0, 0]} {number[1, 0]}"
    elements = [wall, *(f"{k} 2 2 2 2 {a} {b} {c}" for k, (a, b, c) in enumerate(cells.tolist(), start=2))]
    parts = {"MeshFormat": ["2.2 0 8"], "PhysicalNames": ["1", '1 1 "wall"'], "Nodes": [str(len(nodes)), *nodes],
             "Elements": [str(len(elements)), *elements]}  # fmt: skip
    return "".join("\n".join([f"${name}", *lines, f"$End{name}", ""]) for name, lines in parts.items())


def test_the_pages_are_those_of_the_commands() -> None:
    written = {path.name: path.read_text(encoding="utf-8") for path in FOLDER.iterdir()}
    assert written == pages(), "run `make manual`"


@pytest.mark.skipif(shutil.which("man") is None or shutil.which("groff") is None, reason="man is not installed")
def test_man_shows_them_without_a_warning() -> None:
    for page in FOLDER.iterdir():
        shown = subprocess.run(
            ["man", "--warnings", "-E", "UTF-8", "-l", "-Tutf8", "-Z", str(page)], capture_output=True, check=False
        )
        assert (shown.returncode, shown.stderr) == (0, b""), page.name


def test_every_command_shows_an_example() -> None:
    assert [name for name, command in commands().items() if not examples(command.help)] == []


def _su2(points: np.ndarray, triangles: np.ndarray) -> str:
    cells = [f"5 {a} {b} {c}" for a, b, c in triangles]
    nodes = [f"{x!r} {y!r}" for x, y in points.tolist()]
    lines = ["NDIME= 2", f"NELEM= {len(cells)}", *cells, f"NPOIN= {len(nodes)}", *nodes, "NMARK= 0"]
    return "\n".join([*lines, ""])


@pytest.fixture(scope="module")
def shell(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Shell]:
    """A folder with the files of the examples, and a server at their endpoint."""
    shell = Shell(tmp_path_factory.mktemp("shown"))
    for line in ("mesh-motion keys client alice .", "mesh-motion keys client dashboard ."):
        assert shell.run(line) == ""
    server = shell.serve("mesh-motion serve --endpoint tcp://127.0.0.1:7440")
    shell.commit_a_step()
    for name in ("flag", "standard", "corrected"):  # results of a play
        (shell.folder / "out").mkdir(exist_ok=True)
        (shell.folder / "out" / name).symlink_to("rotation")
    with np.load(shell.folder / "mesh.npz") as file:
        np.save(shell.folder / "out" / "points.npy", file["points"])
        (shell.folder / "mesh.su2").write_text(_su2(file["points"], file["cells_triangle"]))
    yield shell
    shell.stop(server)


class Shell:
    def __init__(self, folder: Path) -> None:
        self.folder = folder
        (folder / "bin").mkdir()
        program = folder / "bin" / "mesh-motion"
        program.write_text(f'#!/bin/sh\nexec {sys.executable} -m mesh_motion_server "$@"\n')
        program.chmod(0o755)
        (folder / "bin" / "python").symlink_to(sys.executable)
        (folder / "examples").symlink_to(ROOT / "examples")
        for name in ("case.toml", "mesh.npz"):
            shutil.copy(ROOT / "examples" / "thesis_rotation" / name, folder)
        (folder / "mesh.msh").write_text(_square(8))
        self.session = ""
        self._ports = {port: str(free_port()) for port in ("7440", "9464")}
        self._environment = os.environ | {"HOME": str(folder), "PATH": f"{folder / 'bin'}:{os.environ['PATH']}"}

    def commit_a_step(self) -> None:
        """A stored session, which the examples look into."""
        with np.load(self.folder / "mesh.npz") as file:
            patches = {"block": Patch("moving", file["patch_block"]), "outer": Patch("fixed", file["patch_outer"])}
            mesh = Mesh(file["points"], {"triangle": file["cells_triangle"]}, patches)
        with connect(f"tcp://127.0.0.1:{self._ports['7440']}") as server, server.open(mesh) as session:
            session.move(np.full((len(session.moving_nodes), 2), 0.01))
            session.commit()
            self.session = session.credentials.session

    def _line(self, line: str) -> str:
        # the port that the examples ask is served by one server, where one session has one step
        line = line.replace("0.0.0.0:7440", "127.0.0.1:0")
        for session in ("0123456789abcdef0123456789abcdef", "0123…"):
            line = line.replace(session, self.session)
        for shown, used in (*self._ports.items(), ("--step 1234", "--step 1"), ("/run/user/1000", str(self.folder))):
            line = line.replace(shown, used)
        return line.replace("python -m", f"{sys.executable} -m")

    def run(self, line: str) -> str:
        command, at = ["sh", "-c", self._line(line)], {"cwd": self.folder, "env": self._environment}
        ended = subprocess.run(command, **at, capture_output=True, text=True, check=False)
        return "" if ended.returncode == 0 else f"{line}: {ended.stdout[-2000:]}{ended.stderr}"

    def serve(self, line: str) -> subprocess.Popen[str]:
        process = subprocess.Popen(
            f"exec {self._line(line)}",
            shell=True,
            cwd=self.folder,
            env=self._environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
        )
        assert process.stdout.readline().startswith("ready "), line
        return process

    def stop(self, process: subprocess.Popen[str]) -> None:
        process.terminate()
        assert process.wait(60) == 0
        process.stdout.close()


@pytest.mark.nightly
@pytest.mark.timeout(1200)  # the demo, a proof and more, on a machine that may be busy
def test_every_example_works(shell: Shell) -> None:
    complaints = []
    for line in dict.fromkeys(SHOWN):
        if line.split()[1] == "serve":
            # the default endpoint and state are in use
            own = "" if "--endpoint" in line else " --endpoint tcp://127.0.0.1:0"
            own += "" if "--state" in line else " --state other"
            shell.stop(shell.serve(line + own))
        else:
            complaints.append(shell.run(line))
    assert list(filter(None, complaints)) == []
