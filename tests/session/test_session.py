"""A session without requests: values are swapped as a whole, and what is given out cannot be changed."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mesh_motion_server.errors import InvalidInput, NumericalError, SessionError
from mesh_motion_server.session.session import Session
from mesh_motion_server.session.state import Operation, State
from mesh_motion_server.session.store import SessionStore
from mesh_motion_server.session.uploads import Part
from mesh_motion_server.settings import ServerSettings


@pytest.fixture
def session(kit: Any, tmp_path: Path) -> Any:
    """READY at step 0."""
    session = Session(SessionStore(tmp_path).create(kit.make_spec()), ServerSettings(), kit.StandIn)
    mesh = kit.grid_mesh()
    session.add_part(0, Part("nodes", "", "", mesh.points))
    session.add_part(0, Part("cells", "triangle", "", mesh.cells["triangle"]))
    for name, patch in mesh.patches.items():
        session.add_part(0, Part("patch", name, patch.role, patch.nodes[:, None]))
    session.build()
    yield session
    session.close()


def right(x: float) -> list[Any]:
    return [np.tile([x, 0.0], (5, 1))]


def commit(session: Session) -> Any:
    return session.commit((), lambda outcome: b"")


def test_coordinates_are_read_only_and_in_canonical_order(kit: Any, session: Session) -> None:
    session.move("committed", right(0.1))
    commit(session)
    for frame in ("committed", "reference"):
        assert not session.coordinates(frame).flags.writeable
    reference = session.coordinates("reference")
    np.testing.assert_array_equal(reference[session.mesh.id_order], kit.grid_mesh().points)
    assert session.coordinates("committed")[session.mesh.moving, 0] == pytest.approx(0.1, abs=0)


def test_moving_nodes_are_bitwise_where_they_were_told_to_be(session: Session) -> None:
    random = np.random.default_rng(3)
    rows = [0.02 * random.random((5, 2))]
    before = session.coordinates("committed")[session.mesh.moving]
    told = session.mesh.gather_moving(rows)
    outcome = session.move("committed", rows)
    assert outcome.displacements[0][session.mesh.moving_local[0]].tobytes() == rows[0].tobytes()
    commit(session)
    assert session.coordinates("committed")[session.mesh.moving].tobytes() == (before + told).tobytes()


def test_a_failure_changes_nothing(session: Session) -> None:
    session.move("committed", right(0.1))
    before = session._now
    with pytest.raises(NumericalError):
        session.move("committed", right(1.5))
    with pytest.raises(InvalidInput, match="floating-point range"), np.errstate(over="ignore"):
        session.move("committed", right(np.inf))
    assert session._now is before


def test_a_receipt_that_cannot_be_made_stops_the_commit_before_anything_is_written(session: Session) -> None:
    session.move("committed", right(0.1))

    def broken(outcome: Any) -> bytes:
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        session.commit((), broken)
    assert (session.state, session.step) == (State.TRIAL, 0)
    assert commit(session).step == 1


def test_nothing_can_be_asked_of_a_mesh_that_is_not_there(kit: Any, tmp_path: Path) -> None:
    session = Session(SessionStore(tmp_path / "new").create(kit.make_spec()), ServerSettings(), kit.StandIn)
    with pytest.raises(SessionError, match="not built"):
        _ = session.mesh
    with pytest.raises(SessionError, match="FETCH is not allowed in state NEW"):
        session.admit(Operation.FETCH)
    assert (session.step, session.iteration, session.epoch, session.commits) == (0, 0, 1, ())
    session.close()
    session.close()


def test_uploads_are_forgotten_once_built(session: Session) -> None:
    assert session.upload.nbytes == 0


def test_a_build_that_failed_can_be_repaired(kit: Any, tmp_path: Path) -> None:
    session = Session(SessionStore(tmp_path / "new").create(kit.make_spec()), ServerSettings(), kit.StandIn)
    mesh = kit.grid_mesh()
    session.add_part(0, Part("nodes", "", "", mesh.points))
    with pytest.raises(InvalidInput, match="no cells"):
        session.build()
    session.add_part(0, Part("cells", "triangle", "", mesh.cells["triangle"]))
    with pytest.raises(InvalidInput, match="moving"):
        session.build()
    session.add_part(0, Part("patch", "left", "moving", mesh.patches["left"].nodes[:, None]))
    session.build()
    assert session.state is State.READY
    session.close()
