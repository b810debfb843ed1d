"""Sessions of a server that computes on workers: ``mesh-motion serve --distributed`` and ``play --distributed``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from distributed_cases import MESHES, local_model, waypoints
from mesh_motion_client import Mesh, Patch, connect
from worker_processes import connected

from mesh_motion_server.cases.play import play
from mesh_motion_server.distributed.connection import Connection
from mesh_motion_server.errors import InvalidInput
from mesh_motion_server.session.model import build_motion_model, model_builder
from mesh_motion_server.settings import MethodSettings, ServerSettings

SETTINGS = {"support_radius": 2.0, "correction": "none"}


def held(connection: Connection) -> int:
    """Partitions on the workers, once these have been told of what nobody wants."""
    connection.client().run(lambda: None)
    keys = [key for keys in connection.client().has_what().values() for key in keys]
    return sum(key.startswith("mesh-motion-") for key in keys)


@pytest.mark.nightly  # a server of its own
def test_a_session_over_the_wire_answers_the_same_and_frees_the_workers(cluster: Any) -> None:
    body = MESHES["cube"]()
    cells = {block.type.name: block.nodes for block in body.cells}
    mesh = Mesh(body.points, cells, {"body": Patch("moving", body.body), "outer": Patch("fixed", body.outer)})
    model, here = local_model(body, MethodSettings.from_mapping(SETTINGS).to_method()), body.points
    options = ("--distributed", cluster.scheduler_address)
    with (
        connected(cluster) as watching,
        connect(server_options=options) as server,
        server.open(mesh, SETTINGS) as session,
    ):
        for targets in waypoints(body):
            moved = session.move(targets - body.points[np.sort(body.body)], frame="reference")
            here = model.move(here, targets).points
            # the server numbers the nodes along the Morton curve and adds its sums in that order
            np.testing.assert_allclose(body.points + moved.displacement, here, rtol=0, atol=1e-12)
            assert moved.caches["bytes_to_workers"] > 0
            assert moved.caches["partitions_rebuilt"] == 0
            session.commit()
        assert held(watching) == 2
        session.close("discard")
        assert not held(watching)


@pytest.mark.nightly
def test_a_case_is_played_on_workers(cluster: Any, tmp_path: Path) -> None:
    body = MESHES["cube"]()
    cells = {f"cells_{block.type.name}": block.nodes for block in body.cells}
    np.savez(tmp_path / "mesh.npz", points=body.points, patch_body=body.body, patch_outer=body.outer, **cells)
    (tmp_path / "case.toml").write_text(
        '[mesh]\nfile = "mesh.npz"\n[patches]\nbody = "moving"\nouter = "fixed"\n[[motion]]\npatch = "body"\n'
        "rigid = { translation = [0.05, 0.0, 0.0], rotation = 20.0, axis = [0, 0, 1], centre = [0.5, 0.5, 0.5] }\n"
        "[steps]\ncount = 2\niterations = 2\n[method]\nsupport_radius = 2.0\nquality_threshold = 0.4\n"
    )
    plain = play(tmp_path / "case.toml", tmp_path / "here")
    there = play(tmp_path / "case.toml", tmp_path / "there", distributed=cluster.scheduler_address)
    np.testing.assert_array_equal(there.points, plain.points)
    assert [step.predicted_min for step in there.steps] == [step.predicted_min for step in plain.steps]


def test_only_the_operator_names_a_scheduler() -> None:
    with pytest.raises(InvalidInput, match="unknown setting 'distributed'"):
        MethodSettings.from_mapping({"distributed": "tcp://127.0.0.1:8786"})


@pytest.mark.parametrize(
    "values",
    [
        {"distributed": "127.0.0.1:8786"},
        {"distributed": "tcp://somewhere"},
        {"distributed_fallback": "remote"},
        {"distributed_partitions": -1},
        {"distributed_patience_seconds": 0.0},
        {"distributed_tls_key": 3},
    ],
)
def test_wrong_settings_are_refused(values: dict[str, Any]) -> None:
    with pytest.raises(InvalidInput):
        ServerSettings.from_mapping(values)


def test_without_the_setting_everything_is_computed_here() -> None:
    assert model_builder(ServerSettings()) is build_motion_model


def test_without_the_package_the_way_out_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "distributed", None)
    with pytest.raises(InvalidInput, match=r"not installed \(pip install 'mesh-motion-server\[dask\]'\)"):
        model_builder(ServerSettings(distributed="tcp://127.0.0.1:8786"))
