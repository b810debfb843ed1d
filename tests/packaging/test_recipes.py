"""The recipes for package managers name the version, the requirements and the files of the distributions."""

import ast
import re
import tomllib
from pathlib import Path

import pytest
import yaml
from bare_environment import ROOT
from packaging.requirements import Requirement
from packaging.specifiers import SpecifierSet

from mesh_motion_server import __version__

FOLDER = ROOT / "recipes"
FOLDERS = {"mesh-motion-client": "adapters/python", "mesh-motion-numerics": "numerics", "mesh-motion-server": ""}
CLIENT, NUMERICS, SERVER = (
    tomllib.loads((ROOT / folder / "pyproject.toml").read_text(encoding="utf-8")) for folder in FOLDERS.values()
)
CMAKE = (ROOT / "adapters" / "c" / "CMakeLists.txt").read_text(encoding="utf-8")
#: Names of conda-forge that are not those of PyPI.
CONDA = {"msgpack": "msgpack-python", "prometheus-client": "prometheus_client"}


def required(lines: list[str]) -> dict[str, SpecifierSet]:
    """Package → versions, as pip takes them."""
    return {found.name: found.specifier for found in map(Requirement, lines)}


def conda(name: str) -> dict:
    text = (FOLDER / "conda-forge" / name / "recipe.yaml").read_text(encoding="utf-8")
    for key, value in yaml.safe_load(text)["context"].items():
        text = text.replace(f"${{{{ {key} }}}}", value)
    return yaml.safe_load(text)


def conda_versions(lines: list[str]) -> dict[str, SpecifierSet]:
    """Package → versions, of a list of requirements."""
    return {name: SpecifierSet(versions) for name, _, versions in (line.partition(" ") for line in lines)}


def spack_calls(name: str, function: str) -> list[tuple]:
    """Arguments of each call of a directive: the positional ones, then the named ones."""
    tree = ast.parse((FOLDER / "spack" / name / "package.py").read_text(encoding="utf-8"))
    return [
        (*map(ast.literal_eval, node.args), {key.arg: ast.literal_eval(key.value) for key in node.keywords})
        for node in ast.walk(tree)
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == function
    ]


@pytest.mark.parametrize(
    ("name", "project", "run"),
    [
        ("mesh-motion-client", CLIENT, CLIENT["project"]["dependencies"]),
        ("mesh-motion-numerics", NUMERICS, []),
        ("mesh-motion-server", SERVER, SERVER["project"]["optional-dependencies"]["server"]),
    ],
)
def test_conda_forge(name: str, project: dict, run: list[str]) -> None:
    recipe = conda(name)
    further = project["tool"]["scikit-build"]["metadata"].get("dependencies", {"parts": []})
    run = [*run, *(f"{part}=={__version__}" for part in further["parts"]), *further.get("others", [])]
    assert (recipe["package"]["name"], recipe["package"]["version"]) == (project["project"]["name"], __version__)
    assert recipe["source"]["url"].endswith(f"/{name}/{name.replace('-', '_')}-{__version__}.tar.gz")
    found = conda_versions(recipe["requirements"]["run"])
    python = found.pop("python")
    assert found == {CONDA.get(package, package): versions for package, versions in required(run).items()}
    host = conda_versions(recipe["requirements"]["host"][2:])
    assert host == required(project["build-system"]["requires"])
    noarch = recipe["build"].get("noarch")
    assert str(python) == (project["project"]["requires-python"] if noarch else "")
    assert noarch or project["project"]["requires-python"].replace(">=", "<") in recipe["build"]["skip"]
    about = recipe["about"]
    assert about["license"] == project["project"]["license"]
    folder = ROOT / FOLDERS[name]
    globs = project["project"]["license-files"]
    licences = [about["license_file"]] if isinstance(about["license_file"], str) else about["license_file"]
    assert licences == [str(path.relative_to(folder)) for glob in globs for path in sorted(folder.glob(glob))]


def test_the_client_of_spack() -> None:
    (version,) = spack_calls("py_mesh_motion_client", "version")
    assert version[0] == __version__
    assert f'"mesh-motion-client/mesh_motion_client-{__version__}.tar.gz"' in source("py_mesh_motion_client")
    needed = {
        "python": CLIENT["project"]["requires-python"],
        **{f"py-{name}": versions for name, versions in required(CLIENT["project"]["dependencies"]).items()},
        **{f"py-{name}": versions for name, versions in required(CLIENT["build-system"]["requires"]).items()},
    }
    given = {
        call[0].partition("@")[0]: call[0].partition("@")[2]
        for call in spack_calls("py_mesh_motion_client", "depends_on")
    }
    assert given == {name: str(versions).replace(">=", "") + ":" for name, versions in needed.items()}
    assert spack_calls("py_mesh_motion_client", "license")[0][0] == CLIENT["project"]["license"]


def test_the_c_library_of_spack() -> None:
    (version,) = spack_calls("mesh_motion", "version")
    assert version[0] == __version__
    assert f"/mesh-motion-server/mesh_motion_server-{__version__}.tar.gz" in source("mesh_motion")
    assert f'root_cmakelists_dir = "{Path("adapters/c")}"' in source("mesh_motion")
    given = {call[0] for call in spack_calls("mesh_motion", "depends_on")}
    cmake = re.search(r"cmake_minimum_required\(VERSION ([\d.]+)\)", CMAKE)[1]
    zmq = re.search(r"pkg_check_modules\(ZMQ REQUIRED libzmq>=([\d.]+)\)", CMAKE)[1]
    assert given == {"c", "fortran", "pkgconfig", f"cmake@{cmake}:", f"libzmq@{zmq}:"}
    options = re.findall(r'define_from_variant\("(\w+)", "(\w+)"\)', source("mesh_motion"))
    defaults = {name: more["default"] for name, more in spack_calls("mesh_motion", "variant")}
    assert {variant: f"option({option} " in CMAKE for option, variant in options} == dict.fromkeys(defaults, True)
    for option, variant in options:
        assert re.search(rf'option\({option} ".*" (ON|OFF)\)', CMAKE)[1] == ("ON" if defaults[variant] else "OFF")


@pytest.mark.parametrize("name", ["mesh_motion", "py_mesh_motion_client"])
def test_spack_takes_the_style_of_its_recipes(name: str) -> None:
    """Its own checks: the head of each file, and no line of more than 99 characters."""
    head = "# Copyright Spack Project Developers. See COPYRIGHT file for details.\n#\n# SPDX-License-Identifier: "
    assert source(name).startswith(head)
    assert max(map(len, source(name).splitlines())) <= 99


def source(name: str) -> str:
    return (FOLDER / "spack" / name / "package.py").read_text(encoding="utf-8")
