"""The program with a server: it runs to its end, continues after a kill, and reports an error in one line.

With preCICE's stub, what adapters/precice/README.md begins with.
"""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

HERE = Path(__file__).parent
ROOT = HERE.parents[2]


@pytest.fixture
def program(tmp_path, script, server):
    """Runs the program with the stub as the module precice."""
    (tmp_path / "precice.py").write_text("from precice_stub import Participant\n__all__ = ['Participant']\n")

    def run(*arguments, iterations=(2, 1), endpoint=server.endpoint, **more):
        more = {"log": str(tmp_path / "written.npz")} | more
        (tmp_path / "script.json").write_text(json.dumps(script(list(iterations), **more)))
        paths = [tmp_path, HERE, ROOT / "adapters" / "precice", os.environ.get("PYTHONPATH", "")]
        environment = os.environ | {"PYTHONPATH": os.pathsep.join(map(str, filter(None, map(str, paths))))}
        server_option = ["--server", endpoint] if endpoint else []
        return subprocess.run(
            [sys.executable, "-m", "mesh_motion_precice", "mesh-motion.toml", *server_option, *arguments],
            cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=120, check=False,
        )  # fmt: skip

    return run


def test_it_couples_to_the_end_and_again_from_there(case, program, tmp_path):
    case()
    done = program()
    assert done.returncode == 0, done.stderr
    lines = done.stdout.splitlines()
    assert lines[0].endswith("begins")
    assert lines[1].startswith("window 1  t 0.1  2 iterations  min size-skew 0.")
    with np.load(tmp_path / "written.npz") as written:
        assert len(written.files) == 3
        assert np.abs(written["arr_2"]).max() > 1e-3
    (tmp_path / "mesh.npz").rename(tmp_path / "other.npz")
    again = program("--restart", "--mesh", "other.npz", "--config", "script.json", iterations=[1])
    assert again.returncode == 0, again.stderr
    assert "goes on after window 2" in again.stdout
    assert "window 3" in again.stdout
    assert (tmp_path / "mesh-motion.session").stat().st_mode & 0o777 == 0o600


def test_a_wrong_key_is_one_line(case, program, tmp_path):
    case(method="support_radios = 1.0")
    done = program()
    assert done.returncode == 1
    assert done.stderr.count("\n") == 1
    assert "support_radios" in done.stderr


def test_a_refusal_ends_while_the_others_wait(case, program):
    """preCICE's destructor would finalize, and wait for participants that themselves wait for this one."""
    case()
    done = program(window=3.0, motion=[[5.0, 0.0], [0.0, 5.0]], iterations=(1, 1), wait_in_finalize=True)
    assert done.returncode == 1
    assert done.stdout.count("window") == 1
    assert done.stderr.count("\n") == 1


def test_ctrl_c_is_one_line(case, program):
    case()
    done = program(interrupt=2, wait_in_finalize=True)
    assert (done.returncode, done.stderr.count("\n")) == (130, 1)
    assert "interrupted" in done.stderr


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"participant": "Motion"}, "preCICE: no participant MeshMotion"),
        ({"dimensions": 3}, "has 3 dimensions"),
        ({"initial_data": True, "received": [[9.0, 9.0]]}, "initial data cannot be written to the received mesh"),
    ],
)
def test_an_error_of_the_set_up_keeps_the_earlier_session(wrong, words, case, program, tmp_path, server):
    case(volume="received = true" if "received" in wrong else "")
    (tmp_path / "mesh-motion.session").write_text("of an earlier run")
    before = len(server.sessions())
    done = program(**{key: np.array(value) if key == "received" else value for key, value in wrong.items()})
    assert done.returncode == 1
    assert done.stderr.count("\n") == 1
    assert words in done.stderr
    assert (tmp_path / "mesh-motion.session").read_text() == "of an earlier run"
    assert len(server.sessions()) == before


def test_several_ranks_are_refused(case, program, monkeypatch):
    monkeypatch.setenv("OMPI_COMM_WORLD_SIZE", "2")
    case()
    assert "is one process, got 2 ranks" in program().stderr


def test_the_log_says_more_or_less(case, program):
    case()
    assert program("--log-level", "warning").stdout == ""
    assert "iteration 1 of t 0.1 is repeated" in program("--log-level", "debug").stdout
