"""Layers move with their wall if the client has the volume: equal to the whole mesh, on any ranks."""

import numpy as np
import pytest
from layered_grids import beyond_the_wall, grid, pitched
from mesh_motion_client import InvalidInput, connect, opened
from mesh_motion_numerics.distributed.rank import Rank
from mesh_motion_protocol.messages import Build
from own_ranks import (
    SETTINGS,
    assert_as_the_whole_mesh,
    assert_kept_after_kill_9,
    assert_same_derivatives,
    in_pieces,
    on_ranks,
)


def in_two_steps(session, part):
    """The answers of two steps, and the positions of the nodes after each."""
    found = []
    for degrees in (1.0, 25.0):
        moved = session.move(pitched(part.points[session.moving_nodes], degrees))
        session.commit()
        found.append((moved, session.points()))
    return found


@pytest.mark.parametrize("kind", ["quads", "triangles", "even", pytest.param("wing", marks=pytest.mark.nightly)])
def test_layers_are_carried_as_in_a_session_with_the_whole_mesh(server, kind):
    """Bitwise equal on any number of ranks; equal to the whole mesh within rounding or the iterations' tolerance."""
    whole = grid(kind)
    one = assert_as_the_whole_mesh(server, whole, in_two_steps)
    for parts in (in_pieces(whole, 2), in_pieces(whole, 3)):
        for part, found in zip(parts, on_ranks(server, parts, in_two_steps, {}), strict=True):
            for (_, points), (_, there) in zip(found, one, strict=True):
                np.testing.assert_array_equal(points, there[part.global_ids])


def test_a_rank_without_a_node_of_the_wall_has_a_part_of_its_layer(server, monkeypatch):
    whole = grid("quads")
    parts, sent, near = beyond_the_wall(whole), [], Rank.near

    def counted(self, wall, reach):
        nodes, cells = near(self, wall, reach)
        sent.append((len(self.facets["line"]), sum(map(len, cells.values()))))
        return nodes, cells

    (one,) = on_ranks(server, [whole], in_two_steps, {})
    monkeypatch.setattr(Rank, "near", counted)
    found = on_ranks(server, parts, in_two_steps, {})
    assert [{patch.role for patch in part.patches.values()} for part in parts] == [{"moving"}, {"fixed"}]
    assert all(any(cells for of, cells in sent if of == facets) for facets, _ in sent)
    for part, steps in zip(parts, found, strict=True):
        for (_, points), (_, there) in zip(steps, one, strict=True):
            np.testing.assert_array_equal(points, there[part.global_ids])


def test_cells_near_the_wall_travel_once_and_no_others(server, monkeypatch):
    whole, sent, near = grid("quads"), [], Rank.near

    def counted(self, wall, reach):
        nodes, cells = near(self, wall, reach)
        sent.append((len(nodes), sum(map(len, cells.values()))))
        return nodes, cells

    monkeypatch.setattr(Rank, "near", counted)
    on_ranks(server, [whole], lambda session, part: None, {})
    nodes, cells = np.sum(sent, axis=0)
    assert len(sent) == 2
    assert 0 < cells < 0.8 * len(whole.cells["quad"])
    assert 0 < nodes < 0.8 * len(whole.points)


def test_without_cells_near_the_wall_no_layer_is_carried(server, monkeypatch):
    """Like a client that sends no near cells: the bounds above would refuse them."""
    whole = grid("quads")

    def drive(session, part):
        return session.mesh_report["warnings"], in_two_steps(session, part)

    ((warnings, carried),) = on_ranks(server, [whole], drive, {})
    assert warnings == []
    monkeypatch.setattr(Rank, "facets", property(lambda self: {}))
    ((warnings, alone),) = on_ranks(server, [whole], drive, {})
    assert np.abs(alone[0][1] - carried[0][1]).max() > 1e-6
    assert ["partition 0 has sent no facets: no layer" in text for text in warnings] == [True]


def test_a_rank_that_sends_no_cells_near_walls_is_named(server, monkeypatch):
    """Like the client in C: no layer is carried on any rank, and all ranks get a warning."""

    def without_reach(*, reach, partition, **rest):
        return Build(reach=None if partition == 1 else reach, partition=partition, **rest)

    monkeypatch.setattr(opened, "Build", without_reach)
    found = on_ranks(server, in_pieces(grid("quads"), 2), lambda session, _: session.mesh_report["warnings"], {})
    assert ["partition 1 has sent no cells near moving walls: no layer" in text for (text,) in found] == [True, True]
    settings = SETTINGS | {"correction": "none"}  # which carries no layers
    assert on_ranks(server, in_pieces(grid("quads"), 2), lambda s, _: s.mesh_report["warnings"], settings) == [[], []]


@pytest.mark.parametrize("degrees", [1.0, 25.0], ids=["plain", "corrected"])
@pytest.mark.parametrize("kind", ["quads", pytest.param("wing", marks=pytest.mark.nightly)])
def test_derivatives_are_those_of_a_session_with_the_whole_mesh(server, kind, degrees):
    assert_same_derivatives(server, grid(kind), 2, lambda moving: pitched(moving, degrees))


def test_after_kill_9_the_nodes_are_bitwise_the_same(tmp_path):
    assert_kept_after_kill_9(tmp_path, grid("quads"), in_two_steps, "replay")


def test_a_cell_that_comes_twice_is_named(server, monkeypatch):
    whole, near = grid("quads"), Rank.near

    def twice(self, wall, reach):
        nodes, cells = near(self, wall, reach)
        return nodes, {name: np.concatenate([rows, rows[:1]]) for name, rows in cells.items()}

    monkeypatch.setattr(Rank, "near", twice)
    with connect(server.endpoint) as client, pytest.raises(InvalidInput, match="cell 0 of type 'quad' in partition 0"):
        client.open(whole, evaluation="client")
