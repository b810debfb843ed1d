"""The client's distribution: its content, and its page, README.md, which is correct without the server's package."""

import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from email.parser import Parser
from pathlib import Path
from zipfile import ZipFile

import pytest
from bare_environment import ROOT, build, names_in, tracked, unpacked

from mesh_motion_server import __version__
from tests.faults.server_process import ServerProcess
from tools.wheel import client_example

FOLDER = Path("adapters/python")
PACKAGES = ("mesh_motion_client", "mesh_motion_protocol")


def files() -> set[str]:
    return {str(Path(name).relative_to(FOLDER)) for name in tracked() if Path(name).is_relative_to(FOLDER)}


def test_the_wheel_is_for_any_platform_and_has_each_file_of_its_packages(client_wheel: Path) -> None:
    assert client_wheel.name == f"mesh_motion_client-{__version__}-py3-none-any.whl"
    own = {name for name in names_in(client_wheel) if ".dist-info/" not in name}
    assert own == {name for name in files() if name.startswith(PACKAGES)}
    assert {f"{package}/py.typed" for package in PACKAGES} <= own


def test_it_requires_three_packages_and_has_the_project_s_licence(client_wheel: Path) -> None:
    about = f"mesh_motion_client-{__version__}.dist-info"
    with ZipFile(client_wheel) as archive:
        metadata = Parser().parsestr(archive.read(f"{about}/METADATA").decode())
        assert archive.read(f"{about}/licenses/LICENSE") == (ROOT / "LICENSE").read_bytes()
    required = [line for line in metadata.get_all("Requires-Dist") if "extra ==" not in line]
    assert sorted(line.partition(">")[0] for line in required) == ["msgpack", "numpy", "pyzmq"]
    assert metadata["Version"] == __version__


@pytest.mark.parametrize(
    ("kind", "tree"),
    [("wheel", "a checkout"), ("editable", "a checkout"), ("wheel", "an archive"), ("wheel", "a source distribution")],
)
def test_pip_installs_the_parts_from_a_checkout_or_its_archive(kind: str, tree: str, tmp_path: Path) -> None:
    root = ROOT if tree == "a checkout" else tmp_path / "tree"
    for name in tracked() if root != ROOT else ():  # as `git archive` has them: without .git
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(ROOT / name, root / name)
    if tree == "a source distribution":
        (root / "PKG-INFO").touch()
    hook = f"import build_backend; print(build_backend.prepare_metadata_for_build_{kind}({str(tmp_path)!r}))"
    kernels = os.environ | {"PYTHONPATH": str(root / "numerics" / "kernels"), "PIP_BUILD_TRACKER": str(tmp_path)}
    done = subprocess.run(
        [sys.executable, "-c", hook], cwd=root, env=kernels, check=True, capture_output=True, text=True
    )
    metadata = Parser().parsestr((tmp_path / done.stdout.split()[-1] / "METADATA").read_text(encoding="utf-8"))
    from_folders = kind == "wheel" and tree != "a source distribution"
    for part, folder in (("mesh-motion-client", FOLDER), ("mesh-motion-numerics", "numerics")):
        where = f" @ {(root / folder).as_uri()}" if from_folders else f"=={__version__}"
        assert f"{part}{where}" in metadata.get_all("Requires-Dist")


def test_its_sources_alone_build_the_same_wheel(client_wheel: Path, tmp_path: Path) -> None:
    sources = unpacked(build("sdist", tmp_path, ROOT / FOLDER), tmp_path / "unpacked")
    assert {str(path.relative_to(sources)) for path in sources.rglob("*") if path.is_file()} == {*files(), "PKG-INFO"}
    assert build("wheel", tmp_path / "again", sources).read_bytes() == client_wheel.read_bytes()


def test_the_program_of_its_page_moves_a_mesh_where_the_server_is_not_installed(
    client_alone: Callable, tmp_path: Path
) -> None:
    with ServerProcess(tmp_path) as server:
        ended = client_alone("python", "-c", client_example(ROOT), server.endpoint)
    assert ended.stdout == "(45, 2) 0\n", ended.stderr


def test_a_call_that_needs_another_package_names_it(client_alone: Callable) -> None:
    mesh = "m.Mesh([[0.0], [1.0]], {'line': [[0, 1]]}, {'a': m.Patch('moving', [0, 1])})"
    server, ranks = "mesh-motion-server[server]", "mesh-motion-client[ranks]"
    for call, package in (("m.connect()", server), (f"Volume({mesh})", ranks), ("m.Mesh.load(m.__file__, {})", server)):
        program = f"import mesh_motion_client as m; from mesh_motion_client.volume import Volume; {call}"
        last = client_alone("python", "-c", program).stderr.splitlines()[-1]
        assert f"pip install '{package}'" in last, last


def test_it_is_imported_on_a_system_without_fork_and_fcntl(client_alone: Callable) -> None:
    """As on Windows."""
    program = "import os, sys, numpy, zmq; del os.register_at_fork; sys.modules['fcntl'] = None; "
    program += "sys.platform = 'win32'; "
    ended = client_alone("python", "-c", program + "import mesh_motion_client, mesh_motion_protocol.codec")
    assert ended.returncode == 0, ended.stderr
