"""OpenFOAM's own tutorials that move a mesh, with their motion solver and with the server: a table in Markdown.

    python adapters/openfoam/tutorials.py [--only NAME] [--out FOLDER]

Needs OpenFOAM with its tutorials (Debian: openfoam openfoam-examples). Each case is moved by ``moveDynamicMesh``: as it
is, with ``remoteMeshMotion``, and so on two processors. Largest non-orthogonality (degrees) and skewness are those that
``checkMesh`` finds at all times.
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

from mesh_motion_client.embedded import EmbeddedServer
from mesh_motion_fsi.case import build_library, environment, mesh_motion
from mesh_motion_fsi.errors import SetupError

HERE = Path(__file__).resolve().parent
TUTORIALS = Path(os.environ.get("FOAM_TUTORIALS", "/usr/share/doc/openfoam-examples/examples"))
_QUALITY = re.compile(r"Mesh non-orthogonality Max: (\S+)|Max skewness = ([^\s,]+)")


@dataclass(frozen=True)
class Tutorial:
    """A case: its folder, time steps, and ``patches`` of remoteMeshMotionCoeffs."""

    path: str
    steps: int
    dt: float
    patches: str
    prepare: tuple[str, ...] = ("blockMesh",)
    #: pointDisplacement, where the tutorial gives a velocity: entries of boundaryField
    displacement: str = ""

    @property
    def name(self) -> str:
        return Path(self.path).name


_WAVES = "leftwall moving; rightwall fixed; bottom2 fixed; bottom1 slip; top slip;"
_CONE = """
movingWall { type uniformFixedValue; uniformValue table ((0 (0 0 0)) (1 (1 0 0))); }
"(fixedWall|left)" { type uniformFixedValue; uniformValue constant (0 0 0); }
"(farField|farFieldMoving)" { type slip; }
"(back|front)" { type wedge; }
axis { type empty; }
"""
_BOX = (
    "blockMesh",
    "topoSet",
    "subsetMesh -overwrite c0 -patch floatingObject",
    "topoSet -dict system/topoSetDict-selectBottom",
    "createPatch -overwrite",
)
CASES = (
    Tutorial(
        "incompressible/pimpleFoam/laminar/movingCone", 29, 1e-4,
        "movingWall moving; fixedWall fixed; left fixed; farField slip; farFieldMoving slip;", displacement=_CONE,
    ),
    Tutorial(
        "multiphase/potentialFreeSurfaceDyMFoam/oscillatingBox", 20, 0.05,
        "floatingObjectBottom moving; floatingObject slip; leftWall slip; rightWall fixed; bottomWall fixed; "
        "freeSurface fixed;", _BOX,
    ),
    Tutorial("multiphase/interFoam/laminar/waves/waveMakerFlap", 10, 0.2, _WAVES),
    Tutorial("multiphase/interFoam/laminar/waves/waveMakerPiston", 10, 0.2, _WAVES),
    Tutorial(
        "mesh/moveDynamicMesh/SnakeRiverCanyon", 10, 1.0,
        "minZ moving; maxZ fixed; minX slip; maxX slip; minY slip; maxY slip;",
    ),
)  # fmt: skip


@dataclass(frozen=True)
class Outcome:
    """A run: largest non-orthogonality and skewness, seconds a step, and how it ended if not well."""

    orthogonality: float
    skewness: float
    seconds: float
    error: str = ""

    def __str__(self) -> str:
        numbers = f"{self.orthogonality:.1f}, {self.skewness:.2f}"
        return f"{numbers} | {self.seconds:.2f}" if not self.error else f"{numbers}; {self.error} | "


class Runner:
    """Runs programs of OpenFOAM in a case; each with a log of its own."""

    def __init__(self, case: Path, variables: dict[str, str]) -> None:
        self.case, self.environment = case, os.environ | variables

    def run(self, command: str, ranks: int = 1) -> str:
        """The program's output; SetupError with its last words where it fails."""
        words = [*command.split(), *(["-parallel"] if ranks > 1 else [])]
        mpi = ["mpirun", "--allow-run-as-root", "--oversubscribe", "-np", str(ranks)] if ranks > 1 else []
        done = subprocess.run(
            [*mpi, *words], cwd=self.case, env=self.environment, capture_output=True, text=True, check=False
        )
        (self.case / f"log.{words[0]}").write_text(done.stdout + done.stderr)
        if done.returncode:
            raise SetupError(f"{command}: {_last_words(done.stdout + done.stderr)}")
        return done.stdout


def _last_words(text: str) -> str:
    """The fatal error's first lines, or the last line."""
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    begun = next((i for i, line in enumerate(lines) if "FOAM FATAL" in line), len(lines) - 2)
    return " ".join(lines[begun + 1 : begun + 4])


def prepared(tutorial: Tutorial, folder: Path, variables: dict[str, str]) -> Runner:
    """A copy of the tutorial with its mesh, ready for moveDynamicMesh."""
    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(TUTORIALS / tutorial.path, folder)
    for name in folder.rglob("*.gz"):
        subprocess.run(["gunzip", name], check=True)
    if not (folder / "0.orig").exists():
        (folder / "0").rename(folder / "0.orig")
    if tutorial.displacement:
        header = "FoamFile { version 2.0; format ascii; class pointVectorField; object pointDisplacement; }\n"
        inner = "dimensions [0 1 0 0 0 0 0]; internalField uniform (0 0 0); boundaryField\n{"
        (folder / "0.orig" / "pointDisplacement").write_text(header + inner + tutorial.displacement + "}\n")
    _write_system(folder / "system", tutorial)
    runner = Runner(folder, variables)
    for command in tutorial.prepare:
        runner.run(command)
    shutil.rmtree(folder / "0", ignore_errors=True)
    (folder / "0").mkdir()
    for field in (folder / "0.orig").glob("point*"):
        shutil.copy(field, folder / "0")
    return runner


def _write_system(system: Path, tutorial: Tutorial) -> None:
    """What moveDynamicMesh, decomposePar and the motion solvers read."""
    files = {
        "controlDict": 'libs ("libfvMotionSolvers.so" "libwaveModels.so"); application moveDynamicMesh; '
        f"startFrom startTime; startTime 0; stopAt endTime; endTime {tutorial.steps * tutorial.dt!r}; "
        f"deltaT {tutorial.dt!r}; "
        "writeControl timeStep; writeInterval 1; writeFormat ascii; writePrecision 12; timePrecision 8;",
        "decomposeParDict": "numberOfSubdomains 2; method simple; simpleCoeffs { n (2 1 1); delta 0.001; }",
    }
    for name, text in files.items():
        header = f"FoamFile {{ version 2.0; format ascii; class dictionary; object {name}; }}\n"
        (system / name).write_text(header + text + "\n")


def play(tutorial: Tutorial, folder: Path, ranks: int, patches: str) -> Outcome:
    """Move the mesh, with ``patches`` by the server, and check it."""

    def start() -> EmbeddedServer:
        return EmbeddedServer(folder.with_suffix(".server"), 120.0, ["--threads", "1"])

    with mesh_motion("server" if patches else "own", None, start) as server:
        runner = prepared(tutorial, folder, environment(HERE) | server)
        if patches:
            (folder / "constant" / "dynamicMeshDict").write_text(
                "FoamFile { version 2.0; format ascii; class dictionary; object dynamicMeshDict; }\n"
                'dynamicFvMesh dynamicMotionSolverFvMesh; motionSolverLibs ("libremoteMeshMotion.so");\n'
                "motionSolver remoteMeshMotion; remoteMeshMotionCoeffs { "
                f'endpoint "$MESH_MOTION_ENDPOINT"; patches {{ {patches} }} }}\n'
            )
        if ranks > 1:
            runner.run("decomposePar")
        began, error = time.monotonic(), ""
        try:
            runner.run("moveDynamicMesh", ranks)
        except SetupError as failure:
            error = str(failure)
        seconds = (time.monotonic() - began) / tutorial.steps
    checked = runner.run("checkMesh", ranks)
    found = [[float(group) for group in column if group] for column in zip(*_QUALITY.findall(checked), strict=True)]
    times = checked.count("Time = ") - 1
    error = error or ("" if times == tutorial.steps else f"{times} of {tutorial.steps} steps")
    return Outcome(max(found[0]), max(found[1]), seconds, error)


def main() -> int:
    """All cases; status 1 where one did not move to its end with the server."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--only", help="part of a case's name")
    parser.add_argument("--out", type=Path, default=Path("out/openfoam-tutorials"))
    options = parser.parse_args()
    if not TUTORIALS.is_dir():
        sys.stderr.write(f"there are no tutorials at {TUTORIALS}; Debian: apt-get install openfoam-examples\n")
        return 69
    build_library(HERE)
    out: Path = options.out.resolve()
    out.mkdir(parents=True, exist_ok=True)
    sys.stdout.write("| case | steps | original | s | plugin | s | plugin, two ranks | s |\n" + "|---" * 8 + "|\n")
    good = True
    for tutorial in CASES:
        if (options.only or "") not in tutorial.name:
            continue
        cells = [f"{tutorial.name} | {tutorial.steps} of {tutorial.dt:g} s"]
        for name, ranks, patches in (("own", 1, ""), ("server", 1, tutorial.patches), ("ranks", 2, tutorial.patches)):
            outcome = play(tutorial, out / f"{tutorial.name}-{name}", ranks, patches)
            good = good and not (patches and outcome.error)
            cells.append(str(outcome))
        sys.stdout.write("| " + " | ".join(cells) + " |\n")
        sys.stdout.flush()
    return int(not good)


if __name__ == "__main__":
    sys.exit(main())
