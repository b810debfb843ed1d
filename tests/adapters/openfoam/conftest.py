"""The motion solver built against the installed OpenFOAM, a server for it, and cases to run."""

import os
import re
import shutil
import subprocess
import time
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from mesh_motion_client.embedded import EmbeddedServer

from tests.faults.server_process import ServerProcess

ADAPTER = Path(__file__).resolve().parents[3] / "adapters" / "openfoam"
TUTORIAL = ADAPTER / "tutorial" / "pitchingPlate"
PATIENCE = 240.0
HEADERS = ("OpenFOAM", "OSspecific/POSIX", "finiteVolume", "meshTools")


@pytest.fixture(scope="session")
def foam_environment():
    """Environment of OpenFOAM's programs; builds the library first."""
    if shutil.which("moveDynamicMesh") is None:
        pytest.skip("OpenFOAM is not installed (Debian: openfoam)")
    built = subprocess.run(["./Allwmake"], cwd=ADAPTER, capture_output=True, text=True, check=False)
    if built.returncode == 69:
        pytest.skip(built.stderr.strip().splitlines()[-1])
    assert built.returncode == 0, built.stderr[-3000:]
    headers = subprocess.run(["./headers.sh"], cwd=ADAPTER, capture_output=True, text=True, check=True).stdout.strip()
    root = os.environ.get("WM_PROJECT_DIR", "/usr/share/openfoam")
    return os.environ | {
        "FOAM_ETC": f"{root}/etc",
        "WM_PROJECT_DIR": root,
        "LD_LIBRARY_PATH": f"{ADAPTER / 'build'}:{os.environ.get('LD_LIBRARY_PATH', '')}",
        "OPENFOAM_HEADERS": headers,
        "OMPI_ALLOW_RUN_AS_ROOT": "1",
        "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1",
    }


@pytest.fixture(scope="session")
def compile_foam(foam_environment):
    """A function: source, result and further options of the compiler → the result, built with OpenFOAM's headers."""
    headers = Path(foam_environment["OPENFOAM_HEADERS"]) / "src"
    places = [word for part in HEADERS for word in ("-isystem", headers / part / "lnInclude")]
    options = [
        "-std=c++11",
        "-DOPENFOAM=1912",
        "-DWM_DP",
        "-DWM_LABEL_SIZE=32",
        "-DNoRepository",
        "-fPIC",
        "-ftemplate-depth-100",
    ]

    def build(source, built, *further):
        subprocess.run(["g++", *options, *places, source, "-o", built, *further], check=True)
        return built

    return build


@pytest.fixture(scope="session")
def mesh_motion_server():
    server = EmbeddedServer(None, 120.0, ["--threads", "1"])
    yield server
    server.stop()


@pytest.fixture
def own_server():
    """A server that a test may kill."""
    with TemporaryDirectory() as folder, ServerProcess(Path(folder), endpoint=f"ipc://{folder}/control") as server:
        yield server  # the folder's path is short, as the path of a socket must be


@dataclass
class Case:
    folder: Path
    environment: dict[str, str]
    output: str = field(default="")

    def set(self, name, **values):
        """Existing entries of one dictionary."""
        path = self.folder / name
        text = path.read_text()
        for key, value in values.items():
            text, count = re.subn(rf"(?m)^(\s*{key}\s+)[^;{{]*;", rf"\g<1>{value};", text)
            assert count == 1, f"{key} in {name}"
        path.write_text(text)

    def method(self, text, further=""):
        """The settings, and further entries of the dictionary."""
        path = self.folder / "constant" / "dynamicMeshDict"
        head = path.read_text().split("    method")[0]
        path.write_text(f"{head}    method {{ {text} }}\n    {further}\n}}\n")

    def run(self, *command, ranks=1, expect=0):
        if ranks > 1:
            command = ["mpirun", "--oversubscribe", "-np", str(ranks), *command, "-parallel"]
        done = subprocess.run(
            command, cwd=self.folder, env=self.environment, capture_output=True, text=True, check=False,
            timeout=PATIENCE,
        )  # fmt: skip
        self.output = done.stdout + done.stderr
        assert (done.returncode == 0) == (expect == 0), f"{command}\n{self.output[-4000:]}"
        return self.output

    def start(self, *command, log):
        return subprocess.Popen(command, cwd=self.folder, env=self.environment, stdout=log, stderr=log)

    def wait_for(self, solver, words, pause=0.01):
        """Wait until a program that runs has written words to the file ``log``."""
        log = self.folder / "log"
        while words not in log.read_text():
            assert solver.poll() is None, log.read_text()[-3000:]
            time.sleep(pause)

    def check_ranks(self, time, expected, ranks=2, atol=1e-10):
        """Check that the points written by the ranks are those of the whole mesh."""
        met = np.zeros(len(expected), dtype=int)
        for rank in range(ranks):
            address = self.numbers(f"processor{rank}/constant/polyMesh/pointProcAddressing", 1)[:, 0].astype(int)
            points = self.numbers(f"processor{rank}/{time}/polyMesh/points", 3)
            np.testing.assert_allclose(points, expected[address], rtol=0, atol=atol)
            met[address] += 1
        assert met.min() == 1
        assert met.max() == 2

    def numbers(self, name, columns):
        """The list in an ASCII file, one row per item."""
        body = re.search(r"\n\s*(\d+)\s*\n\((.*?)\n\)", (self.folder / name).read_text(), re.DOTALL)
        values = np.array(re.sub(r"[()]", " ", body[2]).split(), dtype=float).reshape(-1, columns)
        assert len(values) == int(body[1])
        return values

    def points(self, time):
        return self.numbers(f"{time}/polyMesh/points", 3)

    def faces(self):
        body = (self.folder / "constant/polyMesh/faces").read_text()
        return [[int(label) for label in face.split()] for face in re.findall(r"\d\(([\d ]+)\)", body)]

    def patch(self, name):
        body = (self.folder / "constant/polyMesh/boundary").read_text()
        found = re.search(rf"\b{name}\s*\{{.*?nFaces\s+(\d+);.*?startFace\s+(\d+);", body, re.DOTALL)
        return range(int(found[2]), int(found[2]) + int(found[1]))


@pytest.fixture(scope="session")
def meshed_case(tmp_path_factory, foam_environment):
    """The tutorial case after blockMesh, for copies."""
    case = Case(tmp_path_factory.mktemp("foam") / "case", foam_environment)
    shutil.copytree(TUTORIAL, case.folder)
    case.run("blockMesh")
    return case


@pytest.fixture
def make_case(meshed_case, mesh_motion_server, tmp_path):
    """Copies of the meshed case, which use the server of the tests."""

    def make(name="case", endpoint=None, steps=4):
        folder = tmp_path / name
        shutil.copytree(meshed_case.folder, folder)
        where = endpoint or mesh_motion_server.endpoint
        case = Case(folder, meshed_case.environment | {"MESH_MOTION_ENDPOINT": where})
        case.set("system/controlDict", deltaT="0.05", endTime=f"{0.05 * steps:.2f}", writeInterval="2")
        return case

    return make
