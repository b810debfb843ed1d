"""The client moves and judges the volume: bitwise the results of a server with the whole mesh, on any number of
ranks.
"""

import signal
import threading

import numpy as np
import pytest
from box_meshes import box_mesh
from far_meshes import aerofoil, far_block
from mesh_motion_client import InvalidInput, Mesh, Patch, QualityRefused, SessionError, connect
from mesh_motion_protocol.messages import Fetch, Fetched
from own_ranks import (
    CORRECTED,
    SETTINGS,
    as_client,
    assert_same_derivatives,
    assert_same_quality,
    assert_same_worst,
    bend,
    in_pieces,
    on_ranks,
    pieces,
    whole,
)

from mesh_motion_server.cases.recorded import read_recorded
from mesh_motion_server.session.inspection import inspect_session
from mesh_motion_server.watch.pictures.meshes import read_pair
from tests.faults.server_process import ServerProcess
from tests.faults.waiting import PATIENCE

#: Two with one dense matrix, two in two scales.
MESHES = {
    "plane": ("quad", 20),
    "space": ("hexahedron", 10),
    "many in plane": ("quad", 240),
    "many": ("hexahedron", 15),
}
METRICS = ("size-skew", "relative-size-skew")


def drive(session, mesh, steps=2, by=1):
    """Make two moves in each step; return the answers and the positions of the nodes."""
    found = []
    for step in range(1, steps + 1):
        for share in (0.5, 1.0):
            moved = session.move(share * bend(mesh.points[session.moving_nodes], by * step))
        found += [moved, session.commit()]
    return [*found, session.points()]


@pytest.mark.parametrize(("mesh", "ranks", "metric"), [
    *((mesh, ranks, metric) for mesh in ("plane", "space") for ranks in (1, 3) for metric in METRICS),
    *((mesh, *one) for mesh in ("many in plane", "many") for one in zip((1, 3), METRICS, strict=True)),
])  # fmt: skip
def test_corrected_nodes_are_those_of_a_session_with_the_whole_mesh(server, mesh, ranks, metric):
    everything, settings = whole(*MESHES[mesh]), CORRECTED | {"quality_metric": metric}

    def drive(session, part):
        found = []
        for step in (16, 24):
            moved = session.move(bend(part.points[session.moving_nodes], step))
            found += [moved, session.commit(), session.points()]
        return found

    with connect(server.endpoint) as client, client.open(everything, settings) as session:
        expected = drive(session, everything)
    freed = [moved.correction["freed_nodes"] for moved in expected[::3]]
    assert max(freed) > 0
    parts = pieces(*MESHES[mesh], ranks) if ranks > 1 else [everything]
    for part, found in zip(parts, on_ranks(server, parts, drive, settings), strict=True):
        nodes = np.arange(len(part.points)) if part.global_ids is None else part.global_ids
        assert [moved.correction for moved in found[::3]] == [moved.correction for moved in expected[::3]]
        for one, other in zip(found[::3], expected[::3], strict=True):
            np.testing.assert_array_equal(one.displacement, other.displacement[nodes])
            for which in ("standard", "corrected"):  # judged where the server had not yet rounded the answer
                least, expected_least = (each.quality[which]["metric"]["min"] for each in (one, other))
                assert least == pytest.approx(expected_least, rel=1e-12)
        for one, other in zip(found[1::3], expected[1::3], strict=True):
            assert_same_quality(one.quality, other.quality)
        for one, other in zip(found[2::3], expected[2::3], strict=True):
            np.testing.assert_array_equal(one, other[nodes])


@pytest.mark.parametrize("mesh", ["plane", "many in plane", "many"])
def test_the_default_motion_is_that_of_a_session_with_the_whole_mesh(server, mesh):
    """Bitwise equal on any number of ranks; equal to the whole mesh within the tolerance of the iterations, which start
    from other values.
    """
    everything = whole(*MESHES[mesh])

    def drive(session, part):
        moved = [session.move(bend(part.points[session.moving_nodes], step)) for step in (4, 16, 20)]
        assert moved[-1].correction["method"] == "smooth"
        assert not moved[-1].warnings
        assert moved[-1].quality["corrected"]["metric"]["min"] > moved[-1].quality["standard"]["metric"]["min"] + 0.05
        session.commit()
        return session.points()

    with connect(server.endpoint) as client, client.open(everything) as session:
        expected = drive(session, everything)
    one = on_ranks(server, [everything], drive, {})[0]
    assert np.abs(one - expected).max() < 1e-9
    parts = pieces(*MESHES[mesh], 3)
    for part, found in zip(parts, on_ranks(server, parts, drive, {}), strict=True):
        np.testing.assert_array_equal(found, one[part.global_ids])


def test_a_motion_whose_interpolation_inverts_cells_is_led_from_rest(server):
    """A body that turns by 90 degrees in one step."""

    def drive(session, part):
        turn = np.array([[0.0, -1.0], [1.0, 0.0]]) - np.eye(2)
        moved = session.move((part.points[session.moving_nodes] - 0.5) @ turn.T)
        session.commit()
        return moved, session.points()

    everything, parts = whole("quad", 20), pieces("quad", 20, 2)
    one, two = (on_ranks(server, ranks, drive, {}) for ranks in ([everything], parts))
    for part, (_, points) in zip(parts, two, strict=True):
        np.testing.assert_array_equal(points, one[0][1][part.global_ids])
    for moved, _ in one + two:
        assert moved.quality["standard"]["inverted"] > 0
        assert moved.quality["corrected"]["inverted"] == 0
        assert moved.correction["method"] == "smooth"


@pytest.mark.parametrize("ranks", [1, 2, 3])
@pytest.mark.parametrize("mesh", MESHES)
def test_nodes_and_quality_are_those_of_a_session_with_the_whole_mesh(server, mesh, ranks):
    everything = whole(*MESHES[mesh])
    with connect(server.endpoint) as client, client.open(everything, SETTINGS) as session:
        expected = drive(session, everything)
    parts = pieces(*MESHES[mesh], ranks) if ranks > 1 else [everything]
    for part, found in zip(parts, on_ranks(server, parts, drive), strict=True):
        nodes = np.arange(len(part.points)) if part.global_ids is None else part.global_ids
        for one, other in zip(found[:4:2], expected[:4:2], strict=True):
            np.testing.assert_array_equal(one.displacement, other.displacement[nodes])
            assert_same_worst(one.quality["corrected"], other.quality["corrected"])
        for one, other in zip(found[1:4:2], expected[1:4:2], strict=True):
            assert_same_quality(one.quality, other.quality)
        np.testing.assert_array_equal(found[-1], expected[-1][nodes])


@pytest.mark.parametrize(
    ("make", "settings", "most"),
    [
        pytest.param(lambda: far_block("quad", 40), SETTINGS, 0.0, id="plain"),
        pytest.param(lambda: far_block("quad", 40), {}, 1e-9, id="smooth"),
        pytest.param(aerofoil, {}, 1e-9, id="aerofoil with layers"),
    ],
)
def test_a_body_in_a_far_field_moves_as_in_a_session_with_the_whole_mesh(server, make, settings, most):
    """Its mean displacement is a part of the field; derivatives, too."""
    everything = as_client(*make())

    def turn(points):
        return (points - 0.5) @ np.array([[-0.2, 0.5], [-0.5, -0.2]])

    def drive(session, part):
        session.move(turn(part.points[session.moving_nodes]))
        session.commit()
        return session.points()

    with connect(server.endpoint) as client, client.open(everything, settings) as session:
        expected = drive(session, everything)
    parts = in_pieces(everything, 2)
    for part, points in zip(parts, on_ranks(server, parts, drive, settings), strict=True):
        assert np.abs(points - expected[part.global_ids]).max() <= most
    if not settings:
        assert_same_derivatives(server, everything, 2, turn)


def test_a_new_session_on_another_number_of_ranks_leads_to_the_same_nodes(server):
    kind, count = MESHES["many in plane"]

    def last(session, part, steps):
        for step in steps:
            moved = session.move(bend(part.points[session.moving_nodes], step))
            session.commit()
        assert moved.correction["freed_nodes"] > 0
        return session.points()

    found = {}
    for ranks, steps in ((2, (16, 20, 24)), (3, (24,))):
        parts = pieces(kind, count, ranks)
        points = on_ranks(server, parts, lambda session, part, steps=steps: last(session, part, steps), CORRECTED)
        ids, first = np.unique(np.concatenate([part.global_ids for part in parts]), return_index=True)
        found[ranks] = ids, np.concatenate(points)[first]
    for one, other in zip(found[2], found[3], strict=True):
        np.testing.assert_array_equal(one, other)


def test_the_worst_cells_are_named_by_partition_and_type(server):
    parts = pieces("quad + triangle", 20, 2)
    found = on_ranks(server, parts, drive)
    for cell in found[0][2].quality["corrected"]["worst"]:
        part, displaced = parts[cell["partition"]], found[cell["partition"]][2].displacement
        nodes = part.cells[cell["type"]][cell["cell"]]
        np.testing.assert_allclose((part.points + displaced)[nodes].mean(axis=0), cell["centre"])


def test_a_mesh_of_two_cell_types_and_a_basis_with_a_polynomial(server):
    mesh = whole("quad + triangle", 20)
    settings = SETTINGS | {"basis": "tps", "quality_metric": "size-skew"}
    found = []
    for evaluation in ("server", "client"):
        with connect(server.endpoint) as client, client.open(mesh, settings, evaluation=evaluation) as session:
            found.append(drive(session, mesh))
    np.testing.assert_array_equal(found[0][-1], found[1][-1])
    assert_same_quality(found[1][-2].quality, found[0][-2].quality)
    worst = [one[-2].quality["worst"] for one in found]  # of equal cells the first ones count, in each one's own order
    named = [{(cell["type"], cell["cell"]) for cell in one if cell["metric"] < one[-1]["metric"]} for one in worst]
    assert named[0] == named[1]


def test_refusals_are_those_of_a_session_with_the_whole_mesh(server):
    settings = SETTINGS | {"refuse_below_threshold": True, "quality_threshold": 0.9}
    mesh = whole("quad", 20)
    refusals = []
    with connect(server.endpoint) as client:
        for evaluation in ("server", "client"):
            with client.open(mesh, settings, evaluation=evaluation) as session:
                boundary = bend(mesh.points[session.moving_nodes], 3)
                with pytest.raises(QualityRefused) as refused:
                    session.move(4.0 * boundary)
                refusals.append(refused.value)
                if evaluation == "client":
                    with pytest.raises(SessionError, match="not judged, or it was refused"):
                        session.commit()
                session.move(0.1 * boundary)
                assert session.commit().step == 1
    whole_mesh, here = refusals
    assert (here.code, here.message, here.best) == (whole_mesh.code, whole_mesh.message, whole_mesh.best)
    assert [cell["type"] for cell in here.worst] == [cell["type"] for cell in whole_mesh.worst]
    assert here.fraction is None


@pytest.mark.parametrize("settings", [CORRECTED, {}], ids=["threshold", "smooth"])
@pytest.mark.parametrize("ranks", [1, 2])
@pytest.mark.parametrize(
    ("distance", "fault"),
    [(0.47, "cross itself"), (0.9, "leave its side of another part"), (5.0, "leave its side of another part")],
)
def test_a_boundary_that_crosses_itself_is_named_here_too(server, ranks, settings, distance, fault):
    def through_the_wall(session, part):
        with pytest.raises(QualityRefused) as refused:
            session.move(np.tile([distance, 0.03], (len(session.moving_nodes), 1)))
        return str(refused.value)

    parts = pieces("quad", 20, ranks) if ranks > 1 else [whole("quad", 20)]
    for message in on_ranks(server, parts, through_the_wall, settings):
        assert f"no valid mesh exists: the boundary would {fault} near" in message


@pytest.mark.parametrize(
    ("setting", "value"),
    [
        ("displacement", "relative"),
        ("correction", "enrichment"),
        ("correction_target", "maximum"),
        ("correction_target", None),
        ("sub_steps", "auto"),
        ("reduction", "greedy"),
    ],
)
def test_a_motion_that_takes_the_volume_is_refused_at_open(server, setting, value):
    settings = CORRECTED if setting.startswith("correction_") else SETTINGS
    with connect(server.endpoint) as client, pytest.raises(InvalidInput, match=f"expected {setting} = ") as refused:
        client.open(whole("quad", 10), settings | {setting: value}, evaluation="client")
    assert refused.value.code == "INVALID_ARGUMENT.SETTINGS"
    assert "evaluation = 'server'" in refused.value.hint


@pytest.mark.parametrize(("change", "says"), [
    (lambda box: {"body": Patch("moving", box.body), "outer": Patch("slip", box.outer)}, "has the role 'slip'"),
    (lambda box: {"body": Patch("moving", np.union1d(box.body, box.outer))}, "no node is fixed"),
    (lambda box: {"body": Patch("moving", box.body), "outer": Patch("fixed", box.outer[1:])}, "on no patch"),
])  # fmt: skip
def test_a_boundary_that_takes_the_volume_is_refused_at_build(server, change, says):
    box = box_mesh("quad", 10)
    mesh = Mesh(box.points, {"quad": box.cells.blocks[0].nodes}, change(box))
    with connect(server.endpoint) as client, pytest.raises(InvalidInput, match=says):
        client.open(mesh, SETTINGS, evaluation="client")


def test_two_nodes_at_the_same_place_are_refused(server):
    """Two separate squares."""
    square = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    points = np.concatenate([square, square + np.array([1.0, 0.0])])
    patches = {"left": Patch("moving", [0, 1, 2, 3]), "right": Patch("fixed", [4, 5, 6, 7])}
    mesh = Mesh(points, {"quad": [[0, 1, 2, 3], [4, 5, 6, 7]]}, patches)
    with connect(server.endpoint) as client, pytest.raises(InvalidInput, match="has the same position as that with 1"):
        client.open(mesh, SETTINGS, evaluation="client")


def test_increments_and_faces_are_refused(server):
    mesh = whole("quad", 10)
    with connect(server.endpoint) as client, client.open(mesh, SETTINGS, evaluation="client") as session:
        boundary = bend(mesh.points[session.moving_nodes], 1)
        with pytest.raises(InvalidInput, match="expected frame 'reference'"):
            session.move(boundary, frame="committed")
        with pytest.raises(InvalidInput, match="expected report ''"):
            session.move(boundary, report="faces")
        session.move({"body": boundary})
        session.rollback()
        assert (session.step, session.iteration) == (0, 0)


def raw_field(session):
    fetched = session._courier.deliver(Fetch(**session._address), Fetched, PATIENCE)
    return fetched.coefficients.tobytes(), fetched.points.tobytes()


@pytest.mark.parametrize(
    ("mesh", "durability", "settings"),
    [  # every two of them meet
        pytest.param("plane", "full", SETTINGS, id="plane-full-plain"),
        pytest.param("plane", "replay", CORRECTED, id="plane-replay-corrected"),
        pytest.param("plane", "replay", {}, id="plane-replay-default"),
        pytest.param("many", "replay", SETTINGS, id="many-replay-plain"),
        pytest.param("many", "full", CORRECTED, id="many-full-corrected"),
        pytest.param("many", "full", {}, id="many-full-default"),
    ],
)
def test_after_kill_9_field_and_nodes_are_bitwise_the_same(tmp_path, mesh, durability, settings):
    mesh, by = whole(*MESHES[mesh]), 1 if settings is SETTINGS else 8 if settings else 6
    with ServerProcess(tmp_path) as server, connect(server.endpoint) as client:
        session = client.open(mesh, settings, evaluation="client", durability=durability)
        drive(session, mesh, by=by)
        field, points = raw_field(session), session.points()
        session.move(bend(mesh.points[session.moving_nodes], 3 * by))
        server.stop(signal.SIGKILL)
        server.start()
        third = session.commit()  # the trial is made and judged again
        after = raw_field(session), session.points()
        server.stop(signal.SIGKILL)
        server.start()
        with connect(server.endpoint) as other, other.resume(session.credentials, mesh) as resumed:
            assert (raw_field(resumed), resumed.points().tobytes()) == (after[0], after[1].tobytes())
            again = resumed.move(bend(mesh.points[resumed.moving_nodes], 2 * by))
            np.testing.assert_array_equal(mesh.points + again.displacement, points)
            resumed.commit()
            assert raw_field(resumed) == field
            assert third.step == 3
        session.leave()


def test_a_server_killed_between_move_and_judge_judges_the_same_trial(tmp_path, monkeypatch):
    mesh = whole("quad", 20)
    with (
        ServerProcess(tmp_path) as server,
        connect(server.endpoint) as client,
        client.open(mesh, SETTINGS, evaluation="client") as session,
    ):
        expected = drive(session, mesh, 1)
        judge = session._own_cells.volume.judge

        def killed_before(*given):
            server.stop(signal.SIGKILL)
            server.start()
            return judge(*given)

        monkeypatch.setattr(session._own_cells.volume, "judge", killed_before)
        moved = session.move(bend(mesh.points[session.moving_nodes], 1))
        np.testing.assert_array_equal(moved.displacement, expected[0].displacement)
        assert session.commit().step == 2


def test_after_kill_9_two_ranks_take_their_nodes_up_again(tmp_path):
    parts = pieces("hexahedron", 10, 2)
    with ServerProcess(tmp_path) as server:
        shared = []

        def begin(session, mesh):
            shared.append(session.credentials)
            return drive(session, mesh)[-1]

        points = on_ranks(server, parts, begin)
        server.stop(signal.SIGKILL)
        server.start()
        with connect(server.endpoint) as one, connect(server.endpoint) as other:
            first = one.resume(shared[0], parts[0])
            second = other.join(shared[0], parts[1], partition=1)
            for session, found in zip((first, second), points, strict=True):
                np.testing.assert_array_equal(session.points(), found)
            step = [bend(part.points[s.moving_nodes], 2) for part, s in zip(parts, (first, second), strict=True)]
            there = threading.Thread(target=lambda: second.move(step[1]))
            there.start()
            again = first.move(step[0])
            there.join(PATIENCE)
            np.testing.assert_array_equal(parts[0].points + again.displacement, points[0])
            second.close()
            first.close()


def test_pictures_and_replay_are_refused_because_the_client_has_the_cells(tmp_path):
    mesh = whole("quad", 10)
    with connect(state=tmp_path) as client, client.open(mesh, SETTINGS, evaluation="client") as session:
        drive(session, mesh, 1)
    folder = tmp_path / "sessions" / session.credentials.session
    for look in (read_pair, read_recorded):
        with pytest.raises(InvalidInput, match="the client has its cells"):
            look(folder)
    assert inspect_session(folder).state == "whole"


def test_a_resumed_session_needs_the_mesh(server):
    mesh = whole("quad", 10)
    with connect(server.endpoint) as client:
        with client.open(mesh, SETTINGS, evaluation="client") as session:
            drive(session, mesh, 1)
        with client.resume(session.credentials) as resumed, pytest.raises(InvalidInput, match="the mesh is not known"):
            resumed.points()
        with pytest.raises(InvalidInput, match="the mesh is not the one"):
            client.resume(session.credentials, whole("quad", 12))
        with client.resume(session.credentials, mesh) as resumed:
            resumed.move({"body": bend(mesh.points[np.sort(mesh.patches["body"].nodes)], 2)})


def test_an_unusable_cell_is_refused_by_its_rank(server):
    mesh = whole("quad", 10)
    mesh.points[
        np.setdiff1d(np.arange(len(mesh.points)), np.concatenate([p.nodes for p in mesh.patches.values()]))[0]
    ] += 0.5
    with connect(server.endpoint) as client, pytest.raises(InvalidInput, match="inverted or degenerate"):
        client.open(mesh, SETTINGS, evaluation="client")


def test_a_node_without_a_cell_is_refused_by_its_rank(server):
    box = box_mesh("quad", 4)
    points = np.vstack([box.points, [[5.0, 5.0]]])
    patches = {"body": Patch("moving", box.body), "outer": Patch("fixed", box.outer)}
    mesh = Mesh(points, {b.type.name: b.nodes for b in box.cells}, patches)
    with connect(server.endpoint) as client, pytest.raises(InvalidInput, match=f"node {len(points) - 1} is in no cell"):
        client.open(mesh, SETTINGS, evaluation="client")


def velocities(session, part):
    x = part.points[session.moving_nodes]
    return np.stack([np.sin(5.0 * x + 1.0), np.cos(3.0 * x[:, ::-1])]), np.sin(7.0 * part.points[:, ::-1] + 2.0)


@pytest.mark.parametrize(
    ("mesh", "settings"),
    [
        pytest.param("plane", SETTINGS, id="plane-plain"),
        pytest.param("plane", {}, id="plane-smooth"),
        pytest.param("many", SETTINGS, id="many-plain"),
        pytest.param("space", {}, id="space-smooth", marks=pytest.mark.nightly),
        pytest.param("many", {}, id="many-smooth", marks=pytest.mark.nightly),
    ],
)
def test_derivatives_are_those_of_a_session_with_the_whole_mesh(server, mesh, settings):
    """At a trial and at the committed state, with an active correction."""
    everything, step = whole(*MESHES[mesh]), 12
    holders = np.ones(len(everything.points))

    def drive(session, part):
        moved = session.move(bend(part.points[session.moving_nodes], step))
        assert session.derivatives
        assert (moved.correction["freed_nodes"] > 0) == (not settings)
        v, w = velocities(session, part)
        ids = np.arange(len(part.points)) if part.global_ids is None else part.global_ids
        share = w / holders[ids, None]
        found = [session.tangent(v), session.cotangent(np.stack([share, 2.0 * share]))]
        assert (session.move(bend(part.points[session.moving_nodes], step)).displacement == moved.displacement).all()
        session.commit()
        found += [session.tangent(v[0]), session.cotangent(share), v, w]
        return [*found, ids, ids[session.moving_nodes]]

    with connect(server.endpoint) as client, client.open(everything, settings) as session:
        velocity, _, _, weights, v, w, _, moving = drive(session, everything)
    # the iterations start from different values, and the minimum is found to 1e-9
    close = {"rtol": 0.0, "atol": (1e-10 if settings else 1e-7) * np.abs(velocity).max()}
    for parts in ([everything], pieces(*MESHES[mesh], 3)):
        if len(parts) > 1:
            holders = np.bincount(np.concatenate([part.global_ids for part in parts]))
        for answers in on_ranks(server, parts, drive, settings):
            *found, ids, own = answers
            np.testing.assert_allclose(found[0], velocity[:, ids], **close)
            np.testing.assert_array_equal(found[2], found[0][0])
            np.testing.assert_array_equal(found[3], found[1][0])
            np.testing.assert_allclose(found[1][1], 2.0 * found[1][0], rtol=1e-9, atol=1e-12)
            expected = weights[np.searchsorted(moving, own)]
            bound = (1e-10 if settings else 1e-6) * np.abs(weights).max()
            np.testing.assert_allclose(found[3], expected, rtol=0.0, atol=bound)
            if len(parts) == 1:
                there, back = np.sum(w * found[2]), np.sum(found[3] * v[0])
                size = np.abs(w * found[2]).sum() + np.abs(found[3] * v[0]).sum()
                assert abs(there - back) < (1e-12 if mesh != "many" else 1e-11) * size


def test_derivatives_of_the_field_are_those_of_differences(server):
    mesh, h = whole("quad", 20), 1e-4

    def drive(session, part):
        at, (v, _) = bend(part.points[session.moving_nodes], 12), velocities(session, part)
        session.move(at)
        found, moved = session.tangent(v[0]), []
        for k in (1, -1, 2, -2):
            moved.append(session.move(at + k * h * v[0]).displacement)
        exact = (8.0 * (moved[0] - moved[1]) - (moved[2] - moved[3])) / (12.0 * h)
        return np.abs(found - exact).max() / np.abs(found).max()

    assert on_ranks(server, [mesh], drive, SETTINGS)[0] < 1e-9
    assert on_ranks(server, [mesh], drive, {})[0] < 1e-5  # the minimum is found to 1e-9


def test_after_a_crash_and_a_resume_the_derivative_of_the_committed_state_is_there(tmp_path):
    """The server has lost the corrected region: the client sends it again."""
    mesh = whole("quad", 20)
    with ServerProcess(tmp_path) as server, connect(server.endpoint) as client:
        session = client.open(mesh, evaluation="client")
        session.move(bend(mesh.points[session.moving_nodes], 12))
        session.commit()
        v, w = velocities(session, mesh)
        found = session.tangent(v), session.cotangent(w)
        server.stop(signal.SIGKILL)
        server.start()
        np.testing.assert_array_equal(session.cotangent(w), found[1])
        session.close()
        with client.resume(session.credentials, mesh) as again:
            for one, other in zip((again.tangent(v), again.cotangent(w)), found, strict=True):
                np.testing.assert_array_equal(one, other)


def test_at_rest_and_with_another_correction(server):
    mesh = whole("quad", 20)
    with connect(server.endpoint) as client, client.open(mesh, evaluation="client") as session:
        v, _ = velocities(session, mesh)
        plain = session.tangent(v)
        assert (plain[:, session.moving_nodes] == v).all()
    with connect(server.endpoint) as client, client.open(mesh, CORRECTED, evaluation="client") as session:
        assert not session.derivatives
        with pytest.raises(SessionError, match=r"^correction = 'optimised'"):
            session.tangent(v)
