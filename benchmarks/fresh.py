"""Measurements in separate processes that print JSON."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from typing import Any

__all__ = ["measured_in_fresh_process"]

_LIBRARIES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


def measured_in_fresh_process(module: str, threads: int, *words: str, timeout: float | None = None) -> dict[str, Any]:
    """The output of ``python -m benchmarks.MODULE WORDS`` with the given number of threads for the kernels.

    Raises
    ------
    subprocess.SubprocessError
        If the process fails, or takes longer than the timeout in seconds.
    """
    environment = {**os.environ, **dict.fromkeys(_LIBRARIES, "1"), "MESH_MOTION_THREADS": str(threads)}
    environment["OMP_WAIT_POLICY"] = "passive"
    command = [sys.executable, "-m", f"benchmarks.{module}", *words]
    with subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, text=True, start_new_session=True) as child:
        try:
            printed, _ = child.communicate(timeout=timeout)
        except BaseException:
            os.killpg(child.pid, signal.SIGKILL)  # a server and its workers belong to it
            raise
    if child.returncode:
        raise subprocess.CalledProcessError(child.returncode, command)
    return dict(json.loads(printed))
