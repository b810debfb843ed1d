"""Each extra alone: a command that needs more says which extra to install."""

import subprocess
import sys
import tomllib
from collections.abc import Callable
from pathlib import Path

import pytest
from bare_environment import ROOT

from mesh_motion_server.commands.outcome import ExitStatus
from mesh_motion_server.extras import extra_of, not_installed

Run = Callable[..., subprocess.CompletedProcess[str]]
Installed = Callable[..., Run]
EXTRAS = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["optional-dependencies"]
ROTATION = ROOT / "examples" / "thesis_rotation" / "case.toml"
#: Those without which the command line does not start.
WITHOUT_SERVER = sorted(set(EXTRAS) - {"server", "all", "dev"})


def asks_for_extra(run: subprocess.CompletedProcess[str], extra: str) -> None:
    """Status 69 and one line that names the extra."""
    assert run.returncode == ExitStatus.UNAVAILABLE, run.stderr
    assert run.stderr.count("\n") == 1, run.stderr
    assert f"mesh-motion-server[{extra}]" in run.stderr


@pytest.mark.nightly
def test_the_base_is_what_needs_no_server(installed: Installed) -> None:
    run = installed()
    parts = "mesh_motion_client, mesh_motion_protocol, mesh_motion_conformance, mesh_motion_fsi, mesh_motion_kratos"
    ended = run("python", "-c", f"import {parts}, mesh_motion_calculix, mesh_motion_precice; import mesh_motion_server")
    assert ended.returncode == 0, ended.stderr
    assert run("python", "-c", "import pydantic").returncode == 1
    assert "mesh_motion_conformance" in run("python", "-m", "mesh_motion_conformance", "--help").stdout
    assert run("mesh-motion-precice", "--help").returncode == 0


@pytest.mark.nightly
def test_without_a_server_the_client_says_what_to_install(installed: Installed) -> None:
    ended = installed()("python", "-c", "import mesh_motion_client as m; m.connect()")
    assert "mesh-motion-server[server]" in ended.stderr.splitlines()[-1]


@pytest.mark.nightly
@pytest.mark.parametrize("extras", [[], WITHOUT_SERVER], ids=["none", "all but the server's"])
def test_no_command_starts_without_the_server_and_each_says_so(installed: Installed, extras: list[str]) -> None:
    run = installed(*extras)
    for arguments in (["serve"], ["--help"], ["play", "case.toml", "--out", "out"]):
        asks_for_extra(run("mesh-motion", *arguments), "server")


@pytest.mark.nightly
def test_the_server_alone_plays_and_says_what_is_missing_for_more(installed: Installed, tmp_path: Path) -> None:
    run = installed("server")
    assert run("mesh-motion", "version").returncode == 0
    played = run("mesh-motion", "play", ROTATION, "--out", "out")
    assert played.returncode == 0, played.stderr
    assert "mesh-motion-server[plot]" in played.stderr
    assert "0 inverted cells" in played.stdout
    (tmp_path / "mesh.cgns").write_bytes(b"\x89HDF\r\n\x1a\n")
    asks_for_extra(run("mesh-motion", "check", tmp_path / "mesh.cgns"), "mesh")


@pytest.mark.nightly
def test_an_installation_conforms(installed: Installed) -> None:
    run = installed("server")
    conformed = run("mesh-motion", "conform", "--client", "python -m mesh_motion_client.conformance", "--only", "18.1")
    assert conformed.returncode == 0, conformed.stdout + conformed.stderr


@pytest.mark.nightly
def test_with_pictures(installed: Installed) -> None:
    run = installed("server", "plot")
    assert run("mesh-motion", "play", ROTATION, "--out", "out").stderr == ""


def test_every_required_package_is_known_by_its_extra() -> None:
    known = {"prometheus_client.parser": "server", "h5py": "mesh", "dask.config": "dask"}
    assert {module: extra_of(module) for module in known} == known
    assert extra_of("matplotlib") == "plot"
    assert extra_of("mesh_motion_client") is None
    assert not_installed(ModuleNotFoundError(name="somebodys_own")) is None


def test_sources_that_are_not_installed_say_so(tmp_path: Path) -> None:
    """Only the client is installed, and the working folder is a checkout: ``-m`` finds the sources."""
    for name, folder in (("mesh_motion_server", ROOT), ("mesh_motion_protocol", ROOT / "adapters" / "python")):
        (tmp_path / name).symlink_to(folder / name)
    command = [sys.executable, "-S", "-m", "mesh_motion_server", "serve"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 69
    assert done.stderr == (
        "mesh-motion: mesh-motion-server is not installed, only its sources are here (pip install '.[server]' in their "
        "folder)\n"
    )
