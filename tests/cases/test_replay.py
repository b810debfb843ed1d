"""Replay of a stored session: the same bits with the same settings in all cases; differences are reported."""

import csv
import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mesh_motion_client import Server
from mesh_motion_protocol.errors import DataLoss, InvalidInput, SessionError
from mesh_motion_protocol.messages import Close, Commit, Move, Rollback
from real_sessions import boxed, bulge, computes_as_servers, new_session

from mesh_motion_server.cases.comparison import Comparison, table_of, write_comparison
from mesh_motion_server.cases.recorded import Recorded, read_recorded
from mesh_motion_server.cases.replay import replay, replay_steps
from mesh_motion_server.commands.replay import changes_of
from mesh_motion_server.service.dispatch import SessionHost
from mesh_motion_server.session.history.boundary import BoundaryLog, BoundaryStep
from mesh_motion_server.session.inspection import inspect_session
from mesh_motion_server.session.journal.files import read_ledger
from mesh_motion_server.session.journal.filesystem import PosixFileSystem
from mesh_motion_server.session.journal.ledger import Commit as CommitEntry
from mesh_motion_server.session.model import build_motion_model
from mesh_motion_server.session.partitions.meshes import PartitionMesh
from mesh_motion_server.session.replay import maker
from mesh_motion_server.session.store import SessionStore
from mesh_motion_server.settings import MethodSettings, ServerSettings
from mesh_motion_server.watch.pictures.meshes import read_pair
from tests.faults.driver import SESSION, Driver, make_spec
from tests.faults.stand_in import split_mesh

STEPS = 6
SETTINGS = {"quality_metric": "size-skew", "support_radius": 0.8, "quality_threshold": 0.45, "correction": "optimised"}


def new_driver(root: Path, meshes: list[PartitionMesh], level: str = "full", **settings: Any) -> Driver:
    driver = new_session(SessionStore(root), meshes, level=level, **SETTINGS | settings)
    driver.open()
    return driver


def record(root: Path, level: str = "full", parts: int = 1, **settings: Any) -> Path:
    """A session with iterations, roll-backs, both frames, a refusal and a resumption; its folder."""
    whole = boxed(9)
    driver = new_driver(root, [whole] if parts == 1 else split_mesh(whole, parts), level, **settings)
    for step in range(1, STEPS + 1):
        frame = "reference" if step % 2 else "committed"
        size = 0.3 * np.sin(step) if frame == "reference" else 0.1 * np.cos(step)
        for share in (0.5, 0.9):
            driver.all(Move, bulge(driver, share * size), step=step, frame=frame)
        if step == 3:
            driver.all(Rollback, step=step)
            assert driver.all(Move, bulge(driver, 50.0), step=step, frame=frame)[-1].type == "ERROR"
        (reply, *_) = driver.all(Move, bulge(driver, size), step=step, frame=frame)[::-1]
        assert reply.type == "MOVED", reply
        if step == 4:
            driver.host._session.catch_up()
            driver.host.close()
            host = SessionHost.resume(
                SESSION,
                bytes(range(32)),
                SessionStore(root),
                limits=ServerSettings(reserve_disk_bytes=0),
                build_model=build_motion_model,
            )
            again = Driver(host, driver.meshes)
            again.sequences, driver = driver.sequences, again
            driver.join()
            driver.all(Move, bulge(driver, size), step=step, frame=frame)
        driver.all(Commit, step=step)
    for part in range(parts):
        driver.ask(Close, part, outcome="keep")
    return root / "sessions" / SESSION


class InProcess:
    """A session without a socket, with the methods of a client's session."""

    def __init__(self, recorded: Recorded, root: Path, changes: dict[str, Any]) -> None:
        view = recorded.mesh
        mesh = PartitionMesh(
            view.points,
            np.arange(len(view.points)),
            {block.type.name: block.nodes for block in view.cells},
            view.patches,
        )
        settings = recorded.spec.settings.model_dump() | changes
        if recorded.spec.time_levels and recorded.log.timed:
            self._driver = with_levels(root, [mesh], recorded.spec.time_levels)
        else:
            self._driver = new_driver(root, [mesh], **settings)

    def move(self, displacements: Any, **asked: Any) -> Any:
        return self._replied(self._driver.all(Move, [displacements], step=self._driver.host.step + 1, **asked))

    def commit(self) -> Any:
        return self._replied(self._driver.all(Commit, step=self._driver.host.step + 1))

    def _replied(self, replies: list[Any]) -> Any:
        (reply,) = replies
        if reply.type == "ERROR":
            raise SessionError(reply.message, code=reply.code)
        return reply


def ignored(*_: Any) -> None:
    """Ignores the steps."""


def replayed(recorded: Recorded, root: Path, last: int = STEPS, **changes: Any) -> Comparison:
    run = replay_steps(recorded, changes, InProcess(recorded, root, changes), last, ignored)
    return Comparison(recorded, last, run)


CASES = [("relative", "full", 1), ("relative", "replay", 3), ("relative", "relaxed", 1)]
CASES += [("absolute", "replay", 1), ("reanchored", "full", 3), ("reanchored", "relaxed", 1)]


@pytest.mark.parametrize(("mode", "level", "parts"), CASES)
def test_the_same_settings_give_the_same_bits_at_every_step(mode: str, level: str, parts: int, tmp_path: Path) -> None:
    recorded = read_recorded(record(tmp_path / "recorded", level, parts, displacement=mode))
    comparison = replayed(recorded, tmp_path / "replayed")
    run, agreement = comparison.run, comparison.agreement
    assert agreement.exact
    assert (agreement.compared, agreement.first_difference, agreement.distance) == (STEPS, 0, 0.0)
    assert comparison.broken_promise() == ""
    assert run.digests == {step: recorded.digest(step) for step in range(1, STEPS + 1)}
    for name in ("step", "actual_min", "actual_mean", "predicted_min", "enrichment_points", "freed_nodes"):
        np.testing.assert_array_equal(run.columns[name], recorded.columns[name])
    assert (run.columns["freed_nodes"] > 0).any()
    assert recorded.columns["refusals"].tolist() == [0, 0, 1, 0, 0, 0]
    assert recorded.columns["iterations"][0] == 3


def with_levels(root: Path, meshes: list[PartitionMesh], levels: str) -> Driver:
    spec = make_spec(settings=MethodSettings.from_mapping(SETTINGS), time_levels=levels)
    limits = ServerSettings(reserve_disk_bytes=0)
    driver = Driver(SessionHost.create(spec, SessionStore(root), limits=limits, build_model=build_motion_model), meshes)
    driver.open()
    return driver


class Late(BoundaryLog):
    """A seeded bug: the time of a step is not that of the session."""

    def time(self, step: int) -> float | None:
        known = super().time(step)
        return None if known is None else known + 0.125 * (step == 3)


class Untimed(BoundaryLog):
    """A session from a version that recorded no times."""

    timed = False  # type: ignore[assignment]


@pytest.mark.parametrize("levels", ["bdf2", "bossak"])
def test_velocities_are_compared_in_a_session_with_time_levels(levels: str, tmp_path: Path) -> None:
    """Replay, inspect and plot read the coordinates of such a session, not its time levels."""
    meshes = [boxed(9)]
    driver = with_levels(tmp_path / "recorded", meshes, levels)
    for step, time in enumerate((0.25, 1.0, 1.125), start=1):
        driver.all(Move, bulge(driver, 0.1 * step), step=step, time=7.0)  # another time in the last iteration
        driver.all(Move, bulge(driver, 0.1 * step), step=step, **({"time": time} if step < 3 else {}))
        driver.all(Commit, step=step, time=time)
    driver.ask(Close, outcome="keep")
    folder = tmp_path / "recorded" / "sessions" / SESSION
    recorded = read_recorded(folder)
    assert [recorded.log.read(step).time for step in (1, 2, 3)] == [0.25, 1.0, 1.125]
    comparison = replayed(recorded, tmp_path / "replayed", 3)
    agreement = comparison.agreement
    assert agreement.exact
    assert (agreement.compared, agreement.stored_step) == (3, 3)
    assert (agreement.distance, agreement.velocity_distance) == (0.0, 0.0)
    assert np.abs(comparison.run.velocity).max() > 0.1
    late = replayed(replace(recorded, log=Late(folder)), tmp_path / "late", 3).agreement
    assert (late.equal, late.distance) == (3 if levels == "bdf2" else 2, 0.0)  # a state of "bdf2" has positions only
    assert not late.exact
    assert late.velocity_distance > 0.1
    assert "velocities up to" in str(late)
    untimed = replace(recorded, log=Untimed(folder))
    assert untimed.digest(1) == b""
    assert replayed(untimed, tmp_path / "untimed", 3).agreement.velocity_distance is None
    assert inspect_session(folder).nodes == 81
    after = read_pair(folder).after
    assert after.points.shape == (81, 2)
    assert np.abs(after.points - meshes[0].points).max() > 0.1


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return record(tmp_path_factory.mktemp("recorded"))


@pytest.fixture(scope="module")
def recorded(folder: Path) -> Recorded:
    return read_recorded(folder)


class Dropping(BoundaryLog):
    dropped = 4

    def __init__(self, session_folder: Path) -> None:
        super().__init__(session_folder)
        self.steps -= 1

    def read(self, step: int) -> BoundaryStep:
        found = super().read(step + (step >= self.dropped))
        return replace(found, step=step)


def test_a_replay_that_drops_a_step_is_reported(recorded: Recorded, folder: Path, tmp_path: Path) -> None:
    seeded = replace(recorded, log=Dropping(folder))
    comparison = replace(replayed(seeded, tmp_path, STEPS - 1), recorded=recorded, last=STEPS)
    agreement = comparison.agreement
    assert not agreement.exact
    assert (agreement.first_difference, agreement.equal, agreement.compared) == (Dropping.dropped, 3, STEPS)
    assert "first different in step 4 (minimum 0." in comparison.broken_promise()


def test_a_replay_that_is_off_by_next_to_nothing_is_reported(
    recorded: Recorded, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    read = BoundaryLog.read

    def off(log: BoundaryLog, step: int) -> BoundaryStep:
        found = read(log, step)
        return replace(found, rows=found.rows * (1 + 1e-12)) if step == 2 else found

    monkeypatch.setattr(BoundaryLog, "read", off)
    comparison = replayed(recorded, tmp_path)
    agreement = comparison.agreement
    assert agreement.first_difference == 2
    assert agreement.stored_step == STEPS
    assert agreement.distance is not None
    assert 0 < agreement.distance < 1e-9
    assert "nodes up to" in str(agreement)


def test_other_settings_are_compared_and_no_promise_is_broken(recorded: Recorded, tmp_path: Path) -> None:
    comparison = replayed(recorded, tmp_path, correction="none", quality_threshold=0.0)
    agreement = comparison.agreement
    assert not agreement.exact
    assert comparison.broken_promise() == ""
    assert comparison.run.name == "correction = none, quality_threshold = 0.0"
    assert table_of(comparison).row_count == 13
    write_comparison(tmp_path, comparison)
    values = json.loads((tmp_path / "comparison.json").read_text())
    assert values["recorded"]["corrections"] > values["replayed"]["corrections"] == 0
    assert values["digests"]["exact"] is False
    assert [len(values[f"{which}_steps"]) for which in ("recorded", "replayed")] == [STEPS, STEPS]
    assert values["recorded_steps"][0]["digest"] == recorded.digest(1).hex()


def test_a_refused_step_is_the_end_and_is_reported(recorded: Recorded, tmp_path: Path) -> None:
    comparison = replayed(recorded, tmp_path, correction="none", quality_threshold=0.6, refuse_below_threshold=True)
    run = comparison.run
    assert len(run.digests) < STEPS
    assert f"step {len(run.digests) + 1} refused: FAILED_PRECONDITION.QUALITY" in run.refusal
    assert not comparison.agreement.exact
    assert table_of(comparison).row_count == 14


def test_another_machine_or_version_makes_no_promise(recorded: Recorded, folder: Path, tmp_path: Path) -> None:
    seeded = replace(recorded, log=Dropping(folder))
    comparison = replayed(seeded, tmp_path, STEPS - 1)
    assert comparison.unpromised == ""
    assert comparison.broken_promise()
    mixed = [(1, "mesh-motion-server 0.0.1"), (3, maker())]
    for makers, why in (
        ([(1, "")], "does not record"),
        ([], "does not record"),
        (mixed, "computed by mesh-motion-server 0"),
    ):
        other = replace(comparison, recorded=replace(seeded, makers=makers))
        assert why in other.unpromised
        assert other.broken_promise() == ""
        assert other.notes == other.as_dict()["notes"] == [other.unpromised]
    other = replace(comparison, elsewhere=True)
    assert other.broken_promise() == ""
    assert other.as_dict()["replayed_by"] == ""


def test_equal_digests_and_other_stored_coordinates_are_not_equal(recorded: Recorded, tmp_path: Path) -> None:
    comparison = replayed(recorded, tmp_path)
    run = comparison.run
    assert run.stored is not None
    agreement = replace(comparison, run=replace(run, stored=run.stored + 0.25)).agreement
    assert not agreement.exact
    assert str(agreement).startswith(f"equal in all {STEPS} steps; nodes up to 0.354 apart at step {STEPS}")


def test_steps_of_another_life_than_the_stored_one_are_not_replayed(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(BoundaryLog, "digest", lambda *_: b"x" * 32)
    with pytest.raises(InvalidInput, match="nothing can be replayed: the steps from"):
        read_recorded(folder)


def test_steps_before_another_life_are_replayed(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The journal has the last four steps, and the log has other ones from the fifth on."""
    digest = BoundaryLog(folder).digest
    commits = tuple(CommitEntry(step, digest(step) if step < 5 else b"x" * 32, (), b"") for step in range(3, STEPS + 1))
    ledger = replace(read_ledger(folder, PosixFileSystem()), commits=commits)
    monkeypatch.setattr("mesh_motion_server.cases.recorded.read_ledger", lambda *_: ledger)
    recorded = read_recorded(folder)
    assert recorded.log.steps == 4
    assert recorded.notes == ["the steps from 5 on were repeated while no history was recorded"]


def test_a_damaged_record_ends_the_replay_before_it_begins(folder: Path, tmp_path: Path) -> None:
    copy = tmp_path / "copy"
    shutil.copytree(folder, copy)
    (path,) = (copy / "history").glob("boundary-*.bin")
    log, data = BoundaryLog(copy), bytearray(path.read_bytes())
    data[log._inputs[3] + 40] ^= 1  # after its head
    path.write_bytes(data)
    recorded = read_recorded(copy)
    assert recorded.log.steps == 3
    assert recorded.notes == ["the recorded motion of the boundary in step 4 has a wrong checksum"]


def test_only_steps_whose_events_are_there_are_summed_up(recorded: Recorded, tmp_path: Path) -> None:
    columns = {name: column[recorded.columns["step"] > 3] for name, column in recorded.columns.items()}
    comparison = replayed(replace(recorded, columns=columns), tmp_path)
    values = comparison.as_dict()
    assert values["recorded"]["steps"] == values["replayed"]["steps"] == STEPS - 3
    assert values["recorded"]["mean_quality"] == values["replayed"]["mean_quality"]
    assert comparison.notes == ["events exist for 3 of 6 steps (steps 4 to 6): only these are counted"]
    assert comparison.agreement.compared == STEPS


def test_a_copy_taken_while_the_session_lives_is_replayed(tmp_path: Path) -> None:
    driver = new_driver(tmp_path / "live", [boxed(9)])
    for step in (1, 2):
        driver.all(Move, bulge(driver, 0.1 * step), step=step, frame="reference")
        driver.all(Commit, step=step)
    shutil.copytree(tmp_path / "live" / "sessions" / SESSION, tmp_path / "copy")
    for torn in ("slot-0", "slot-1"):  # one of them was being written
        data = bytearray((tmp_path / "copy" / torn).read_bytes())
        data[len(data) // 2] ^= 1
        (tmp_path / "copy" / torn).write_bytes(data)
    recorded = read_recorded(tmp_path / "copy")
    assert recorded.log.steps == 2
    comparison = replayed(recorded, tmp_path / "replayed", 2)
    assert comparison.agreement.exact


def test_a_folder_that_cannot_be_replayed_is_refused_with_the_reason(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(DataLoss, match="is not a session's folder"):
        read_recorded(tmp_path)
    for name, pattern in (("history", "not recorded from step 1 on"), ("mesh.bin", "mesh")):
        copy = tmp_path / f"without {name}"
        shutil.copytree(folder, copy)
        path = copy / name
        if path.is_dir():
            shutil.rmtree(path)
        else:
            path.write_bytes(path.read_bytes()[:-1])
        with pytest.raises((InvalidInput, DataLoss), match=pattern):
            read_recorded(copy)
    with pytest.raises(InvalidInput, match=f"recorded up to step {STEPS}, not 99"):
        replay(folder, tmp_path / "out", {}, until=99)
    with pytest.raises(InvalidInput, match="setting 'correction': expected one of none"):
        replay(folder, tmp_path / "out", {"correction": "best"})
    assert not (tmp_path / "out").exists()


def test_assignments() -> None:
    changes = changes_of(["support_radius=1", "max_enrichment_points=3", "correction=none", "allow_invalid = true"])
    assert changes == {"support_radius": 1.0, "max_enrichment_points": 3, "correction": "none", "allow_invalid": True}
    for wrong in ("support_radius", "=1", "basis="):
        with pytest.raises(InvalidInput, match="expected a setting as key=value"):
            changes_of([wrong])


@pytest.mark.nightly
def test_over_the_wire_with_all_results(server: Server, folder: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    comparison = replay(folder, out, {}, endpoint=server.endpoint, until=3)
    agreement = comparison.agreement
    assert agreement.exact or not computes_as_servers()
    assert agreement.replayed_min == pytest.approx(agreement.recorded_min, abs=1e-12, nan_ok=True)
    assert comparison.unpromised == "equal bits are not guaranteed: the replay ran on another server"
    assert {"comparison.json", "summary.json", "steps.csv", "points.npy", "mesh.pvd"} <= {
        path.name for path in out.iterdir()
    }
    points = np.load(out / "points.npy")
    assert points.shape == comparison.recorded.mesh.points.shape
    rows = list(csv.DictReader((out / "steps.csv").read_text().splitlines()))
    assert [row["step"] for row in rows] == ["1", "2", "3"]
    assert all(float(row["boundary_error"]) < 1e-15 for row in rows)
    changes = {"quality_threshold": 0.1, "support_radius": 1.0, "correction": "none"}
    comparison = replay(folder, out, changes, endpoint=server.endpoint, until=2, every=2)
    assert comparison.run.changes == json.loads((out / "summary.json").read_text())["changes"] == changes
    assert json.loads((out / "comparison.json").read_text())["changes"] == changes
    assert [path.name for path in sorted(out.glob("*.vtu"))] == ["mesh_0000.vtu", "mesh_0001.vtu"]


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("metric", "at_rest"), [("relative-size-skew", 1.0), ("size-skew", np.sqrt(3) / 2)]
)  # of triangles with a right angle
def test_a_picture_shows_one_metric(
    metric: str, at_rest: float, server: Server, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    driver = new_driver(tmp_path, [boxed(9)])
    driver.all(Move, bulge(driver, 0.05), step=1, frame="reference")
    driver.all(Commit, step=1)
    driver.ask(Close, 0, outcome="keep")
    shown: list[Any] = []
    monkeypatch.setattr("mesh_motion_server.cases.results.draw_before_after", lambda pair, *_, **__: shown.append(pair))
    monkeypatch.setattr("mesh_motion_server.cases.results.save", lambda *_: None)
    folder, out = tmp_path / "sessions" / SESSION, tmp_path / "out"
    replay(folder, out, {"quality_metric": metric}, endpoint=server.endpoint)
    [record] = json.loads((out / "summary.json").read_text())["steps"]
    [pair] = shown
    assert pair.metric == metric
    assert pair.before.quality == pytest.approx(at_rest)
    assert pair.after.quality.min() == pytest.approx(record[f"min_{metric}".replace("-", "_")])
    assert pair.after.quality.min() < at_rest
