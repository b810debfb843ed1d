"""The sources compiled with the headers of releases that are not installed; a nightly job fetches them."""

import os
import re
import shutil
import subprocess
from pathlib import Path

import pytest

ADAPTER = Path(__file__).resolve().parents[3] / "adapters" / "openfoam"
PARTS = ["OpenFOAM", "OSspecific/POSIX", "finiteVolume", "dynamicMesh", "meshTools", "fileFormats", "surfMesh"]
SOURCES = [Path(name) for name in os.environ.get("OPENFOAM_SOURCES", "").split(os.pathsep) if name]


@pytest.mark.nightly
@pytest.mark.skipif(shutil.which("g++") is None, reason="no C++ compiler")
@pytest.mark.skipif(not SOURCES, reason="OPENFOAM_SOURCES names no folder with the sources of a release")
@pytest.mark.parametrize("release", SOURCES, ids=lambda path: path.name)
def test_each_file_compiles_against_the_headers_of_a_release(release, tmp_path):
    info = release / "META-INFO" / "api-info"  # the Foundation's releases have none, and define no OPENFOAM
    api = re.findall(r"api=(\d+)", info.read_text()) if info.exists() else []
    includes = []
    for part in [*PARTS, "fvMotionSolver"]:
        folder = tmp_path / part
        folder.mkdir(parents=True)
        for path in (release / "src" / part).rglob("*.[CH]"):
            if "lnInclude" not in path.parts and not (folder / path.name).exists():
                (folder / path.name).symlink_to(path.resolve())
        includes += ["-isystem", folder]
    options = ["-std=c++14", "-m64", "-DWM_DP", "-DWM_LABEL_SIZE=32", "-DNoRepository", "-ftemplate-depth-100"]
    options += [f"-DOPENFOAM={number}" for number in api]
    for path in sorted((ADAPTER / "src").glob("*.C")):
        command = ["g++", "-fsyntax-only", *options, *includes, "-I", ADAPTER.parent / "c" / "include", path]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        assert done.returncode == 0, f"{path.name}: {done.stderr[:2000]}"
