"""The C client and the C++ header against a scripted server, and against the real one."""

import contextlib
import json
import os
import shlex
import shutil
import signal
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from mesh_motion_client import Credentials, Mesh, Patch, connect
from mesh_motion_conformance.command import Subject, conform

from mesh_motion_server.security.key_folder import admit, make_client_keys, make_server_keys
from tests.faults.server_process import ServerProcess


def failed(driver, *only):
    lines = []
    outcomes = conform(Subject(client=shlex.quote(str(driver))), lines.append, only=list(only), quiet=True)
    assert outcomes
    return [outcome.case.id for outcome in outcomes if outcome.verdict != "PASS"], "\n".join(lines)


def sources_of(tools, folder, name):
    """A program, with the module that it uses before it."""
    module = [tools["source"] / "fortran" / "mesh_motion.f90"] * name.endswith(".f90")
    return [*module, tools["source"] / folder / name]


@pytest.mark.nightly
def test_every_scenario_in_every_language(compiler, tools):
    written = {"driver.c": "gcc", "driver.cpp": "g++", "driver.f90": "gfortran"}
    names = [name for name, needed in written.items() if shutil.which(needed)]
    drivers = [compiler.program(*sources_of(tools, "conformance", name)) for name in names]
    with ThreadPoolExecutor(len(drivers)) as pool:  # they wait most of the time
        for name, (cases, lines) in zip(names, pool.map(failed, drivers), strict=True):
            assert cases == [], f"{name}\n{lines}"


@pytest.mark.parametrize(
    ("sound", "faulty", "case"),
    [
        ("is_kept(request) && before->number", "0", "10.1-MOVE-repeated-by-the-caller"),
        ("how == FAILED && session->has_trial &&", "0 &&", "11.4-worker-died-before-COMMIT-was-executed"),
        ('session->has_trial ? "trial" : "committed"', '"committed"', "24.2-derivatives-at-the-trial"),
        ("got->reply.sequence == request->sequence\n", "got->reply.sequence\n", "4-replies-to-others-come-first"),
        ("mmi_integer_field(probed, \"epoch\") <= session->epoch", "1", "11.3-fenced-while-the-connection-was-broken"),
    ],
)  # fmt: skip
def test_the_suite_finds_a_seeded_fault(compiler, tools, tmp_path, sound, faulty, case):
    client = tools["seeded"](tmp_path, (sound, faulty))
    driver = compiler.program(tools["source"] / "conformance" / "driver.c", client=client)
    assert failed(driver, case)[0] == [case]


@pytest.mark.parametrize(("name", "needed"), [("block.c", "gcc"), ("block.cpp", "g++"), ("block.f90", "gfortran")])
def test_the_example_answers_as_the_python_client(compiler, check_example, tools, name, needed):
    tools["need"](needed)
    # arrays of a Fortran main program live until its end, but the leak check comes before it
    options = os.environ | {"ASAN_OPTIONS": f"detect_leaks={int(name != 'block.f90')}"}
    check_example(compiler.program(*sources_of(tools, "examples", name)), env=options)


@pytest.mark.nightly
def test_valgrind_finds_nothing(installed, check_example, tools, tmp_path):
    tools["need"]("valgrind")
    source, program = tools["source"] / "examples" / "block.c", tmp_path / "block"
    tools["compile"](
        ["gcc", "-g", source, f"-I{installed}/include", f"-L{installed}/lib", "-lmesh_motion", "-o", program]
    )
    options = ["--error-exitcode=9", "--leak-check=full", "--show-leak-kinds=all", "--errors-for-leak-kinds=all", "-q"]
    check_example("valgrind", *options, program, env=os.environ | {"LD_LIBRARY_PATH": f"{installed}/lib"})


def test_errors(compiler, endpoint, tools):
    done = subprocess.run(
        [compiler.program(tools["here"] / "errors.c"), endpoint],
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


@pytest.mark.parametrize("name", ["list.cpp", pytest.param("list.f90", marks=pytest.mark.nightly)])
def test_sessions_are_listed(compiler, tools, tmp_path, name):
    tools["need"]("gfortran" if name.endswith(".f90") else "g++")
    module = [tools["source"] / "fortran" / "mesh_motion.f90"] * name.endswith(".f90")
    mesh = Mesh(np.eye(3)[:, :2], {"triangle": np.array([[2, 0, 1]])}, {"all": Patch("moving", np.arange(3))})
    with connect(state=tmp_path) as server, server.open(mesh, label="the flap's") as session:
        printed = tools["run"](
            [compiler.program(*module, tools["here"] / name), server.endpoint],
            env=os.environ | {"ASAN_OPTIONS": "detect_leaks=0"},
        )
        listed = json.loads(printed)
        (entry,) = listed if name.endswith(".f90") else [listed]
        assert (entry["session"], entry["label"], entry["step"]) == (session.credentials.session, "the flap's", 0)
        assert entry == server.sessions()[0]


@pytest.mark.parametrize("name", ["patches.cpp", "patches.f90"])
def test_a_resumed_session_names_its_moving_patches(compiler, tools, tmp_path, name):
    """After its end a program knows the nodes by patch, in the order of upload, although it has no mesh."""
    tools["need"]("gfortran" if name.endswith(".f90") else "g++")
    module = [tools["source"] / "fortran" / "mesh_motion.f90"] * name.endswith(".f90")
    points = np.array([[0, 0], [1, 0], [1, 1], [0, 1], [0.5, 0.5]], dtype=float)
    triangles = np.array([[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]])
    patches = {"wall": Patch("fixed", [0]), "wing": Patch("moving", [3, 2]), "flap": Patch("moving", [2, 1])}
    with connect(state=tmp_path) as server:
        with server.open(Mesh(points, {"triangle": triangles}, patches)) as session:
            session.move(np.full((3, 2), 0.01), time=0.25)
            session.commit(time=0.25)
            session.credentials.save(tmp_path / "credentials")
        program = compiler.program(*module, tools["here"] / name)
        options = os.environ | {"ASAN_OPTIONS": "detect_leaks=0"}
        printed = tools["run"]([program, server.endpoint, tmp_path / "credentials"], env=options)
    time, *nodes = printed.splitlines()
    assert float(time) == 0.25
    assert [line.split() for line in nodes] == [["wing", "3", "2"], ["flap", "2", "1"], ["wall"]]


@pytest.mark.parametrize("name", ["velocities.cpp", pytest.param("velocities.f90", marks=pytest.mark.nightly)])
def test_velocities_and_swept_volumes(compiler, endpoint, tools, name):
    """bdf2 of 0, 0.1 and 0.3 at steps of 0.25 s is (1.5 · 0.3 - 2 · 0.1) / 0.25 = 1; only two faces of three move."""
    tools["need"]("gfortran" if name.endswith(".f90") else "g++")
    module = [tools["source"] / "fortran" / "mesh_motion.f90"] * name.endswith(".f90")
    program = compiler.program(*module, tools["here"] / name)
    printed = tools["run"]([program, endpoint], env=os.environ | {"ASAN_OPTIONS": "detect_leaks=0"}).split()
    if name.endswith(".cpp"):
        assert printed.pop(0) == "INVALID_ARGUMENT.VALUE"
    found = np.array(printed, dtype=float)
    np.testing.assert_allclose(found[:8], [0, 0, 0, 0, 1, 0, 0, 0], atol=1e-13)
    # of the edges 0 1, 1 2, 2 0 and 0 2, 2 3, 3 0, while the corner goes from (1.1, 1) to (1.3, 1)
    np.testing.assert_allclose(found[8:14], [0, 0.1, -0.1, 0.1, 0, 0], atol=1e-15)
    # the corner's velocity and the areas of two triangles; it falls from 1.1 to 0 at 2 a second; no faces, and all
    np.testing.assert_allclose(found[14:], [0, -2, 2, -0.015, 0.065, 0.55, 0, 6], atol=1e-13)


def test_arrays_of_another_shape_are_refused_f90(compiler, endpoint, tools):
    tools["need"]("gfortran")
    module = tools["source"] / "fortran" / "mesh_motion.f90"
    options = os.environ | {"ASAN_OPTIONS": "detect_leaks=0"}
    printed = tools["run"]([compiler.program(module, tools["here"] / "shapes.f90"), endpoint], env=options)
    *codes, message, hint, last = printed.splitlines()
    assert [*codes, last] == ["INVALID_ARGUMENT"] * 5
    assert "got 4 in row 1" in message
    assert "from 0: add 1" in hint


def test_two_partitions_give_what_one_gives(compiler, endpoint, tools, tmp_path):
    program, credentials = compiler.program(tools["here"] / "two_ranks.c"), tmp_path / "credentials.json"
    (tmp_path / "credentials.json.part").touch(0o644)  # left by an earlier program, readable by everybody
    ranks = [
        subprocess.Popen([program, endpoint, credentials, str(rank), tmp_path / f"{rank}.bin"], stderr=subprocess.PIPE)
        for rank in (0, 1)
    ]
    for rank in ranks:
        assert rank.communicate(timeout=120)[1] == b""
        assert rank.returncode == 0
    n = 8
    j, i = np.divmod(np.arange((n + 1) ** 2), n + 1)
    number = np.arange((n + 1) ** 2).reshape(n + 1, n + 1)
    quads = np.stack([number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]], axis=-1).reshape(-1, 4)
    sides = {"left": Patch("moving", number[:, 0]), "right": Patch("fixed", number[:, -1])}
    mesh = Mesh(np.stack([i, j], axis=1) / n, {"quad": quads}, sides)
    with connect(endpoint) as server, server.open(mesh) as session:
        for step in (1, 2, 3):
            y = mesh.points[session.moving_nodes][:, 1]
            session.move(np.stack([0.01 * step * y, np.full_like(y, 0.01 * step)], axis=1), frame="committed")
            session.commit()
        whole = session.points().reshape(n + 1, n + 1, 2)
        session.close("discard")
    for rank in (0, 1):
        part = np.fromfile(tmp_path / f"{rank}.bin").reshape(n // 2 + 1, n + 1, 2)
        np.testing.assert_array_equal(part, whole[rank * n // 2 : rank * n // 2 + n // 2 + 1])
    assert Credentials.load(credentials).token  # the Python client reads what the C client wrote
    assert credentials.stat().st_mode & 0o777 == 0o600


def test_keys(compiler, tools, tmp_path, check_example):
    folder = tmp_path / "keys"
    make_server_keys(folder)
    for name in ("alice", "mallory"):
        make_client_keys(name, tmp_path / name)
    admit(str(tmp_path / "alice" / "alice.public"), folder)
    program = compiler.program(tools["source"] / "examples" / "block.c")
    with ServerProcess(tmp_path / "served", level="error", keys_folder=str(folder)) as server:

        def refused(**environment):
            done = subprocess.run(
                [program, server.endpoint],
                env=os.environ | environment,
                capture_output=True,
                text=True,
                check=False,
                timeout=90,
            )
            assert done.returncode == 1
            return done.stderr

        def keys(name):
            secret = tmp_path / name / f"{name}.secret"
            return {"MESH_MOTION_KEY": str(secret), "MESH_MOTION_SERVER_KEY": str(folder / "server.public")}

        printed = tools["run"]([program, server.endpoint], env=os.environ | keys("alice"))
        assert "minimum quality" in printed
        # on a busy machine a line about the silent server may come before it
        assert "\nUNAUTHENTICATED" in f"\n{refused(**keys('mallory'))}"
        assert "\nUNAUTHENTICATED" in f"\n{refused()}"
        assert "both" in refused(MESH_MOTION_KEY="x")
        (tmp_path / "alice" / "alice.secret").chmod(0o644)
        assert "0644" in refused(**keys("alice"))


@contextlib.contextmanager
def stopped_server(here):
    process = subprocess.Popen(
        [sys.executable, here / "stopped_server.py"],
        env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)},
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        yield process, process.stdout.readline().strip()
    finally:
        process.kill()
        process.communicate()


def lent_arrays(program, here, patience=1.0):
    """Output and exit status of a program that frees its arrays after a time-out; then the server continues to read."""
    with stopped_server(here) as (server, endpoint):
        pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
        with subprocess.Popen([program, endpoint], text=True, **pipes) as process:
            code = process.stdout.readline().strip()
            os.kill(server.pid, signal.SIGCONT)
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(patience)  # for a fault to show
            process.communicate("\n", timeout=60)
            return code, process.returncode


def test_arrays_are_the_callers_again_after_a_time_out(compiler, tools):
    program = compiler.program(tools["here"] / "lent_arrays.c")
    assert lent_arrays(program, tools["here"]) == ("DEADLINE_EXCEEDED", 0)


def test_an_array_that_is_kept_too_long_is_seen(compiler, tools, tmp_path):
    client = tools["seeded"](
        tmp_path,
        ("    mmi_take_back_arrays(connection);\n", ""),
        ("            mmi_disconnect(connection); /* the connection may be dead without an event */\n", ""),
    )
    program = compiler.program(tools["here"] / "lent_arrays.c", client=client)
    # sometimes everything has been read before the server stops, and no read is too late
    assert any(lent_arrays(program, tools["here"], patience=3)[1] != 0 for _ in range(6))
