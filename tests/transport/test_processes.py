"""Initial state of a child of the supervisor."""

import os
import signal
import socket
import sys
from pathlib import Path
from typing import Any

import pytest
from python_runs import said_by_python

from mesh_motion_server.operation.tally import TALLY
from mesh_motion_server.transport.processes import repeatable_libraries, spawn

MODULE = """
import os, signal, sys
from mesh_motion_server.operation.tally import TALLY
from mesh_motion_server.transport.channel import Channel

def main(channel, *names):
    channel.send({
        "names": {name: os.environ.get(name, "") for name in names},
        "counted": bool(TALLY),
        "sigterm": signal.getsignal(signal.SIGTERM) is signal.SIG_DFL,
        "blocked": len(signal.pthread_sigmask(signal.SIG_BLOCK, ())),
        "parent": "only_the_parent_has" in sys.modules,
        "descriptors": len(os.listdir("/dev/fd")),
    })
    return 7

if __name__ == "__main__":
    sys.exit(main(Channel.inherited(int(sys.argv[1])), *sys.argv[2:]))
"""


@pytest.fixture(autouse=True)
def module(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "says.py").write_text(MODULE, encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setenv("PYTHONPATH", f"{tmp_path}{os.pathsep}{os.environ.get('PYTHONPATH', '')}")
    monkeypatch.setitem(sys.modules, "only_the_parent_has", os)


def threads_of(*names: str, **options: Any) -> dict[str, Any]:
    """Output of a child, which then ends with status 7."""
    child = spawn("says", *names, **options)
    said = child.channel.receive(30.0)
    assert child.reap() == 7
    assert said is not None
    return said


@pytest.mark.parametrize("fresh", [False, True])
def test_the_threads_of_loops_and_of_blas_are_reported(fresh: bool) -> None:
    expected = {"MESH_MOTION_THREADS": "3", "OPENBLAS_NUM_THREADS": "1"} | repeatable_libraries()
    assert threads_of(*expected, threads=3, fresh=fresh)["names"] == expected


LIBRARIES = """
import numpy, scipy.linalg, threadpoolctl
print(numpy.lib.introspect.opt_func_info("^log$")["log"]["dd"]["current"])
for library in threadpoolctl.threadpool_info():
    print(library["internal_api"], library["architecture"], library["num_threads"])
"""


def test_libraries_take_the_code_of_any_processor_with_avx2() -> None:
    if "OPENBLAS_CORETYPE" not in repeatable_libraries():
        pytest.skip("this processor has no AVX2")
    log, *blas = said_by_python("-c", LIBRARIES, env=os.environ | repeatable_libraries()).splitlines()
    assert not {"AVX512_SKX", "X86_V4"} & set(log.split())
    assert set(blas) == {"openblas Haswell 1"}


def test_numpy_starts_where_its_warnings_are_errors() -> None:
    module = "mesh_motion_server.transport.processes"
    said_by_python("-W", "error", "-c", f"from {module} import use_repeatable_libraries as use; use(); import numpy")


def test_a_child_has_its_own_counts_signals_and_descriptors() -> None:
    """0 to 2, its line, /dev/null and the listing."""
    TALLY.count("worker_starts")
    before = signal.signal(signal.SIGTERM, lambda *_: None)
    ours, theirs = socket.socketpair()
    try:
        said = threads_of()
        assert TALLY
    finally:
        signal.signal(signal.SIGTERM, before)
        TALLY.take()
        ours.close()
        theirs.close()
    assert (said["counted"], said["sigterm"], said["blocked"], said["parent"]) == (False, True, 0, True)
    assert said["descriptors"] <= 6


def test_processes_that_listen_to_other_machines_share_no_memory_with_the_supervisor() -> None:
    assert not threads_of(fresh=True)["parent"]


def test_a_module_that_cannot_be_imported_is_a_failure_of_the_child_alone(
    capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "excepthook", sys.__excepthook__)
    child = spawn("no_such_module")
    assert child.channel.receive(30.0) is None
    assert child.reap() == 1
    assert "no_such_module" in capfd.readouterr().err
