"""The mesh solver in Kratos itself: each test plays a job in Kratos' Python (``play_in_kratos.py``).

With the lines that adapters/kratos/README.md begins with.
"""

from pathlib import Path

import numpy as np
import pytest
from mesh_motion_client import Mesh, Patch, connect

WRAPPER = Path(__file__).with_name("wrapper_in_kratos.py")


def wall(plate, displacement):
    return {"wall": displacement[plate.boundary]}


def bent(plate, amount):
    x, y = plate.points.T
    return np.column_stack([amount * x * np.sin(np.pi * y), np.zeros_like(x)])


def test_rigid_rotation_and_velocity(job, plate):
    """The linear polynomial makes rotations exact; MESH_VELOCITY is Kratos' second-order difference of the answers."""
    angles = (0.1, 0.25, 0.3, 0.5)
    result = job.play([[wall(plate, plate.turned(angle))] for angle in angles], remote={"method": {"basis": "tps"}})
    for angle, moved in zip(angles, result["iterations"], strict=True):
        np.testing.assert_allclose(moved, plate.turned(angle), atol=1e-12)
    older, old, new = result["iterations"][1:]
    np.testing.assert_allclose(result["velocities"][-1], (1.5 * new - 2.0 * old + 0.5 * older) / 0.5, atol=1e-12)
    np.testing.assert_allclose(result["points"], plate.points + result["iterations"], atol=1e-15)


def test_answers_are_the_clients_to_the_bit_and_iterations_leave_no_trace(job, plate):
    """Also with gaps in the node numbers; each step commits its last iteration."""
    amounts = (0.1, 0.25, -0.1)
    job.mesh["numbers"] = 7 + 3 * np.arange(len(plate.points))
    steps = [[wall(plate, bent(plate, value)) for value in (3.0 * amount, -amount, amount)] for amount in amounts]
    result = job.play(steps, remote={"method": {"quality_threshold": 0.4}})
    mesh = Mesh(plate.points, {"triangle": plate.triangles}, {"edge": Patch("moving", plate.boundary)})
    with connect(job.endpoint) as server, server.open(mesh, {"quality_threshold": 0.4}) as session:
        for number, amount in enumerate(amounts):
            expected = session.move(bent(plate, amount)[session.moving_nodes], frame="reference").displacement
            session.commit()
            assert np.array_equal(result["iterations"][3 * number + 2], expected)


def test_restart_equals_an_uninterrupted_run(job, plate):
    """Restart from Kratos' own file; the session of an unfinished run is resumed."""
    amounts = (0.1, 0.25, 0.05)
    steps = [[wall(plate, bent(plate, 2.0 * amount)), wall(plate, bent(plate, amount))] for amount in amounts]
    whole = job.play(steps)
    remote = {"session_file": str(job.folder / "mesh.session")}
    job.play(steps[:2], remote=remote, save=[1], finalize=False)
    result = job.play(steps[2:], remote=remote, load="1.0")
    assert "new session" not in job.output
    assert np.array_equal(result["iterations"], whole["iterations"][4:])
    assert np.array_equal(result["velocities"], whole["velocities"][2:])


def test_restart_without_its_session_goes_on_from_the_mesh(job, plate):
    steps = [[wall(plate, plate.turned(angle))] for angle in (0.1, 0.2)]
    remote = {"method": {"basis": "tps"}}
    job.play(steps[:1], remote=remote, save=[0])
    result = job.play(steps[1:], remote=remote, load="0.5")
    assert "a new session begins" in job.output
    np.testing.assert_allclose(result["iterations"][0], plate.turned(0.2), atol=1e-12)


def test_a_space_of_several_elements(job):
    """A brick, a prism at its side and a pyramid on it turn as a whole: their nodes are in the protocol's order."""
    points = np.array(
        [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1],
         [2, 0, 0], [2, 0, 1], [0.5, 0.5, 2]], dtype=float,
    )  # fmt: skip
    turn = np.array([[np.cos(0.3), -np.sin(0.3), 0.0], [np.sin(0.3), np.cos(0.3), 0.0], [0.0, 0.0, 1.0]])
    job.mesh = {
        "points": points,
        "cells_hexahedron": np.array([[0, 1, 2, 3, 4, 5, 6, 7]]),
        "cells_wedge": np.array([[1, 8, 2, 5, 9, 6]]),
        "cells_pyramid": np.array([[4, 5, 6, 7, 10]]),
        "part_wall": np.arange(10),
    }
    turned = points @ turn.T - points
    result = job.play([[{"wall": turned[:10]}]], fix={"wall": [0, 1, 2]}, remote={"method": {"basis": "tps"}})
    np.testing.assert_allclose(result["iterations"][0], turned, atol=1e-12)


def test_only_the_solver_type_changes(job, plate):
    """The same job with Kratos' own solver, its settings kept in the case; both move the edge exactly."""
    steps = [[wall(plate, bent(plate, 0.1))]]
    own = {"solver_type": "structural_similarity", "poisson_ratio": 0.3}
    ours = job.play(steps, solver={"poisson_ratio": 0.3, "reform_dofs_each_step": False})
    theirs = job.play(steps, solver=own)
    for result in (ours, theirs):
        np.testing.assert_allclose(
            result["iterations"][0][plate.boundary], bent(plate, 0.1)[plate.boundary], atol=1e-14
        )
    assert np.abs(ours["iterations"][0] - theirs["iterations"][0]).max() < 0.05


def test_errors_say_what_is_wrong(job, plate):
    """Each in a separate job, one after the other."""
    steps = [[wall(plate, bent(plate, 0.1))]] * 2
    folded = np.zeros_like(plate.points)
    folded[plate.at(0, 1.0)] = [-1.5, 0.0]
    cases = [
        ({"remote": {"endpoint": "tcp://127.0.0.1:9", "timeout": 1}}, "Unavailable: no server answers at tcp://127.0.0.1:9"),
        ({"remote": {"methods": {}}}, 'SettingsError: "remote" has no setting "methods"'),
        ({"remote": {"method": {"basis": "none"}}}, "InvalidInput: "),
        ({"remote": {"roles": {"lid": "slip"}}}, 'has no sub model part "lid" (it has: wall)'),
        ({"remote": {"endpoint": ""}}, "Unavailable: the embedded server did not become ready"),
        ({"fix": {"wall": [0]}}, "PartError: node 1 has some components of MESH_DISPLACEMENT fixed, not all"),
        ({"fix": {}}, "PartError: no node has all components of MESH_DISPLACEMENT fixed"),
        ({"release": {"1": ["wall"]}}, "PartError: no node has all components"),
        ({"solver": {"solver_type": "mesh_motion_kratos.none"}}, "No module named 'mesh_motion_kratos.none'"),
        ({"solver": {"solver_type": "laplace"}}, 'Exception: The requested solver type "laplace"'),
        (
            {"steps": [[wall(plate, folded)]], "remote": {"method": {"correction": "none", "sub_steps": "never"}}},
            "MotionError: ",
        ),
        ({"mesh": job.mesh | {"cells_line": np.array([[0, 1]])}}, "PartError: element 101 has 2 nodes and dimension 1"),
        ({"mesh": {name: job.mesh[name] for name in ("points", "part_wall")}}, 'PartError: model part "mesh" has no'),
    ]  # fmt: skip
    folders = []
    for number, (change, _) in enumerate(cases):
        folders.append(job.folder / str(number))
        folders[-1].mkdir()
        mesh, job.mesh = job.mesh, change.pop("mesh", job.mesh)
        job.write(folders[-1], change.pop("steps", steps), **change)
        job.mesh = mesh
    for (_, words), said in zip(cases, job.run(folders), strict=True):
        assert words in said
        assert "MotionError" not in said or "; worst elements: 1" in said


def test_participant_of_cosimulation(run_in_kratos, mesh_motion_server, plate, tmp_path):
    """A participant that only moves a mesh: the interface's displacement in, that of all nodes out."""
    (tmp_path / "plate.mdpa").write_text(mdpa(plate))
    turns = np.array([plate.turned(angle) for angle in (0.1, 0.3)])
    np.savez(tmp_path / "turns.npz", turns=turns[:, plate.boundary])
    done = run_in_kratos(WRAPPER, mesh_motion_server.endpoint, folder=tmp_path)
    if "CoSimulationApplication" in done.stderr and "No module" in done.stderr:
        pytest.skip("Kratos' CoSimulationApplication is not installed")
    assert done.returncode == 0, (done.stdout + done.stderr)[-4000:]
    np.testing.assert_allclose(np.load(tmp_path / "result.npz")["answers"], turns, atol=1e-12)
    assert "step 2 committed" in done.stdout


def mdpa(plate):
    """The plate as Kratos reads it, its edge as the part ``wall``."""
    nodes = "\n".join(f"{number} {x} {y} 0.0" for number, (x, y) in enumerate(plate.points.tolist(), 1))
    cells = "\n".join(f"{number} 0 {a} {b} {c}" for number, (a, b, c) in enumerate((plate.triangles + 1).tolist(), 1))
    wall = "\n".join(str(node + 1) for node in plate.boundary)
    return (
        "Begin Properties 0\nEnd Properties\n"
        f"Begin Nodes\n{nodes}\nEnd Nodes\n"
        f"Begin Elements Element2D3N\n{cells}\nEnd Elements\n"
        f"Begin SubModelPart wall\nBegin SubModelPartNodes\n{wall}\nEnd SubModelPartNodes\nEnd SubModelPart\n"
    )
