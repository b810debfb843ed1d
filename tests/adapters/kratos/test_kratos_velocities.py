"""The velocities of time schemes against Kratos' ``CalculateMeshVelocities``, with steps of several sizes."""

import json
from pathlib import Path

import numpy as np
import pytest
from mesh_motion_numerics.motion.time_levels import STORED_ARRAYS, TimeLevel, level_after, scheme_velocity

PLAYER = Path(__file__).with_name("velocities_in_kratos.py")
TIMES = np.array([0.0, 0.1, 0.25, 0.3, 0.5, 0.55])


@pytest.mark.parametrize("scheme", ["bdf1", "bdf2", "bossak"])
def test_velocities_are_those_of_kratos(run_in_kratos, tmp_path, scheme):
    shape = np.random.default_rng(4).standard_normal((5, 3))
    x = [np.sin(3.0 * t) * shape + t**2 * shape[::-1] for t in TIMES]
    (tmp_path / "in.json").write_text(
        json.dumps({"scheme": scheme, "times": TIMES.tolist(), "displacements": [rows.tolist() for rows in x]})
    )
    done = run_in_kratos(PLAYER, "in.json", "out.json", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    theirs = np.array(json.loads((tmp_path / "out.json").read_text()))
    level, stored = TimeLevel(TIMES[0]), scheme if scheme in STORED_ARRAYS else ""
    for step in range(1, len(TIMES)):
        ours = scheme_velocity(scheme, x[step], x[step - 1], level, TIMES[step])
        level = level_after(stored, x[step], x[step - 1], level, TIMES[step])
        if scheme == "bdf2" and step == 1:
            continue  # Kratos takes a position from before the first one, where the mesh was at rest
        np.testing.assert_allclose(theirs[step - 1], ours, rtol=0, atol=1e-11)
