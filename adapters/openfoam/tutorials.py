"""Run OpenFOAM's own tutorials that move a mesh, with their motion solver and with the server: a table in Markdown.

    python adapters/openfoam/tutorials.py [--only NAME] [--out FOLDER]

Needs OpenFOAM with its tutorials (Debian: openfoam openfoam-examples). Each case is moved by ``moveDynamicMesh``, or by
its own solver if the flow moves a body: unchanged, with ``remoteMeshMotion``, and with ``remoteMeshMotion`` on two
processors. Largest non-orthogonality (degrees) and skewness are those that ``checkMesh`` finds at all times. Seconds
are processor time for a step, of OpenFOAM and the server together, start included; none for two processors, because MPI
waits busily.
"""

from __future__ import annotations

import argparse
import contextlib
import math
import os
import re
import shlex
import shutil
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass, field
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
    #: the plugin's pointDisplacement, entries of boundaryField, where the tutorial has none or has code to compile
    displacement: str = ""
    #: the same for a field of the tutorial's own motion solver, and that one's dynamicMeshDict
    own_fields: dict[str, str] = field(default_factory=dict)
    own_motion: str = ""
    #: file, what stands there, what is to stand there
    replace: tuple[tuple[str, str, str], ...] = ()
    #: who moves the mesh; a flow solver gets all fields
    application: str = "moveDynamicMesh"
    #: the case within a tutorial of several
    inside: str = "."
    #: why the tutorial's own motion solver is not run
    missing: str = ""
    #: the plugin moves this zone only; the motion solvers of other zones
    zone: str = ""
    others: str = ""
    #: files of the case for the plugin's pointDisplacement
    tables: dict[str, str] = field(default_factory=dict)
    #: its conditions that decomposePar cannot copy
    conditions: dict[str, str] = field(default_factory=dict)
    #: the program that the case is coupled to
    together: str = ""

    @property
    def name(self) -> str:
        """The tutorial's solver and name."""
        parts = Path(self.path).parts
        return f"{parts[1]} {parts[-1]}"


_WAVES = "leftwall moving; rightwall fixed; bottom2 fixed; bottom1 slip; top slip;"
_CONE = "movingWall moving; fixedWall fixed; left fixed; farField slip; farFieldMoving slip;"


def _cone(speed: float) -> str:
    """movingCone's displacement at a speed along x, m/s."""
    return f"""
movingWall {{ type uniformFixedValue; uniformValue table ((0 (0 0 0)) (1 ({speed} 0 0))); }}
"(fixedWall|left)" {{ type uniformFixedValue; uniformValue constant (0 0 0); }}
"(farField|farFieldMoving)" {{ type slip; }}
"(back|front)" {{ type wedge; }}
axis {{ type empty; }}
"""


_STILL = "type fixedValue; value uniform (0 0 0);"
_SWING = """type uniformFixedValue; uniformValue sine;
    uniformValueCoeffs {{ frequency {}; amplitude {}; scale {}; level {}; }}"""
_CHANNEL = _SWING.format(0.49975, 0.5, "(0 1 0)", "(0 0 0)")
_ACMI = f"""
"(inlet|walls|ACMI1_blockage)" {{ {_CHANNEL} }}
ACMI1_couple {{ patchType cyclicACMI; {_CHANNEL} }}
"(outlet|ACMI2_blockage)" {{ {_STILL} }}
ACMI2_couple {{ type cyclicACMI; }}
defaultFaces {{ type empty; }}
"""


def _cylinder(direction: str, zero: str) -> str:
    """oscillatingCylinder's displacement, a vector or its component y."""
    return f"""
cylinder {{ {_SWING.format(200, 0.001, direction, zero)} }}
"(walls|inlet.*|outlet)" {{ type fixedValue; value uniform {zero}; }}
frontAndBack {{ type empty; }}
"""


_TWIST = f"""
top {{ type angularOscillatingDisplacement; value uniform (0 0 0);
    axis (0 0 1); origin (0 0 0); angle0 0; amplitude 3.14159265; omega 0.157079633; }}
floor {{ {_STILL} }}
sides {{ type calculated; value uniform (0 0 0); }}
"""
_REMOTE = (
    'motionSolverLibs ("libremoteMeshMotion.so"); motionSolver remoteMeshMotion; '
    'remoteMeshMotionCoeffs {{ endpoint "$MESH_MOTION_ENDPOINT"; patches {{ {} }} }}'
)


def _relative(steps: int, dt: float) -> tuple[str, dict[str, str]]:
    """relativeMotion's displacement of the inner zone (nested rotations) by tables, and the text of their file."""
    rows, swings = [], []
    for step in range(-1, steps + 2):
        angle = 10.0 * step * dt
        shift = f"({0.43 - 0.43 * math.cos(angle)!r} {-0.43 * math.sin(angle)!r} 0)"
        rows.append(f"({step * dt!r} {shift})")
        swings.append(f"({step * dt!r} ({shift} (0 0 {10.0 * math.sin(angle)!r})))")
    shifted = f"type uniformFixedValue; uniformValue table ({' '.join(rows)});"
    return (
        f"""
#includeEtc "caseDicts/setConstraintTypes"
"(inlet|outlet|sides|AMI_rotor.*)" {{ {_STILL} }}
AMI_dualWing_slave {{ patchType cyclicAMI; {_STILL} }}
AMI_dualWing {{ patchType cyclicAMI; {shifted} }}
wing1 {{ {shifted} }}
wing2 {{ {_STILL} }}
""",
        {"constant/wing2": f"({' '.join(swings)})\n"},
    )


_ROTOR = "solidBodyMotionFunction rotatingMotion; rotatingMotionCoeffs { origin (0 0 0); axis (0 0 1); omega 10; }"
_RELATIVE = _relative(20, 0.002)
_WING2 = """{ type solidBodyMotionDisplacement; value uniform (0 0 0); solidBodyMotionFunction tabulated6DoFMotion;
    tabulated6DoFMotionCoeffs { CofG (-0.41 0 0); timeDataFileName "$FOAM_CASE/constant/wing2"; } }"""
#: The body of floatingObject: the tutorial's, its inertia as numbers.
_BODY = """
mass 15; centreOfMass (0.5 0.45 0.35); momentOfInertia (0.3625 0.425 0.1625); report off; accelerationRelaxation 0.7;
solver { type Newmark; }
constraints
{
    fixedLine { sixDoFRigidBodyMotionConstraint line; centreOfRotation (0.5 0.45 0.1); direction (0 1 0); }
    fixedAxis { sixDoFRigidBodyMotionConstraint axis; axis (0 1 0); }
}
"""
_FLOATING = f"""
"(stationaryWalls|atmosphere)" {{ {_STILL} }}
floatingObject {{ type sixDoFRigidBodyDisplacement; value uniform (0 0 0); rho rho; {_BODY} }}
"""
#: The wing of wingMotion, the tutorial's: it swings on its springs without a flow.
_WING = """
mass 22.9; centreOfMass (0.4974612746 -0.01671895744 0.125); angularMomentum (0 0 -2);
momentOfInertia (1.958864357 3.920839234 2.057121362); report off;
orientation (0.9953705935 0.09611129781 0 -0.09611129781 0.9953705935 0 0 0 1);
solver { type symplectic; }
constraints
{
    yLine { sixDoFRigidBodyMotionConstraint line; centreOfRotation (0.25 0.007 0.125); direction (0 1 0); }
    zAxis { sixDoFRigidBodyMotionConstraint axis; axis (0 0 1); }
}
restraints
{
    verticalSpring
    {
        sixDoFRigidBodyMotionRestraint linearSpring; anchor (0.25 0.007 0.125); refAttachmentPt (0.25 0.007 0.125);
        stiffness 4000; damping 2; restLength 0;
    }
    axialSpring
    {
        sixDoFRigidBodyMotionRestraint linearAxialAngularSpring; axis (0 0 1); stiffness 700; damping 0.5;
        referenceOrientation (0.9953705935 0.09611129781 0 -0.09611129781 0.9953705935 0 0 0 1);
    }
}
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
        "combustion/XiDyMFoam/oscillatingCylinder", 10, 2.5e-4,
        '"(walls|inlet.*|outlet)" fixed; cylinder moving;', displacement=_cylinder("(0 1 0)", "(0 0 0)"),
        own_fields={"pointDisplacementy": _cylinder("1", "0")},
    ),
    Tutorial("compressible/rhoCentralDyMFoam/movingCone", 29, 6.7e-7, _CONE, displacement=_cone(160.0)),
    Tutorial("compressible/sonicDyMFoam/movingCone", 29, 6.7e-7, _CONE, displacement=_cone(160.0)),
    Tutorial("incompressible/pimpleFoam/laminar/movingCone", 29, 1e-4, _CONE, displacement=_cone(1.0)),
    Tutorial(
        "incompressible/pimpleFoam/RAS/oscillatingInletACMI2D", 20, 0.1, '"(inlet|walls|ACMI1.*)" moving;',
        ("blockMesh", "topoSet -constant", "createBaffles -overwrite"), _ACMI, zone="inletChannel",
    ),
    Tutorial(
        "incompressible/pimpleFoam/RAS/wingMotion", 20, 0.005, 'wing moving; "(topAndBottom|inlet|outlet)" fixed;',
        (
            "blockMesh -case ../wingMotion_snappyHexMesh",
            "snappyHexMesh -overwrite -case ../wingMotion_snappyHexMesh",
            "extrudeMesh -case ../wingMotion2D_simpleFoam",
            "createPatch -overwrite -case ../wingMotion2D_simpleFoam",
            "cp -r ../wingMotion2D_simpleFoam/constant/polyMesh constant",
        ),
        f'"(topAndBottom|inlet|outlet)" {{ {_STILL} }} "(front|back)" {{ type empty; }} '
        f"wing {{ type uncoupledSixDoFRigidBodyDisplacement; value uniform (0 0 0); {_WING} }}",
        own_motion="motionSolverLibs (sixDoFRigidBodyMotion); motionSolver sixDoFRigidBodyMotion; test yes; "
        f"patches (wing); innerDistance 0.3; outerDistance 1; rho rhoInf; rhoInf 1; {_WING}",
        inside="wingMotion2D_pimpleFoam",
    ),
    Tutorial(
        "multiphase/potentialFreeSurfaceDyMFoam/oscillatingBox", 20, 0.05,
        "floatingObjectBottom moving; floatingObject slip; leftWall slip; rightWall fixed; bottomWall fixed; "
        "freeSurface fixed;", _BOX,
    ),
    Tutorial(
        "multiphase/interFoam/RAS/floatingObject", 10, 0.01,
        "floatingObject moving; stationaryWalls fixed; atmosphere fixed;",
        ("blockMesh", "topoSet", "subsetMesh -overwrite c0 -patch floatingObject"), _FLOATING,
        own_motion=f"motionSolverLibs (sixDoFRigidBodyMotion); motionSolver sixDoFRigidBodyMotion; "
        f"sixDoFRigidBodyMotionCoeffs {{ patches (floatingObject); innerDistance 0.05; outerDistance 0.35; {_BODY} }}",
        application="interFoam",
    ),
    Tutorial("multiphase/interFoam/laminar/waves/waveMakerFlap", 10, 0.2, _WAVES),
    Tutorial("multiphase/interFoam/laminar/waves/waveMakerPiston", 10, 0.2, _WAVES),
    *(
        Tutorial(
            f"multiphase/interFoam/laminar/waves/waveMakerMultiPaddle{kind}", 6, 0.4,
            "leftwall moving; rightwall fixed; bottom2 fixed; bottom1 slip; top slip; front slip; back slip;",
            replace=(("system/blockMeshDict", "(100 16 140)", "(60 8 20)"),),
        )
        for kind in ("Flap", "Piston")
    ),
    Tutorial(
        "multiphase/interFoam/laminar/waves/waveMakerSolitary", 10, 0.2,
        "inlet moving; outlet fixed; \"(top|ground).*\" slip;",
    ),
    Tutorial(
        "mesh/moveDynamicMesh/twistingColumn", 10, 1.0, "top moving; floor fixed; sides free;",
        displacement=_TWIST, missing="its code needs wmake",
    ),
    Tutorial(
        "mesh/moveDynamicMesh/relativeMotion", 20, 0.002, '"(AMI_dualWing|wing1|wing2)" moving;',
        (
            "blockMesh -case ../box_snappyHexMesh",
            "snappyHexMesh -overwrite -case ../box_snappyHexMesh",
            "renumberMesh -overwrite -case ../box_snappyHexMesh",
            "createPatch -overwrite -case ../box_snappyHexMesh",
            "extrudeMesh",
        ),
        _RELATIVE[0], inside="box2D_moveDynamicMesh", tables=_RELATIVE[1], conditions={"wing2": _WING2},
        zone="dualWing", others=f"rotor {{ solver solidBody; cellZone rotor; solidBodyCoeffs {{ {_ROTOR} }} }}",
    ),
    Tutorial(
        "incompressible/lumpedPointMotion/building", 9, 1.0,
        'building moving; "(inlet|outlet|_y|y_|_z)" fixed; z_ slip;',
        (
            "mkdir -p constant/triSurface",
            f"cp {TUTORIALS}/resources/geometry/building_wtc2.obj.gz constant/triSurface",
            "blockMesh",
            "snappyHexMesh -overwrite",
        ),
        inside="steady", together="lumpedPointMovement -scale 5 -removeLock -slave ../files/response.txt",
    ),
    Tutorial(
        "mesh/moveDynamicMesh/SnakeRiverCanyon", 10, 1.0,
        "minZ moving; maxZ fixed; minX slip; maxX slip; minY slip; maxY slip;",
    ),
)  # fmt: skip


@dataclass(frozen=True)
class Outcome:
    """A run: largest non-orthogonality and skewness, processor seconds for a step, and the error if it failed."""

    orthogonality: float
    skewness: float
    seconds: float
    error: str = ""

    def __str__(self) -> str:
        return f"{self.orthogonality:.1f}, {self.skewness:.2f}" + (f"; {self.error}" if self.error else "")


class Runner:
    """Runs OpenFOAM's programs in a case, each with its own log."""

    def __init__(self, case: Path, variables: dict[str, str]) -> None:
        self.case, self.environment = case, os.environ | variables

    def run(self, command: str, ranks: int = 1) -> str:
        """The program's output; SetupError with its last lines if it fails."""
        words = [*shlex.split(command), *(["-parallel"] if ranks > 1 else [])]
        mpi = ["mpirun", "--allow-run-as-root", "--oversubscribe", "-np", str(ranks)] if ranks > 1 else []
        done = subprocess.run(
            [*mpi, *words], cwd=self.case, env=self.environment, capture_output=True, text=True, check=False
        )
        (self.case / f"log.{words[0]}").write_text(done.stdout + done.stderr)
        if done.returncode:
            raise SetupError(f"{command}: {_last_words(done.stdout + done.stderr)}")
        return done.stdout

    @contextlib.contextmanager
    def together(self, command: str) -> Iterator[None]:
        """A program that runs until the block ends; no program without a command."""
        if not command:
            yield
            return
        with (self.case / "log.together").open("w") as log:
            other = subprocess.Popen(command.split(), cwd=self.case, env=self.environment, stdout=log, stderr=log)
            try:
                yield
            finally:
                other.terminate()
                other.wait()


def _last_words(text: str) -> str:
    """The fatal error's first lines, or the last line."""
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    begun = next((i for i, line in enumerate(lines) if "FOAM FATAL" in line), len(lines) - 2)
    return " ".join(lines[begun + 1 : begun + 4])


def meshed(tutorial: Tutorial, folder: Path) -> None:
    """Copy the tutorial and make its mesh."""
    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(TUTORIALS / tutorial.path, folder)
    for name in folder.rglob("*.gz"):
        subprocess.run(["gunzip", name], check=True)
    folder /= tutorial.inside
    (folder / "0").mkdir(exist_ok=True)
    if not (folder / "0.orig").exists():
        (folder / "0").rename(folder / "0.orig")
    for name, old, new in tutorial.replace:
        text = (folder / name).read_text()
        if old not in text:
            raise SetupError(f"{tutorial.name}: {name} does not have {old!r}")
        (folder / name).write_text(text.replace(old, new))
    _write_system(folder / "system", tutorial)
    runner = Runner(folder, environment(HERE))
    for command in tutorial.prepare:
        runner.run(command)


def prepared(tutorial: Tutorial, mesh: Path, folder: Path, variables: dict[str, str], patches: str) -> Runner:
    """Copy the meshed tutorial; with ``patches`` prepare it for the motion by the server, else leave it unchanged."""
    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(mesh, folder)
    folder /= tutorial.inside
    fields = {"pointDisplacement": tutorial.displacement} if patches else tutorial.own_fields
    for name, boundary in fields.items():
        if not boundary:
            continue
        kind, zero = ("Vector", "(0 0 0)") if name == "pointDisplacement" else ("Scalar", "0")
        header = f"FoamFile {{ version 2.0; format ascii; class point{kind}Field; object {name}; }}\n"
        inner = f"dimensions [0 1 0 0 0 0 0]; internalField uniform {zero}; boundaryField\n{{"
        (folder / "0.orig" / name).write_text(header + inner + boundary + "}\n")
    for name, table in tutorial.tables.items():
        (folder / name).write_text(table)
    motion = _REMOTE.format(patches) if patches else tutorial.own_motion
    if motion:
        header = "FoamFile { version 2.0; format ascii; class dictionary; object dynamicMeshDict; }\n"
        zone = f"cellZone {tutorial.zone};" if patches and tutorial.zone else ""
        text = f"dynamicFvMesh dynamicMotionSolverFvMesh; {zone} {motion}\n"
        if patches and tutorial.others:
            zones = f"{tutorial.others} remote {{ {zone} {motion} }}"
            several = "dynamicMultiMotionSolverFvMesh"
            text = f"dynamicFvMesh {several}; {several}Coeffs {{ {zones} }}\n"
        (folder / "constant" / "dynamicMeshDict").write_text(header + text)
    runner = Runner(folder, variables)
    shutil.rmtree(folder / "0", ignore_errors=True)
    shutil.copytree(folder / "0.orig", folder / "0")
    if tutorial.application == "moveDynamicMesh":  # it needs no more; code in others may not be compiled
        for path in (folder / "0").iterdir():
            kept = path.name == "pointDisplacement" if patches else path.name.startswith(("point", "cell"))
            if path.is_file() and not kept:
                path.unlink()
    elif (folder / "system" / "setFieldsDict").exists():
        runner.run("setFields")
    return runner


def _write_system(system: Path, tutorial: Tutorial) -> None:
    """Write the files that moveDynamicMesh, decomposePar and the motion solvers read."""
    files = {
        "controlDict": 'libs ("libfvMotionSolvers.so" "libwaveModels.so" "libsixDoFRigidBodyMotion.so" '
        '"liblumpedPointMotion.so"); '
        f"application {tutorial.application}; startFrom startTime; startTime 0; stopAt endTime; "
        f"endTime {tutorial.steps * tutorial.dt!r}; "
        f"deltaT {tutorial.dt!r}; adjustTimeStep no; maxCo 1; maxAlphaCo 1; "
        "writeControl timeStep; writeInterval 1; writeFormat ascii; writePrecision 12; timePrecision 8;",
        "decomposeParDict": "numberOfSubdomains 2; method simple; simpleCoeffs { n (2 1 1); delta 0.001; }",
    }
    for name, text in files.items():
        header = f"FoamFile {{ version 2.0; format ascii; class dictionary; object {name}; }}\n"
        (system / name).write_text(header + text + "\n")


def play(tutorial: Tutorial, mesh: Path, folder: Path, ranks: int, patches: str) -> Outcome:
    """Move the mesh, by the server if ``patches`` are given, and check it."""

    def start() -> EmbeddedServer:
        return EmbeddedServer(folder.with_suffix(".server"), 120.0, ["--threads", "1"])

    with mesh_motion("server" if patches else "own", None, start) as server:
        runner = prepared(tutorial, mesh, folder, environment(HERE) | server, patches)
        if ranks > 1:
            runner.run("decomposePar")
        for patch, condition in tutorial.conditions.items() if patches else ():
            for part in [f"processor{rank}/0" for rank in range(ranks)] if ranks > 1 else ["0"]:
                entry = f"boundaryField/{patch}"
                runner.run(f"foamDictionary {part}/pointDisplacement -entry {entry} -set {shlex.quote(condition)}")
        began, error = _used(), ""
        try:
            with runner.together(tutorial.together):
                runner.run(tutorial.application, ranks)
        except SetupError as failure:
            error = str(failure)
    seconds = (_used() - began) / tutorial.steps  # a server's time counts from its end on
    checked = runner.run("checkMesh", ranks)
    found = [[float(group) for group in column if group] for column in zip(*_QUALITY.findall(checked), strict=True)]
    times = checked.count("Time = ") - 1
    error = error or ("" if times == tutorial.steps else f"{times} of {tutorial.steps} steps")
    return Outcome(max(found[0]), max(found[1]), seconds, error)


def _used() -> float:
    """Processor time of all ended children, s."""
    times = os.times()
    return times.children_user + times.children_system


def row(tutorial: Tutorial, start: Path) -> tuple[list[str], bool]:
    """The table's cells of a case, run in folders that begin with ``start``; also True if the server failed."""
    mesh = start.with_name(start.name + "mesh")
    try:
        meshed(tutorial, mesh)
    except (SetupError, subprocess.CalledProcessError) as error:
        return [str(error), "", str(error), "", str(error)], True
    cells, failed = [], False
    for name, ranks, patches in (("own", 1, ""), ("server", 1, tutorial.patches), ("ranks", 2, tutorial.patches)):
        if tutorial.missing and not patches:
            cells += [tutorial.missing, ""]
            continue
        try:
            outcome = play(tutorial, mesh, start.with_name(start.name + name), ranks, patches)
        except SetupError as error:
            outcome = Outcome(math.nan, math.nan, math.nan, str(error))
        failed = failed or bool(patches and outcome.error)
        cells += [str(outcome), *([f"{outcome.seconds:.2f}"] if ranks == 1 else [])]
    return cells, failed


def main() -> int:
    """Run all cases; status 1 if one did not reach its end with the server."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--only", help="run only cases whose name contains this")
    parser.add_argument("--out", type=Path, default=Path("out/openfoam-tutorials"))
    options = parser.parse_args()
    if not TUTORIALS.is_dir():
        sys.stderr.write(f"there are no tutorials at {TUTORIALS}; Debian: apt-get install openfoam-examples\n")
        return 69
    build_library(HERE)
    out: Path = options.out.resolve()
    out.mkdir(parents=True, exist_ok=True)
    sys.stdout.write("| case | steps | original | s | plugin | s | plugin, two ranks |\n" + "|---" * 7 + "|\n")
    good = True
    for tutorial in CASES:
        if (options.only or "") not in tutorial.name:
            continue
        cells, failed = row(tutorial, out / f"{tutorial.name}-".replace(" ", "-"))
        good = good and not failed
        sys.stdout.write(f"| {tutorial.name} | {tutorial.steps} of {tutorial.dt:g} s | {' | '.join(cells)} |\n")
        sys.stdout.flush()
    return int(not good)


if __name__ == "__main__":
    sys.exit(main())
