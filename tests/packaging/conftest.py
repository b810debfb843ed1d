"""The distributions, built once."""

import os
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest
from bare_environment import bare_environment, build

Run = Callable[..., subprocess.CompletedProcess[str]]


@pytest.fixture(scope="session")
def sdist(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The source distribution."""
    return build("sdist", tmp_path_factory.mktemp("sdist"))


@pytest.fixture(scope="session")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The wheel."""
    return build("wheel", tmp_path_factory.mktemp("wheel"))


@pytest.fixture(scope="session")
def installed(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Run]:
    """Runs a program of an environment that has these extras only, in a folder outside the checkout."""
    made: dict[tuple[str, ...], Run] = {}

    def environment(*extras: str) -> Run:
        if extras not in made:
            folder = tmp_path_factory.mktemp("-".join(("installed", *extras)))
            made[extras] = _runner(bare_environment(folder / "environment", wheel, extras), folder)
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
