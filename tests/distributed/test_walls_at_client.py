"""Nodes slide and move as their images where the client has the volume: as with the whole mesh, on any ranks."""

import numpy as np
import pytest
from mesh_motion_client import Patch, connect
from own_ranks import as_client, in_pieces, on_ranks
from periodic_meshes import periodic_box, sector
from sliding_meshes import duct

from mesh_motion_server.numerics.mesh.cells import CellTable
from proofs.server_process import ServerProcess


def with_roles(mesh, roles):
    """The mesh with other roles of some patches."""
    points, cells, patches = mesh
    return points, cells, patches | {name: Patch(role, patches[name].nodes) for name, role in roles.items()}


MESHES = {
    "plane": lambda: duct("quad", 20),
    "plane of two types": lambda: duct("quad + triangle", 20),
    "planes in space": lambda: duct("hexahedron", 10),
    "many in plane": lambda: duct("quad", 240),
    "curved": lambda: duct("quad", 20, bend=1.2),
    "curved in space": lambda: duct("wedge", 10, bend=1.2),
    "symmetry": lambda: with_roles(duct("quad", 20), {"y0": "symmetry"}),
    "periodic": lambda: periodic_box("quad", 20, shear=0.3),
    "periodic, many in plane": lambda: periodic_box("quad", 240),
    "sector": lambda: sector("quad", 20),
    "sector in space": lambda: with_roles(sector("hexahedron", 10), {"z0": "slip", "z1": "slip"}),
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
@pytest.mark.parametrize("mesh", MESHES)
def test_nodes_slide_as_in_a_session_with_the_whole_mesh(server, mesh, ranks):
    """Bitwise on any number of ranks, and to rounding or the iterations' tolerance with the whole mesh."""
    whole = as_client(*MESHES[mesh]())
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


def cut_elsewhere(mesh, at):
    """The periodic box whose period begins at y = ``at``: below it the body is near a side, whose image is far off."""
    points, cells, patches = mesh
    nodes = {block.type.name: np.asarray(block.nodes) for block in cells}
    (name, rows), d = next(iter(nodes.items())), points.shape[1]
    places = points[rows].copy()
    places[places[:, :, 1].mean(axis=1) < at, :, 1] += 1.0
    _, first, number = np.unique(np.round(places.reshape(-1, d), 9), axis=0, return_index=True, return_inverse=True)
    points = places.reshape(-1, d)[first]
    moving = np.isin(rows, patches["body"].nodes).reshape(-1)[first]
    on = {"body": ("moving", moving), "y0": ("periodic", np.abs(points[:, 1] - at) < 1e-9),
          "y1": ("periodic", np.abs(points[:, 1] - at - 1.0) < 1e-9),
          "ends": ("fixed", (points[:, 0] == 0.0) | (points[:, 0] == 1.0))}  # fmt: skip
    table = CellTable.from_arrays({name: number.reshape(rows.shape)})
    return points, table, {patch: Patch(role, np.flatnonzero(marked)) for patch, (role, marked) in on.items()}


@pytest.mark.parametrize("ranks", [1, 2, 3])
def test_a_correction_reaches_beyond_a_periodic_side(server, ranks):
    """The cells that resist are near one side only: those about the images of its nodes are asked for."""
    whole = as_client(*cut_elsewhere(periodic_box("quad", 40), 0.3))

    def drive(session, part):
        moved = session.move(np.tile([0.03, 0.0], (len(session.moving_nodes), 1)))
        return moved, part.points + moved.displacement

    settings = SETTINGS | {"support_radius": 0.3}
    with connect(server.endpoint) as client, client.open(whole, settings) as session:
        reply, expected = drive(session, whole)
    parts = in_pieces(whole, ranks) if ranks > 1 else [whole]
    for part, (moved, points) in zip(parts, on_ranks(server, parts, drive, settings), strict=True):
        nodes = slice(None) if part.global_ids is None else part.global_ids
        assert moved.correction["freed_nodes"] == reply.correction["freed_nodes"] > 300
        assert np.abs(points - expected[nodes]).max() < 1e-9
