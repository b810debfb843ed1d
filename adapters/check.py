"""Build and test every client whose tools are installed, and list the missing tools: ``make adapters``."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
_C = ("gcc", "cmake", "pkg-config", "libzmq")
_CHOSEN_C = "not cpp and not f90 and not every_scenario"
#: The programs that each client's tests need, and the choice of these tests (pytest's -k, "" for all).
ADAPTERS: dict[str, tuple[tuple[str, ...], tuple[str, ...], str]] = {
    "Python": ((), ("tests/client", "tests/conformance/test_our_client.py"), ""),
    "C": (_C, ("tests/adapters/c",), _CHOSEN_C),
    "C++": (("g++", *_C), ("tests/adapters/c",), "cpp"),
    "Fortran": (("gfortran", *_C), ("tests/adapters/c",), "f90"),
    "OpenFOAM": (("moveDynamicMesh", "g++", *_C), ("tests/adapters/openfoam",), ""),
    "CalculiX": (("ccx",), ("tests/adapters/calculix",), ""),
    "FSI driver": ((), ("tests/adapters/fsi",), "not test_flap and not test_turek"),
    "OpenFOAM and CalculiX": (("pimpleFoam", "g++", *_C, "ccx"), ("tests/adapters/fsi",), "test_flap or test_turek"),
    "preCICE, by its stub": ((), ("tests/adapters/precice",), "not real"),
    "preCICE": (("precice",), ("tests/adapters/precice",), "real"),
    "Kratos, by a stand-in": ((), ("tests/adapters/kratos/test_kratos_participant.py",), ""),
    "Kratos": (("KratosMultiphysics",), ("tests/adapters/kratos",), "solver or benchmark"),
    "OpenMDAO": (("openmdao",), ("tests/adapters/openmdao",), ""),
    "NGSolve": (("ngsolve",), ("tests/adapters/howto",), "ngsolve"),
    "dolfinx": (("dolfinx",), ("tests/adapters/howto",), "dolfinx"),
    "conformance of those built": (_C, ("tests/adapters/c",), "every_scenario"),
}
#: The folder into which adapters/kratos/environment.sh installs.
_CACHE = Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "mesh-motion"
#: The Python programs in which each code's modules are searched, in this order.
PYTHONS: dict[str, tuple[str | None, ...]] = {
    "precice": (sys.executable,),
    "KratosMultiphysics": (os.environ.get("KRATOS_PYTHON") or f"{_CACHE}/kratos-10.4/bin/python", sys.executable),
    "openmdao": (sys.executable,),
    "ngsolve": (os.environ.get("NGSOLVE_PYTHON"), sys.executable),
    "dolfinx": (os.environ.get("DOLFINX_PYTHON"), sys.executable, "/usr/bin/python3"),
}


def is_missing(tool: str) -> bool:
    """Return True if a program, a module of this Python, or a library for the compiler is not installed."""
    if tool in PYTHONS:
        command = f"import {tool}"
        pythons = [python for python in PYTHONS[tool] if python and shutil.which(python)]
        runs = (subprocess.run([python, "-c", command], capture_output=True, check=False) for python in pythons)
        return all(run.returncode != 0 for run in runs)
    if tool == "libzmq":
        return subprocess.run(["pkg-config", "--exists", "libzmq"], check=False).returncode != 0
    return shutil.which(tool) is None


def main() -> int:
    """Print one line for each client; return 1 if any client's tests failed."""
    results = {}
    for name, (tools, tests, chosen) in ADAPTERS.items():
        missing = []
        for tool in tools:  # in their order: pkg-config before what it is asked for
            if "pkg-config" not in missing and is_missing(tool):
                missing.append(tool)
        if missing:
            results[name] = f"not built: {', '.join(missing)} not installed"
            continue
        command = [sys.executable, "-m", "pytest", "-q", *tests, *(["-k", chosen] if chosen else [])]
        done = subprocess.run(command, cwd=ROOT, check=False)
        results[name] = "FAILED" if done.returncode else "passed"
    sys.stdout.write("\n".join(f"{name:26} {result}" for name, result in results.items()) + "\n")
    return int("FAILED" in results.values())


if __name__ == "__main__":
    sys.exit(main())
