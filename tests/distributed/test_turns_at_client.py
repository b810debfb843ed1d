"""A body that turns on a solver's own ranks: equal to the whole mesh up to a quarter turn, and never beyond half a
turn.
"""

import numpy as np
import pytest
from box_meshes import box_mesh
from correction_cases import stored
from mesh_motion_client import MeshMotionError, connect
from mesh_motion_numerics.mesh.roles import Patch
from own_ranks import as_client, in_pieces, on_ranks


def mesh_with_a_body(found):
    patches = {"body": Patch("moving", np.unique(found.body)), "outer": Patch("fixed", np.unique(found.outer))}
    return as_client(found.points, found.cells, patches)


def goes(session, mesh, *angles):
    """Turn the body about the z axis through its centre, to one angle after the other; return the final points."""
    rest = mesh.points[session.moving_nodes]
    about = np.mean(mesh.points[mesh.patches["body"].nodes], axis=0)
    for degrees in angles:
        turn, angle = np.eye(rest.shape[1]), np.radians(degrees)
        turn[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
        session.move((rest - about) @ turn.T + about - rest)
        session.commit()
    return session.points()


def test_a_body_turns_up_to_half_a_turn(server):
    mesh = mesh_with_a_body(stored("thesis_block"))
    with connect(server.endpoint) as client:
        with client.open(mesh) as session:
            whole = goes(session, mesh, 60.0, 85.0)
        with client.open(mesh, evaluation="client") as session:
            np.testing.assert_allclose(goes(session, mesh, 60.0, 85.0), whole, atol=1e-9)
            kept = goes(session, mesh, 120.0, 170.0)
            for beyond, degrees in ((190.0, "190°"), (-150.0, "210°")):
                with pytest.raises(MeshMotionError, match=f"patch 'body' turns from 170° to {degrees}.* half a turn"):
                    goes(session, mesh, beyond)
            session.rollback()
            np.testing.assert_array_equal(session.points(), kept)
            back = goes(session, mesh, 90.0, 0.0, -120.0)
            np.testing.assert_allclose(goes(session, mesh, -160.0, -170.0, -120.0), back, atol=1e-9)
            with pytest.raises(MeshMotionError, match="patch 'body' turns from -120° to -190°"):
                goes(session, mesh, 170.0)


def test_in_space_and_on_several_ranks(server):
    mesh = mesh_with_a_body(box_mesh("tetra"))

    def work(session, part):
        rest = part.points[session.moving_nodes]
        centre, found = np.mean(mesh.points[mesh.patches["body"].nodes], axis=0), []
        for degrees in (120.0, 200.0):
            turn, angle = np.eye(3), np.radians(degrees)
            turn[1:, 1:] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
            try:
                session.move((rest - centre) @ turn.T + centre - rest)
                session.commit()
            except MeshMotionError as refusal:
                found.append(str(refusal))
        return found

    for found in on_ranks(server, in_pieces(mesh, 2), work, {}):
        assert ["patch 'body' turns from 120° to 200°" in text for text in found] == [True]


def test_without_a_correction_no_turn_is_refused(server):
    mesh = mesh_with_a_body(stored("thesis_block"))
    settings = {"displacement": "absolute", "correction": "none", "sub_steps": "never", "allow_invalid": True}
    with connect(server.endpoint) as client, client.open(mesh, settings, evaluation="client") as session:
        goes(session, mesh, 120.0, 240.0)
