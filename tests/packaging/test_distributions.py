"""Content of the wheels and the source distributions of server and numerics."""

import tarfile
import tomllib
from email.parser import Parser
from pathlib import Path
from zipfile import ZipFile

import pytest
from bare_environment import ROOT, build, names_in, tracked, unpacked

from mesh_motion_server import __version__
from tools import manual_pages

pytestmark = [pytest.mark.nightly, pytest.mark.timeout(1200)]  # the kernels are compiled for the wheel

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
FOLDERS = [Path(path) for path in PROJECT["tool"]["scikit-build"]["wheel"]["packages"]]


def test_the_wheel_has_each_file_of_its_packages_and_no_other(wheel: Path) -> None:
    expected = {
        str(Path(name).relative_to(folder.parent))
        for name in tracked()
        for folder in FOLDERS
        if Path(name).is_relative_to(folder)
    }
    assert wheel.name == f"mesh_motion_server-{__version__}-py3-none-any.whl"
    assert {name for name in names_in(wheel) if ".dist-info/" not in name and ".data/" not in name} == expected


def test_the_wheel_of_the_numerics_has_each_file_and_the_kernels(numerics_wheel: Path) -> None:
    folder = Path("numerics/mesh_motion_numerics")
    expected = {str(Path(name).relative_to("numerics")) for name in tracked() if Path(name).is_relative_to(folder)}
    own = {name for name in names_in(numerics_wheel) if ".dist-info/" not in name}
    kernels = {name for name in own if name.startswith("mesh_motion_kernels/")}
    assert own - kernels == expected
    with ZipFile(numerics_wheel) as archive:
        about = f"mesh_motion_numerics-{__version__}.dist-info"
        assert archive.read(f"{about}/licenses/LICENSE") == (ROOT / "LICENSE").read_bytes()
    levels = {"/".join(name.split("/")[1:]).split(".")[0] for name in kernels}
    assert levels - {f"{level}/_kernels" for level in ("base", "v2", "v3", "v4")} == {"__init__", "_machine"}
    assert len(levels) == 3


def test_every_package_is_typed(wheel: Path) -> None:
    assert {f"{folder.name}/py.typed" for folder in FOLDERS} <= names_in(wheel)


def test_the_wheel_has_its_licence_version_and_commands(wheel: Path) -> None:
    about = f"mesh_motion_server-{__version__}.dist-info"
    with ZipFile(wheel) as archive:
        metadata = Parser().parsestr(archive.read(f"{about}/METADATA").decode())
        entries = archive.read(f"{about}/entry_points.txt").decode()
        vendored = sorted(ROOT.glob("mesh_motion_server/watch/page/static/vendor/*/LICENSE"))
        assert [path.parent.name for path in vendored] == ["uplot"]
        for path in (ROOT / "LICENSE", *vendored):
            assert archive.read(f"{about}/licenses/{path.relative_to(ROOT)}") == path.read_bytes()
    assert metadata["Version"] == __version__
    assert metadata["License-Expression"] == "BSD-3-Clause AND MIT"
    parts = {f"mesh-motion-{part}=={__version__}" for part in ("client", "numerics")}
    assert parts <= set(metadata.get_all("Requires-Dist"))
    assert {"server", "mesh", "plot", "dask", "all"} <= set(metadata.get_all("Provides-Extra"))
    assert "mesh-motion = mesh_motion_server.commands.cli:main" in entries
    assert "read_mesh = mesh_motion_server.files:read_mesh" in entries


def test_the_wheel_brings_the_manual_pages(wheel: Path) -> None:
    installed = {Path(name).name for name in names_in(wheel) if ".data/data/share/man/man1/" in name}
    assert installed == set(manual_pages.pages())


def test_the_sdist_is_the_checkout_and_builds_the_same_wheel(sdist: Path, wheel: Path, tmp_path: Path) -> None:
    with tarfile.open(sdist) as archive:
        files = {member.name.partition("/")[2] for member in archive if member.isfile()}
    assert files == {*tracked(), "PKG-INFO"}
    assert build("wheel", tmp_path / "dist", unpacked(sdist, tmp_path / "unpacked")).read_bytes() == wheel.read_bytes()


def test_the_numerics_sources_alone_build_the_same_wheel(numerics_wheel: Path, tmp_path: Path) -> None:
    sources = unpacked(build("sdist", tmp_path, ROOT / "numerics"), tmp_path / "unpacked")
    assert build("wheel", tmp_path / "again", sources).read_bytes() == numerics_wheel.read_bytes()


def test_the_licence_of_the_openfoam_part_goes_with_it(sdist: Path) -> None:
    with tarfile.open(sdist) as archive:
        assert any(name.endswith("/adapters/openfoam/LICENSE") for name in archive.getnames())
