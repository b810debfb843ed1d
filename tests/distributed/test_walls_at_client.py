"""Nodes slide, and move like their images, if the client has the volume: equal to the whole mesh, on any ranks."""

import numpy as np
import pytest
from mesh_motion_client import InvalidInput, Mesh, Patch, connect
from mesh_motion_numerics.distributed.rank import Rank
from mesh_motion_numerics.mesh.cells import CellTable
from own_ranks import (
    CORRECTED,
    as_client,
    assert_as_the_whole_mesh,
    assert_kept_after_kill_9,
    assert_same_derivatives,
    in_pieces,
    on_ranks,
)
from periodic_meshes import periodic_box, sector
from sliding_meshes import duct


def with_roles(mesh, roles):
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
    "sector of 50°": lambda: sector("quad", 20, sectors=7.2),
    "sector in space": lambda: with_roles(sector("hexahedron", 10), {"z0": "slip", "z1": "slip"}),
}
#: Of the block: no cell resists the first, some do the others.
SMALL, LARGE = (0.01, 0.006, 0.004), (0.1, 0.2, 0.1)


def in_two_steps(session, part):
    """The answers of two steps, and the positions of the nodes after each."""
    found = []
    for shift in (SMALL, LARGE):
        rows = np.tile(shift[: part.points.shape[1]], (len(session.moving_nodes), 1))
        moved = session.move(rows)
        session.commit()
        found.append((moved, session.points()))
    return found


@pytest.mark.parametrize("mesh", MESHES)
def test_nodes_slide_as_in_a_session_with_the_whole_mesh(server, mesh):
    """Bitwise equal on any number of ranks; equal to the whole mesh within rounding or the iterations' tolerance."""
    whole = as_client(*MESHES[mesh]())
    one = assert_as_the_whole_mesh(server, whole, in_two_steps)
    walls = np.setdiff1d(whole.patches["y0"].nodes, whole.patches["x0"].nodes)
    assert np.abs(one[1][1] - whole.points)[walls].max() > 0.005


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
    """The resisting cells are near one side only: the cells around the images of its nodes are requested."""
    whole = as_client(*cut_elsewhere(periodic_box("quad", 40), 0.3))

    def drive(session, part):
        moved = session.move(np.tile([0.03, 0.0], (len(session.moving_nodes), 1)))
        return moved, part.points + moved.displacement

    settings = {"support_radius": 0.3}
    with connect(server.endpoint) as client, client.open(whole, settings) as session:
        reply, expected = drive(session, whole)
    parts = in_pieces(whole, ranks) if ranks > 1 else [whole]
    for part, (moved, points) in zip(parts, on_ranks(server, parts, drive, settings), strict=True):
        nodes = slice(None) if part.global_ids is None else part.global_ids
        assert moved.correction["freed_nodes"] == reply.correction["freed_nodes"] > 300
        assert np.abs(points - expected[nodes]).max() < 1e-9


@pytest.mark.parametrize("mesh", ["plane", "curved", "planes in space", "periodic", "sector", "sector of 50°"])
@pytest.mark.parametrize("shift", [SMALL, LARGE], ids=["plain", "corrected"])
def test_derivatives_are_those_of_a_session_with_the_whole_mesh(server, mesh, shift):
    whole = as_client(*MESHES[mesh]())
    assert_same_derivatives(server, whole, 3, lambda moving: np.tile(shift[: moving.shape[1]], (len(moving), 1)))


@pytest.mark.parametrize(("mesh", "durability"), [("curved", "replay"), ("periodic", "full")])
def test_after_kill_9_the_nodes_are_bitwise_the_same(tmp_path, mesh, durability):
    assert_kept_after_kill_9(tmp_path, as_client(*MESHES[mesh]()), in_two_steps, durability)


def test_a_moving_node_that_leaves_its_plane_is_named(server):
    points, cells, patches = duct("quad", 10)
    nodes = np.flatnonzero((points[:, 1] == 0.0) & (points[:, 0] > 0.3) & (points[:, 0] < 0.7))
    moving = patches | {"piston": Patch("moving", nodes), "y0": Patch("symmetry", patches["y0"].nodes)}
    whole, ids = as_client(points, cells, moving), nodes

    def drive(session, part):
        rows = np.zeros((len(session.moving_nodes), 2))
        on_plane = part.points[session.moving_nodes, 1] == 0.0
        rows[on_plane] = [0.0, 0.01]
        with pytest.raises(InvalidInput, match="leaves the plane of the symmetry patch 'y0'") as refused:
            session.move(rows)
        rows[on_plane] = [0.01, 0.0]
        session.move(rows)
        return refused.value.details.get("global_id", refused.value.details["node"])

    for parts in ([whole], in_pieces(whole, 2)):
        assert set(on_ranks(server, parts, drive, {})) <= set(ids.tolist())


def test_displacements_that_tear_a_pair_are_refused(server):
    points, cells, patches = periodic_box("quad", 10)
    rows = np.flatnonzero((np.abs(points[:, 0] - 0.5) < 0.11) & ((points[:, 1] == 0.0) | (points[:, 1] == 1.0)))
    whole = as_client(points, cells, patches | {"pair": Patch("moving", rows)})

    def drive(session, part):
        boundary = 0.01 * part.points[session.moving_nodes]
        with pytest.raises(InvalidInput, match=r"its periodic image, differ by 0\.01"):
            session.move(boundary)

    on_ranks(server, [whole], drive, {})


@pytest.mark.parametrize(
    ("mesh", "correction", "expected"),
    [
        ("plane", "none", "'smooth'"),
        ("plane", "optimised", "'smooth'"),
        ("periodic", "optimised", "'none' or 'smooth'"),
    ],
)
def test_a_correction_that_judges_how_nodes_slide_is_refused(server, mesh, correction, expected):
    settings = CORRECTED | {"correction": correction}
    with (
        connect(server.endpoint) as client,
        pytest.raises(InvalidInput, match=f"expected correction = {expected}, got '{correction}'") as refused,
    ):
        client.open(as_client(*MESHES[mesh]()), settings, evaluation="client")
    assert refused.value.code == "INVALID_ARGUMENT.MESH"


def test_the_facets_of_the_boundary_have_to_come(server, monkeypatch):
    """Like a client that does not send near cells; without such roles none are needed."""
    monkeypatch.setattr(Rank, "facets", property(lambda self: {}))
    with connect(server.endpoint) as client:
        with pytest.raises(InvalidInput, match="role 'slip', expected moving or fixed: partition 0 sent no facets"):
            client.open(as_client(*duct("quad", 10)), evaluation="client")
        roles = {"y0": "fixed", "y1": "fixed"}
        with client.open(as_client(*with_roles(duct("quad", 10), roles)), evaluation="client") as session:
            session.move(np.tile(SMALL[:2], (len(session.moving_nodes), 1)))


def test_one_layer_of_cells_between_planes_that_slide_is_refused(server):
    points, cells, patches = duct("hexahedron", 10)
    (block,) = cells
    heights = points[block.nodes][:, :, 2]
    layer = block.nodes[((heights > 0.35) & (heights < 0.55)).all(axis=1)]
    nodes, rows = np.unique(layer, return_inverse=True)
    at = points[nodes]
    roles = {"body": ("moving", np.flatnonzero(np.isin(nodes, patches["body"].nodes))),
             "ends": ("fixed", np.flatnonzero((at[:, 0] == 0.0) | (at[:, 0] == 1.0))),
             "planes": ("slip", np.arange(len(nodes)))}  # fmt: skip
    mesh = Mesh(at, {"hexahedron": rows.reshape(-1, 8)}, {name: Patch(*of) for name, of in roles.items()})
    with connect(server.endpoint) as client, pytest.raises(InvalidInput, match="as those of one layer of cells"):
        client.open(mesh, evaluation="client")
