"""A session without requests: values are replaced as a whole, and returned arrays cannot be changed."""

import os
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, ClassVar, cast

import numpy as np
import pytest
from box_meshes import CELL_KINDS, box_mesh
from mesh_motion_numerics.distributed.region import Extent, Region
from mesh_motion_numerics.mesh.finite_volume import face_measures
from mesh_motion_numerics.quality.metrics import reference_sizes
from mesh_motion_numerics.quality.orientation import _mirrored
from mesh_motion_numerics.quality.quality_summary import judged_mesh
from mesh_motion_protocol.errors import DataLoss, InvalidInput, QualityRefused, SessionError
from raising import raising
from tiny_meshes import tiny_mesh

from mesh_motion_server.session.history.boundary import BoundaryLog
from mesh_motion_server.session.model import build_motion_model
from mesh_motion_server.session.partitions.uploads import Part
from mesh_motion_server.session.session import Session
from mesh_motion_server.session.state import Operation, State
from mesh_motion_server.session.store import SessionStore
from mesh_motion_server.session.values import Built
from mesh_motion_server.settings import MethodSettings, ServerSettings
from tests.faults.driver import SESSION, TOKEN, make_driver, make_spec
from tests.faults.model_files import FailingFiles, ModelFiles
from tests.faults.stand_in import StandIn, grid_mesh

if TYPE_CHECKING:
    from mesh_motion_server.session.journal.keeper import Keeper
    from mesh_motion_server.session.model import Model
    from mesh_motion_server.session.partitions.meshes import MergedMesh


def built(folder: Path, model: Any = StandIn, shift: float = 0.0) -> Session:
    """READY at step 0, with a mesh that begins at ``shift``."""
    session = Session(SessionStore(folder).create(make_spec()), ServerSettings(), model)
    mesh = grid_mesh()
    session.add_part(0, Part("nodes", "", "", mesh.points + shift))
    session.add_part(0, Part("cells", "triangle", "", mesh.cells["triangle"]))
    for name, patch in mesh.patches.items():
        session.add_part(0, Part("patch", name, patch.role, patch.nodes[:, None]))
    session.build()
    return session


@pytest.fixture
def session(tmp_path: Path) -> Any:
    session = built(tmp_path)
    yield session
    session.close()


def right(x: float) -> list[Any]:
    return [np.tile([x, 0.0], (5, 1))]


def commit(session: Session) -> Any:
    return session.commit((), lambda outcome: b"")


def test_coordinates_are_read_only_and_in_canonical_order(session: Session) -> None:
    session.move("committed", right(0.1))
    commit(session)
    for frame in ("committed", "reference"):
        assert not session.coordinates(frame).flags.writeable
    reference = session.coordinates("reference")
    np.testing.assert_array_equal(reference[session.mesh.id_order], grid_mesh().points)
    assert session.coordinates("committed")[session.mesh.moving, 0] == pytest.approx(0.1, abs=0)


def test_the_boundarys_motion_is_recorded_and_its_file_closed(session: Session, tmp_path: Path) -> None:
    session.move("committed", right(0.1))
    commit(session)
    (folder,) = (tmp_path / "sessions").iterdir()
    assert BoundaryLog(folder).read(1).rows.tolist() == right(0.1)[0].tolist()

    def opened() -> list[str]:
        return [name for name in map(os.path.realpath, Path("/proc/self/fd").iterdir()) if f"{folder}/history" in name]

    assert len(opened()) == 1
    session.close()
    assert opened() == []


def test_a_failure_changes_nothing(session: Session) -> None:
    session.move("committed", right(0.1))
    before = session._now
    with pytest.raises(QualityRefused):
        session.move("committed", right(1.5))
    with pytest.raises(InvalidInput, match="floating-point range"), np.errstate(over="ignore"):
        session.move("committed", right(np.inf))
    assert session._now is before


def test_faces_are_measured_of_the_reference_and_of_the_trial_where_asked(session: Session) -> None:
    session.move("committed", right(0.1))
    commit(session)
    assert session.move("committed", right(0.1)).faces == ()
    before, after = session.move("committed", right(0.1), report="faces").faces
    assert before == face_measures(session.coordinates("reference"), session.mesh.cells)
    assert after == face_measures(session._now.trial.points, session.mesh.cells, session.coordinates("reference"))
    assert before != after


@pytest.mark.parametrize("every", [1, 3])
@pytest.mark.parametrize("kind", CELL_KINDS)
def test_mirrored_cells_have_the_faces_of_their_mirror_images(kind: str, every: int) -> None:
    mesh = box_mesh(kind, 5)
    listed = _mirrored(mesh.cells, np.arange(0, len(mesh.cells), every))
    merged = cast("MergedMesh", SimpleNamespace(points=mesh.points, cells=listed))
    built = Built(merged, cast("Model", None), cast("Keeper", None))
    bent = mesh.points + 0.1 * np.sin(3 * mesh.points[:, ::-1])
    for points, found in ((mesh.points, built.faces), (bent, built.faces_at(bent))):
        expected = face_measures(points, mesh.cells, mesh.points)
        assert expected is not None
        assert found is not None
        assert found.numbers() == pytest.approx(expected.numbers(), rel=1e-9, abs=1e-5)


def test_in_one_dimension_no_face_is_measured(tmp_path: Path) -> None:
    spec = replace(make_spec(), dimension=1)
    session = Session(SessionStore(tmp_path).create(spec), ServerSettings(), build_motion_model)
    session.add_part(0, Part("nodes", "", "", np.linspace(0.0, 1.0, 5)[:, None]))
    session.add_part(0, Part("cells", "line", "", np.stack([np.arange(4), np.arange(1, 5)], axis=1)))
    for name, role, node in ("left", "moving", 0), ("right", "fixed", 4):
        session.add_part(0, Part("patch", name, role, np.array([[node]])))
    session.build()
    assert session.move("committed", [np.array([[0.1]])], report="faces").faces == ()
    session.close()


def test_a_receipt_that_cannot_be_made_stops_the_commit_before_anything_is_written(session: Session) -> None:
    session.move("committed", right(0.1))
    with pytest.raises(ZeroDivisionError):
        session.commit((), raising(ZeroDivisionError()))
    assert (session.state, session.step) == (State.TRIAL, 0)
    assert commit(session).step == 1


def test_nothing_can_be_asked_of_a_mesh_that_is_not_there(tmp_path: Path) -> None:
    session = Session(SessionStore(tmp_path / "new").create(make_spec()), ServerSettings(), StandIn)
    with pytest.raises(SessionError, match="not built"):
        _ = session.mesh
    with pytest.raises(SessionError, match="FETCH is not allowed in state NEW"):
        session.admit(Operation.FETCH)
    assert (session.step, session.iteration, session.epoch, session.commits) == (0, 0, 1, ())
    assert (session.durable_step, session.is_built) == (0, False)
    session.close()
    session.close()


def test_uploads_are_forgotten_once_built(session: Session) -> None:
    assert session.upload.nbytes == 0


def test_the_state_is_on_its_way_to_the_disk_while_a_commit_is_judged() -> None:
    session, files = with_a_trial("full")
    before, judged = files.count, []

    def receipt(outcome: Any) -> bytes:
        judged.append(files.count)
        return b""

    session.commit((), receipt)
    assert before < judged[0] < files.count
    session.close()


def test_factorizations_of_past_states_are_not_kept(session: Session) -> None:
    for _ in range(6):
        session.move("committed", right(0.01))
        commit(session)
    assert len(session.factors) <= 2


# --- the quality that a COMMIT answers --------------------------------------------------------------------------------


class Counting(StandIn):
    judged: ClassVar[list[Any]] = []

    def summary(self, points: Any) -> Any:
        self.judged.append(points)
        return super().summary(points)


def test_coordinates_that_the_move_has_judged_are_not_judged_again(tmp_path: Path) -> None:
    session = built(tmp_path, Counting)
    outcome = session.move("committed", right(0.1))
    Counting.judged.clear()
    assert commit(session).quality is outcome.motion.corrected
    assert not Counting.judged
    session.close()


@pytest.mark.parametrize("shift", [0.0, -0.37])
@pytest.mark.parametrize("frame", ["committed", "reference"])
def test_the_quality_is_that_of_the_committed_coordinates_bitwise(tmp_path: Path, shift: float, frame: str) -> None:
    session, again = built(tmp_path, Counting, shift), 0
    for x in (0.05, 0.1, 0.17, 0.13, 0.21):
        session.move(frame, [np.tile([x, x / 7], (5, 1))])
        Counting.judged.clear()
        quality = commit(session).quality
        again += len(Counting.judged)
        assert quality == session.model.summary(session.coordinates("committed"))
    assert again if (shift, frame) == (-0.37, "reference") else not again
    session.close()


# --- cells that are with the client ----------------------------------------------------------------------------------


def apart(root: Path, loose: tuple[tuple[float, float], ...] = (), **changes: Any) -> Session:
    """A square body in a square frame; the session has only the boundary; ``loose``: nodes on no patch."""
    body = [(x, y) for x in (0.4, 0.6) for y in (0.4, 0.6)]
    frame = [(x, y) for x in (0.0, 0.5, 1.0) for y in (0.0, 0.5, 1.0) if (x, y) != (0.5, 0.5)]
    chosen = {"displacement": "absolute", "correction": "none", "sub_steps": "never"}
    chosen |= {"support_radius": 2.0, "quality_threshold": float(quality_of(0.5).metric.min)} | changes
    spec = make_spec(evaluation="client", settings=MethodSettings.from_mapping(chosen))
    session = Session(SessionStore(root).create(spec), ServerSettings(), build_motion_model)
    session.add_part(0, Part("nodes", "", "", np.array([*body, *frame, *loose])))
    session.add_part(0, Part("cells", "triangle", "", np.empty((24, 0), dtype=np.int64)))
    session.add_part(0, Part("patch", "body", "moving", np.arange(4)[:, None]))
    session.add_part(0, Part("patch", "frame", "fixed", np.arange(4, 12)[:, None]))
    return session


def whole_region(extent: Extent, *, whole: bool = True) -> list[Region]:
    """The triangles between the left sides of body and frame, around a node too near to the body."""
    points = np.array([[0.4, 0.4], [0.4, 0.6], [0.0, 0.0], [0.0, 0.5], [0.0, 1.0], [0.2, 0.5]])
    ids, fan = np.array([0, 1, 4, 5, 6, 12]), [[5, 2, 0], [5, 0, 1], [5, 1, 4], [5, 4, 3], [5, 3, 2]]
    positions = np.where(ids[:, None] == 12, [0.39, 0.5], points)
    return [Region(extent, ids, np.full(6, whole), points, positions, {"triangle": np.array(fan)}, 1, (1.0, 1.0))]


def quality_of(squeezed: float) -> Any:
    """The quality of a few triangles that are squeezed along y."""
    points, cells = tiny_mesh("triangle", 2)
    return judged_mesh(points * [1.0, squeezed], cells, reference_sizes(points, cells))[0]


def test_a_trial_whose_cells_are_with_the_client_is_committed_once_they_are_judged(tmp_path: Path) -> None:
    session = apart(tmp_path)
    session.build()
    moved = session.move("reference", [np.full((4, 2), 0.05)])
    with pytest.raises(SessionError, match="the trial is not judged, or it was refused"):
        session.admit(Operation.COMMIT)  # before anything is written
    with pytest.raises(QualityRefused):
        session.judge(quality_of(-1.0))
    with pytest.raises(SessionError, match="the trial is not judged, or it was refused"):
        commit(session)
    (warning,) = session.judge(quality_of(0.01)).warnings
    assert "below the threshold" in warning
    assert session.judge(quality_of(0.5)).warnings == []  # just at the threshold
    assert session.state is State.TRIAL
    assert commit(session).step == 1
    np.testing.assert_array_equal(session.field("committed").coefficients, moved.field.coefficients)
    assert moved.field.coefficients.any()
    assert not session.field("reference").coefficients.any()
    session.close()


def test_a_trial_whose_cells_are_with_the_client_is_corrected_and_so_again_once_it_is_committed(tmp_path: Path) -> None:
    session = apart(tmp_path, correction="optimised", correction_target="threshold")
    session.build()
    still, bad, good = [np.zeros((4, 2))], quality_of(0.1), quality_of(1.0)
    with pytest.raises(SessionError, match="CORRECT is not allowed in state READY"):
        session.correct("trial", [])
    session.move("reference", still)
    extent = session.judge(bad).extent
    assert extent is not None
    assert session.correct("trial", whole_region(extent, whole=False)).extent == replace(extent, rings=2 * extent.rings)
    assert session.judge(bad).extent == extent  # nothing is corrected yet
    found = session.correct("trial", whole_region(extent))
    assert (found.extent, found.nodes.tolist()) == (None, [12])
    assert session.judge(good).correction is found.correction
    assert commit(session).corrected
    assert (session.region("committed"), session.region("reference")) == (extent, None)
    again = session.correct("committed", whole_region(extent))
    np.testing.assert_array_equal(again.displacement, found.displacement)
    session.move("reference", still)
    assert session.judge(good).correction is None
    assert not commit(session).corrected
    assert session.region("committed") is None
    session.close()


def test_a_boundary_of_which_a_node_is_on_no_patch_does_not_determine_the_motion(tmp_path: Path) -> None:
    session = apart(tmp_path, loose=((0.5, 0.8),))
    with pytest.raises(InvalidInput, match="global id 12 is on the boundary, but on no patch"):
        session.build()
    session.close()


# --- a journal that fails --------------------------------------------------------------------------------------------


def with_a_trial(level: str) -> tuple[Session, FailingFiles]:
    files = FailingFiles(ModelFiles(), for_ever=False)
    driver = make_driver(SessionStore("/state", files=files), [grid_mesh()], spec={"durability": level})
    driver.open()
    driver.move(1)
    return driver.host._session, files


@pytest.mark.parametrize("level", ["full", "replay", "relaxed"])
def test_a_commit_that_the_journal_does_not_take_can_be_repeated(level: str, monkeypatch: pytest.MonkeyPatch) -> None:
    session, _ = with_a_trial(level)
    with monkeypatch.context() as patch:
        patch.setattr(session._built.keeper, "commit", raising(DataLoss("does not fit", code="INTERNAL")))  # type: ignore[union-attr]
        with pytest.raises(DataLoss, match="does not fit"):
            commit(session)
    assert (session.state, session.step, session.iteration) == (State.TRIAL, 0, 1)
    assert commit(session).step == 1
    session.close()


def test_a_failure_that_a_commit_has_reported_is_not_reported_again(monkeypatch: pytest.MonkeyPatch) -> None:
    """With "relaxed" the disk may fail between a request's admission and its commit; CLOSE then continues."""
    session, _ = with_a_trial("relaxed")
    keeper = session._built.keeper  # type: ignore[union-attr]

    def fail(*given: Any) -> None:
        keeper.journal.frozen = True
        raise DataLoss("the disk failed", code="RESOURCE_EXHAUSTED.DISK")

    monkeypatch.setattr(keeper, "commit", fail)
    monkeypatch.setattr(keeper, "catch_up", fail)
    with pytest.raises(DataLoss, match="the disk failed"):
        commit(session)
    assert session.state is State.FROZEN
    session.catch_up()
    session.close()


# --- at rest and again -----------------------------------------------------------------------------------------------


def closed(level: str, steps: int = 2) -> tuple[SessionStore, ModelFiles]:
    files = ModelFiles()
    store = SessionStore("/state", files=files)
    driver = make_driver(store, [grid_mesh()], spec={"durability": level})
    driver.open()
    for step in range(1, steps + 1):
        driver.advance(step)
    driver.host.close()
    return store, files


@pytest.mark.parametrize("level", ["full", "replay", "relaxed"])
def test_a_closed_session_holds_nothing(level: str) -> None:
    store, files = closed(level)
    assert files.handles == {}
    session = Session.reopen(store.open(SESSION, TOKEN), ServerSettings(), StandIn)
    assert session.state is State.READY
    session.move("committed", right(0.1))
    session.close()
    assert (len(session.factors), files.handles) == (0, {})
    session.close()
    assert (session.state, session.iteration) == (State.CLOSED, 0)


def test_a_session_that_cannot_be_reopened_gives_its_journal_back() -> None:
    store, files = closed("full")
    folder = store.open(SESSION, TOKEN)
    with pytest.raises(ZeroDivisionError):
        Session.reopen(folder, ServerSettings(), raising(ZeroDivisionError()))
    assert list(files.handles.values()) == [("lock", folder.path / "lock")]
    folder.release()
