"""The script of the example with preCICE's tutorials, with stubs instead of the programs that it starts."""

import os
import subprocess
from pathlib import Path

SCRIPT = Path(__file__).resolve().parents[3] / "examples/precice_flap/run.sh"
CLONE = """for to; do :; done
mkdir "$to" || exit 128
cd "$to"
mkdir -p perpendicular-flap/fluid-openfoam/{system,constant/polyMesh}
touch perpendicular-flap/{precice-config.xml,fluid-openfoam/system/controlDict}
"""
FLUID = """printf 'window total iterations\\n1 3 3\\n' >../precice-Solid-iterations.log
printf 'Time x y u\\n1 0 0 2\\n' >../precice-Solid-watchpoint-tip.log
echo 'remoteMeshMotion: step 7,'
"""
SERVER = """echo '{"endpoint": "tcp://127.0.0.1:1"}' >server.ready
exec sleep 60
"""
STUBS = {"git": CLONE, "mesh-motion": SERVER, "pimpleFoam": FLUID, "solid": ""}


def test_a_run_goes_on_in_the_folder_of_the_first(tmp_path: Path) -> None:
    for name, text in STUBS.items():
        (program := tmp_path / name).write_text(f"#!/usr/bin/env bash\n{text}")
        program.chmod(0o755)
    stubs = {"PATH": f"{tmp_path}:{os.environ['PATH']}", "SOLID_PYTHON": "solid", "MOTION": "laplacian"}
    for more in ({}, {"CONTINUE": "1"}):
        done = subprocess.run(
            [SCRIPT, tmp_path], cwd=tmp_path, env=os.environ | stubs | more, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stderr
        assert done.stdout.splitlines()[-3:] == [
            "1 windows, 3 iterations each",
            "Solid-watchpoint-tip.log goes 2 m downstream, at 1 s",
            "steps of the session: 7",
        ]
