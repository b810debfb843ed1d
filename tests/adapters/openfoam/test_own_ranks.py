"""``evaluation client``: OpenFOAM's ranks move and judge their own nodes, as a server with the whole mesh does."""

import os
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

pytestmark = pytest.mark.nightly

ROOT = Path(__file__).resolve().parents[3]
METHOD = "quality_threshold 0.1; displacement absolute; correction none; sub_steps never;"
#: The least quality of the plain motion is 0.41.
CORRECTED = METHOD.replace("none;", "optimised; correction_target threshold;").replace("threshold 0.1", "threshold 0.6")


@pytest.fixture(scope="module")
def evaluating(foam_environment, c_kernels, tmp_path_factory):
    """The environment with a library that has the compiled kernels."""
    folder = tmp_path_factory.mktemp("evaluating")
    built = {"OUT": str(folder / "library"), "MESH_MOTION_KERNELS": str(c_kernels), "CXXFLAGS": "-O0"}  # half the time
    adapter = ROOT / "adapters" / "openfoam"
    done = subprocess.run(
        ["./Allwmake"], cwd=adapter, env=os.environ | built, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]
    return {"LD_LIBRARY_PATH": f"{folder / 'library'}:{foam_environment['LD_LIBRARY_PATH']}"}


@pytest.fixture
def make(make_case):
    def made_case(name, evaluation, method=METHOD, **options):
        case = make_case(name, **options)
        case.set("constant/dynamicMeshDict", walls="fixed")
        case.method(method, f"evaluation {evaluation};")
        return case

    return made_case


def qualities(output):
    """The report of each move, without the server's seconds."""
    return [line.partition(" enrichment")[0] for line in output.splitlines() if "least quality" in line]


@pytest.mark.parametrize("method", [METHOD, CORRECTED], ids=["plain", "corrected"])
def test_ranks_move_the_mesh_as_a_server_does(make, evaluating, method):
    cases = ("whole", "server"), ("serial", "client"), ("parallel", "client")
    whole, serial, parallel = (make(*case, method) for case in cases)
    for case in (serial, parallel):
        case.environment |= evaluating
    expected = qualities(whole.run("moveDynamicMesh"))
    assert len(expected) == 12
    assert qualities(serial.run("moveDynamicMesh")) == expected
    np.testing.assert_array_equal(serial.points("0.2"), whole.points("0.2"))
    parallel.run("decomposePar")
    assert qualities(parallel.run("moveDynamicMesh", ranks=2)) == expected
    parallel.check_ranks("0.2", whole.points("0.2"))


def test_with_nothing_set_two_ranks_give_what_one_gives(make, evaluating):
    whole, serial, parallel = make("whole", "server", ""), make("serial", "client", ""), make("parallel", "client", "")
    for case in (serial, parallel):
        case.environment |= evaluating
        case.set("system/controlDict", writePrecision="17")
    whole.run("moveDynamicMesh")
    serial.run("moveDynamicMesh")
    parallel.run("decomposePar")
    parallel.run("moveDynamicMesh", ranks=2)
    parallel.check_ranks("0.2", serial.points("0.2"))
    np.testing.assert_allclose(serial.points("0.2"), whole.points("0.2"), rtol=0, atol=1e-5)  # as it is written


@pytest.mark.parametrize("kept", [True, False])
@pytest.mark.parametrize("ranks", [1, 2])
def test_a_restart_goes_on_as_if_it_had_not_been(make, evaluating, ranks, kept):
    whole, parts = make("whole", "client"), make("parts", "client")
    for case in (whole, parts):
        case.environment |= evaluating
        case.set("system/controlDict", writePrecision="17")
    expected = qualities(whole.run("moveDynamicMesh"))
    parts.set("system/controlDict", endTime="0.1")
    if ranks == 2:
        parts.run("decomposePar")
    assert qualities(parts.run("moveDynamicMesh", ranks=ranks)) == expected[:6]
    if not kept:
        shutil.rmtree(parts.folder / ("processor0" if ranks == 2 else ".") / "0.1/uniform/remoteMeshMotion")
    parts.set("system/controlDict", endTime="0.2")
    output = parts.run("moveDynamicMesh", ranks=ranks)
    assert ("goes on after step 2" in output) == kept
    least = [line.partition("iteration")[2] for line in qualities(output)]
    assert least == [line.partition("iteration")[2] for line in expected[6:]]
    if ranks == 2:
        parts.check_ranks("0.2", whole.points("0.2"))
    else:
        np.testing.assert_allclose(parts.points("0.2"), whole.points("0.2"), rtol=0, atol=1e-14)


def test_a_method_that_takes_the_volume_is_refused(make, evaluating):
    case = make("case", "client")
    case.environment |= evaluating
    case.method(METHOD.replace("correction none", "correction enrichment"), "evaluation client;")
    assert "expected correction = 'none' or 'smooth' or 'optimised'" in case.run("moveDynamicMesh", expect=1)


def test_a_library_without_the_kernels_says_so(make):
    case = make("case", "client")
    assert "built without evaluation by the client" in case.run("moveDynamicMesh", expect=1)
