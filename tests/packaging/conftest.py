"""The distributions, built once."""

import os
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest
from bare_environment import ROOT, bare_environment, build
from made_once import made_once

Run = Callable[..., subprocess.CompletedProcess[str]]


def _built(factory: pytest.TempPathFactory, name: str, target: str, source: Path = ROOT) -> Path:
    (made,) = made_once(factory, name, lambda folder: build(target, folder, source)).iterdir()
    return made


@pytest.fixture(scope="session")
def client_wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return _built(tmp_path_factory, "client", "wheel", ROOT / "adapters" / "python")


@pytest.fixture(scope="session")
def client_alone(client_wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Run:
    """Runs a program of an environment with only the client, in a folder outside the checkout."""
    folder = tmp_path_factory.mktemp("alone")
    return _runner(bare_environment(folder / "environment", [client_wheel]), folder)


@pytest.fixture(scope="session")
def numerics_wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return _built(tmp_path_factory, "numerics", "wheel", ROOT / "numerics")


@pytest.fixture(scope="session")
def sdist(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return _built(tmp_path_factory, "sdist", "sdist")


@pytest.fixture(scope="session")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return _built(tmp_path_factory, "wheel", "wheel")


@pytest.fixture(scope="session")
def installed(
    client_wheel: Path, numerics_wheel: Path, wheel: Path, tmp_path_factory: pytest.TempPathFactory
) -> Callable[..., Run]:
    """As ``client_alone``, with the server and these extras only."""
    made: dict[tuple[str, ...], Run] = {}

    def environment(*extras: str) -> Run:
        if extras not in made:
            folder = tmp_path_factory.mktemp("-".join(("installed", *extras)))
            wheels = [client_wheel, numerics_wheel, wheel]
            made[extras] = _runner(bare_environment(folder / "environment", wheels, extras), folder)
        return made[extras]

    return environment


def _runner(programs: Path, folder: Path) -> Run:
    kept = {name: value for name, value in os.environ.items() if not name.startswith(("PYTHON", "VIRTUAL_ENV"))}

    def run(program: str, *arguments: object) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [str(programs / program), *map(str, arguments)],
            cwd=folder,
            env=kept | {"HOME": str(folder), "PATH": f"{programs}:{os.environ['PATH']}"},
            capture_output=True,
            text=True,
            timeout=240,
            check=False,
        )

    return run
