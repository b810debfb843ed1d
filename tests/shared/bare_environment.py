"""Environments with only wheels and the requirements of some of their extras, made without a registry.

The requirements are linked from the environment that runs the tests, distribution by distribution, according to its
metadata.
"""

import os
import re
import subprocess
import sys
import tarfile
import venv
import zipfile
from collections.abc import Iterable, Sequence
from importlib.metadata import Distribution, PackageNotFoundError, PathDistribution, distribution
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
_REQUIREMENT = re.compile(r"([A-Za-z0-9._-]+)(?:\[([^\]]*)\])?")
_EXTRA = re.compile(r"\bextra == ['\"]([\w-]+)['\"]")


def build(target: str, folder: Path, source: Path = ROOT) -> Path:
    """Build the ``sdist`` or ``wheel`` of a source tree, with kernels for this machine only."""
    options = ["--no-isolation", "--skip-dependency-check", f"--{target}", "--outdir", str(folder)]
    command = [sys.executable, "-m", "build", *options, "-Ccmake.define.MESH_MOTION_LEVELS=native"]
    environment = os.environ | {"SOURCE_DATE_EPOCH": "1700000000"}
    subprocess.run(command, cwd=source, env=environment, check=True, capture_output=True)
    (made,) = folder.glob("*.whl" if target == "wheel" else "*.tar.gz")
    return made


def unpacked(sdist: Path, folder: Path) -> Path:
    """Unpack a source distribution there; return its folder."""
    with tarfile.open(sdist) as archive:
        archive.extraction_filter = getattr(tarfile, "data_filter", None)  # None before Python 3.11.4
        archive.extractall(folder)
    (made,) = folder.iterdir()
    return made


def bare_environment(folder: Path, wheels: Sequence[Path], extras: Iterable[str] = ()) -> Path:
    """Make a new environment; return its ``bin``."""
    venv.create(folder, with_pip=False)
    python = folder / "bin" / "python"
    pip = [sys.executable, "-m", "pip", "--python", str(python), "install", "--quiet", "--no-deps", "--no-index"]
    subprocess.run([*pip, *map(str, wheels)], check=True, capture_output=True)
    (packages,) = folder.glob("lib/python*/site-packages")
    own = [PathDistribution(next(packages.glob(f"{wheel.name.partition('-')[0]}-*.dist-info"))) for wheel in wheels]
    for found in _required(own, set(extras)):
        _link(found, packages)
    return folder / "bin"


def _required(own: Sequence[Distribution], extras: set[str]) -> list[Distribution]:
    """The requirements of distributions with these extras, and their own requirements."""
    found: dict[str, Distribution] = {each.name: each for each in own}
    waiting: list[tuple[Distribution, set[str]]] = [(each, extras) for each in own]
    while waiting:
        current, wanted = waiting.pop()
        for line in current.requires or []:
            requirement, _, marker = line.partition(";")
            name, inner = re.match(_REQUIREMENT, requirement.strip()).groups()  # type: ignore[union-attr]
            named = _EXTRA.search(marker)
            if (named and named[1] not in wanted) or name in found:
                continue
            try:
                found[name] = distribution(name)
            except PackageNotFoundError:  # for other systems or versions of Python
                continue
            waiting.append((found[name], set(re.split(r"\s*,\s*", inner or ""))))
    return list(found.values())[len(own) :]


def _link(found: Distribution, packages: Path) -> None:
    for name in {path.parts[0] for path in found.files or () if path.parts[0] not in ("..", "__pycache__")}:
        source, link = Path(str(found.locate_file(name))), packages / name
        if not link.exists():
            link.symlink_to(source)


def tracked() -> list[str]:
    command = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    listed = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    if listed.returncode:
        pytest.skip("not in a git checkout")
    return [name for name in listed.stdout.split("\0") if name and (ROOT / name).exists()]


def names_in(wheel: Path) -> set[str]:
    with zipfile.ZipFile(wheel) as archive:
        return set(archive.namelist())
