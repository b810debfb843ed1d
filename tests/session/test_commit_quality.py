"""What a COMMIT says of the mesh's quality: that of the committed coordinates, judged once."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mesh_motion_server.session.partitions.uploads import Part
from mesh_motion_server.session.session import Session
from mesh_motion_server.session.store import SessionStore
from mesh_motion_server.settings import ServerSettings
from tests.faults.driver import make_spec
from tests.faults.stand_in import StandIn, grid_mesh


def built(folder: Path, shift: float) -> tuple[Session, list[Any]]:
    """A built session whose mesh begins at ``shift``, and the list of coordinates its model was asked to judge."""
    judged: list[Any] = []

    class Counting(StandIn):
        def summary(self, points: Any) -> Any:
            judged.append(points)
            return super().summary(points)

    session = Session(SessionStore(folder).create(make_spec()), ServerSettings(), Counting)
    mesh = grid_mesh()
    session.add_part(0, Part("nodes", "", "", mesh.points + shift))
    session.add_part(0, Part("cells", "triangle", "", mesh.cells["triangle"]))
    for name, patch in mesh.patches.items():
        session.add_part(0, Part("patch", name, patch.role, patch.nodes[:, None]))
    session.build()
    return session, judged


def committed_quality(session: Session) -> Any:
    return session.commit((), lambda outcome: b"").quality


def test_coordinates_that_the_move_has_judged_are_not_judged_again(tmp_path: Path) -> None:
    session, judged = built(tmp_path, 0.0)
    outcome = session.move("committed", [np.tile([0.1, 0.0], (5, 1))])
    judged.clear()
    assert committed_quality(session) is outcome.motion.corrected
    assert not judged
    session.close()


@pytest.mark.parametrize("shift", [0.0, -0.37])
@pytest.mark.parametrize("frame", ["committed", "reference"])
def test_the_quality_is_that_of_the_committed_coordinates_bitwise(tmp_path: Path, shift: float, frame: str) -> None:
    session, judged = built(tmp_path, shift)
    again = 0
    for x in (0.05, 0.1, 0.17, 0.13, 0.21):
        session.move(frame, [np.tile([x, x / 7], (5, 1))])
        judged.clear()
        quality = committed_quality(session)
        again += len(judged)
        points = session.coordinates("committed")
        assert quality == session.model.summary(points)
    assert again if (shift, frame) == (-0.37, "reference") else not again
    session.close()
