"""Nodes slide where the client has the volume: the mesh of a session with the whole mesh, on any number of ranks."""

import numpy as np
import pytest
from mesh_motion_client import connect
from own_ranks import as_client, in_pieces, on_ranks
from sliding_meshes import duct

from proofs.server_process import ServerProcess

DUCTS = {
    "plane": lambda: duct("quad", 20),
    "plane of two types": lambda: duct("quad + triangle", 20),
    "planes in space": lambda: duct("hexahedron", 10),
    "many in plane": lambda: duct("quad", 240),
    "curved": lambda: duct("quad", 20, bend=1.2),
    "curved in space": lambda: duct("wedge", 10, bend=1.2),
}
SETTINGS = {"boundary_layer_thickness": 0.0}
#: Of the block: no cell resists the first, some do the others.
SMALL, LARGE = (0.01, 0.006, 0.004), (0.1, 0.2, 0.1)


@pytest.fixture(scope="module")
def server(tmp_path_factory):
    with ServerProcess(tmp_path_factory.mktemp("server")) as server:
        yield server


def in_two_steps(session, part):
    """What two steps answer, and where the nodes are after each."""
    found = []
    for shift in (SMALL, LARGE):
        rows = np.tile(shift[: part.points.shape[1]], (len(session.moving_nodes), 1))
        moved = session.move(rows)
        session.commit()
        found.append((moved, session.points()))
    return found


@pytest.mark.parametrize("ranks", [2, 3])
@pytest.mark.parametrize("mesh", DUCTS)
def test_nodes_slide_as_in_a_session_with_the_whole_mesh(server, mesh, ranks):
    """Bitwise on any number of ranks, and to rounding or the iterations' tolerance with the whole mesh."""
    whole = as_client(*DUCTS[mesh]())
    with connect(server.endpoint) as client, client.open(whole, SETTINGS) as session:
        expected = in_two_steps(session, whole)
    (one,) = on_ranks(server, [whole], in_two_steps, SETTINGS)
    for (moved, points), (reply, there), most in zip(one, expected, (1e-12, 1e-9), strict=True):
        assert np.abs(points - there).max() < most
        assert moved.correction["method"] == reply.correction["method"]
        assert moved.quality["corrected"]["metric"]["min"] == pytest.approx(
            reply.quality["corrected"]["metric"]["min"], rel=1e-7
        )
    assert [moved.correction["method"] for moved, _ in one] == ["none", "smooth"]
    walls = np.setdiff1d(whole.patches["y0"].nodes, whole.patches["x0"].nodes)
    assert np.abs(one[1][1] - whole.points)[walls].max() > 0.02
    parts = in_pieces(whole, ranks)
    for part, found in zip(parts, on_ranks(server, parts, in_two_steps, SETTINGS), strict=True):
        for (_, here), (_, points) in zip(found, one, strict=True):
            np.testing.assert_array_equal(here, points[part.global_ids])
