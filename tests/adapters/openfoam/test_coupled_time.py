"""A coupling that sets the time back: iterations, sub-steps, restarts and refusals, with a script instead of
preCICE.
"""

import re
import signal
from pathlib import Path

import numpy as np
import pytest

PATIENCE = 240.0
SOURCE = Path(__file__).with_name("scripted_coupling.C")
SCRIPT = """functions {{ script {{ type scriptedCoupling; libs ("{library}");
    iterations ({iterations}); subSteps ({sub_steps}); windows {windows}; {further} }} }}
"""

#: The plate turns by a radian at once where an iteration goes too far.
REFUSING = "correction none; sub_steps never; quality_threshold 0.3; support_radius 0.2;"


@pytest.fixture(scope="session")
def scripted(tmp_path_factory, compile_foam):
    return compile_foam(SOURCE, tmp_path_factory.mktemp("scripted") / "libscripted.so", "-shared")


@pytest.fixture
def coupled(make_case, scripted):
    """Cases that follow a script, with time steps of 0.05 s."""

    def make(name, iterations="1.5 1", sub_steps=1, windows=4, further="", method="", restart=False):
        case = make_case(name)
        case.set("system/controlDict", endTime="10", writeInterval="1000", writePrecision="17")
        path = case.folder / "0/pointDisplacement"
        fixed = "plate { type fixedValue; value uniform (0 0 0); }"
        path.write_text(re.sub(r"plate\s*\{[^}]*\}", fixed, path.read_text()))
        case.method("correction none; support_radius 0.5;", method)
        script(case, iterations, sub_steps, windows, further)
        return case

    def script(case, iterations, sub_steps, windows, further=""):
        path = case.folder / "system/controlDict"
        head = path.read_text().split("functions")[0]
        text = SCRIPT.format(
            library=scripted, iterations=iterations, sub_steps=sub_steps, windows=windows, further=further
        )
        path.write_text(head + text)

    make.script = script
    return make


def steps(output):
    return [(int(s), int(i)) for s, i in re.findall(r"step (\d+), iteration (\d+): least", output)]


def committed(case, time):
    """The step after which a restart from that time continues."""
    return int(re.search(r"step\s+(\d+);", (case.folder / time / "uniform/remoteMeshMotion/state").read_text())[1])


def test_iterations_of_a_window_are_one_step_however_often_fields_are_written(coupled):
    once, often = coupled("once", "1"), coupled("often", "1.5 0.7 1")
    once.run("moveDynamicMesh")
    often.set("system/controlDict", writeInterval="1")
    output = often.run("moveDynamicMesh")
    assert max(steps(output)) == (4, 9)  # three outer correctors in each iteration
    np.testing.assert_array_equal(often.points("0.2"), once.points("0.2"))


def test_sub_steps_of_a_window_are_one_step(coupled):
    once, often = coupled("once", "1", 2, 2, method="couplingWindow 0.1;"), coupled("often", "1.5 0.7 1", 2, 2)
    once.run("moveDynamicMesh")
    often.set("system/controlDict", writeInterval="1")
    output = often.run("moveDynamicMesh")
    assert "the time went back by 0.1 s, the coupling's window: from now on it is one step" in output
    assert max(steps(output)) == (2, 18)  # three iterations of two sub-steps with three outer correctors
    np.testing.assert_array_equal(often.points("0.2"), once.points("0.2"))


@pytest.mark.parametrize(
    ("sub_steps", "window"), [("2 1 3", 0.0), ("1 3 2", 0.0), ("2 1 3", 0.1)], ids=["fewer", "more", "given"]
)
def test_iterations_of_a_window_may_have_other_sub_steps(coupled, sub_steps, window):
    """As with a time step that follows the Courant number."""
    first, keep = int(sub_steps[0]), "keepWeights yes;"
    once = coupled("once", "1", first, 3, keep, method=f"couplingWindow {0.05 * first};")
    often = coupled("often", "1.5 0.7 1", sub_steps, 3, keep, method=f"couplingWindow {window};" if window else "")
    once.run("moveDynamicMesh")
    output = often.run("moveDynamicMesh")
    assert max(steps(output)) == (3, 18)  # six sub-steps with three outer correctors
    end = f"{0.15 * first:.2g}"
    np.testing.assert_allclose(often.points(end), once.points(end), rtol=0, atol=1e-14)
    assert committed(often, end) == committed(once, end)


def test_a_window_that_is_found_too_late_is_named(coupled):
    case = coupled("case", "1", 2, 1)
    case.run("moveDynamicMesh")
    coupled.script(case, "1.5 1", 2, 1)
    case.run("moveDynamicMesh", expect=1)
    assert "the time went back from 0.2 to 0.1" in case.output
    assert "couplingWindow 0.1;" in case.output


@pytest.mark.parametrize("end", ["", "stopAfter 2;"], ids=["ended", "broken off"])
def test_a_restart_goes_on_with_the_window(coupled, end):
    whole, parts = coupled("whole", "1.5 1", 2, 4), coupled("parts", "1.5 1", 2, 2 + bool(end), end)
    whole.run("moveDynamicMesh")
    first = parts.run("moveDynamicMesh", expect=bool(end))
    coupled.script(parts, "1.5 1", 2, 2)
    output = parts.run("moveDynamicMesh")
    assert "goes on after step 2" in output
    assert max(steps(output))[0] == 4
    faces = [re.search(r"undeformed faces (\S+)", text)[1] for text in (first, output)]
    assert faces[0] == faces[1]
    np.testing.assert_allclose(parts.points("0.4"), whole.points("0.4"), rtol=0, atol=1e-14)


@pytest.mark.nightly
def test_ranks_that_interpolate_from_their_own_faces(coupled):
    serial, parallel = (coupled(name, "1.5 1", 2, 2, "keepWeights yes;") for name in ("serial", "parallel"))
    serial.run("moveDynamicMesh")
    parallel.run("decomposePar")
    output = parallel.run("moveDynamicMesh", ranks=2)
    assert max(steps(output))[0] == 2
    parallel.check_ranks("0.2", serial.points("0.2"))
    coupled.script(parallel, "1.5 1", 2, 2)
    assert "goes on after step 2" in parallel.run("moveDynamicMesh", ranks=2)


@pytest.mark.parametrize("keeps", [True, False])
def test_a_refused_iteration_may_be_followed_by_a_better_one(coupled, keeps):
    method = f"onRefusal {'keep' if keeps else 'fail'};"
    once, case = coupled("once", "1", windows=2), coupled("case", "30 1", windows=2, method=method)
    for each in (once, case):
        each.method(REFUSING, method)
    once.run("moveDynamicMesh")
    output = case.run("moveDynamicMesh", expect=not keeps)
    assert "FAILED_PRECONDITION.QUALITY" in output
    if keeps:
        assert "the mesh stays where it was" in output
        np.testing.assert_array_equal(case.points("0.1"), once.points("0.1"))


@pytest.mark.parametrize("ranks", [1, pytest.param(2, marks=pytest.mark.nightly)])
def test_a_refused_sub_step_may_be_followed_by_a_better_iteration(coupled, ranks):
    """The second window's first iteration is refused in both of its sub-steps; the first window stays committed."""
    keep = "onRefusal keep; couplingWindow 0.1;"
    once, case = (coupled(name, far, 2, 2, "keepWeights yes;") for name, far in (("once", "1"), ("case", "30 1")))
    for each in (once, case):
        each.method(REFUSING, keep)
    once.run("moveDynamicMesh")
    if ranks > 1:
        case.run("decomposePar")
    output = case.run("moveDynamicMesh", ranks=ranks)
    assert output.count("the mesh stays where it was") >= 2
    assert max(steps(output))[0] == 2
    if ranks > 1:
        case.check_ranks("0.2", once.points("0.2"))
    else:
        np.testing.assert_allclose(case.points("0.2"), once.points("0.2"), rtol=0, atol=1e-14)


def test_a_server_that_is_killed_within_a_window_comes_back(coupled, own_server):
    """Its second iteration is repeated by a new server; steps and nodes are those of a run that nothing disturbed."""
    wait = "timeout 2; computeTimeout 5; onServerLoss wait 200;"
    calm, case = (coupled(name, "1.5 0.7 1", 2, 8, method=wait) for name in ("calm", "case"))
    case.environment["MESH_MOTION_ENDPOINT"] = calm.environment["MESH_MOTION_ENDPOINT"] = own_server.endpoint
    log = case.folder / "log"
    with log.open("w") as out:
        solver = case.start("moveDynamicMesh", log=out)
        case.wait_for(solver, "step 2, iteration 7:", 0.005)
        own_server.stop(signal.SIGKILL)
        case.wait_for(solver, "waiting 200 s for the server", 0.05)
        own_server.start()
        assert solver.wait(PATIENCE) == 0, log.read_text()[-3000:]
    output = calm.run("moveDynamicMesh")
    assert max(steps(log.read_text())) == max(steps(output)) == (8, 18)
    np.testing.assert_array_equal(case.points("0.8"), calm.points("0.8"))
    assert committed(case, "0.8") == committed(calm, "0.8")


def test_a_refused_last_iteration_ends_the_run(coupled):
    case = coupled("case", "1 30", windows=2, method="onRefusal keep;")
    case.method(REFUSING, "onRefusal keep;")
    case.run("moveDynamicMesh", expect=1)
    assert "the step's last iteration was refused" in case.output
    assert not (case.folder / "0.05/uniform/remoteMeshMotion/state").exists()
