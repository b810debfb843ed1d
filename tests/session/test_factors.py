"""The factor cache: reuse, its byte limit, and its counts."""

from dataclasses import dataclass
from unittest import mock

import numpy as np
from frame_meshes import square_frame
from mesh_motion_numerics.interpolation.two_scale import factorization
from mesh_motion_numerics.method import Method
from mesh_motion_numerics.motion.motion import MotionModel

from mesh_motion_server.session.factors import FactorCache


@dataclass
class Sized:
    nbytes: int


def test_the_same_key_is_made_once() -> None:
    cache = FactorCache(100)
    first, reused = cache.get_or_make(b"a", lambda: Sized(10))
    assert not reused
    again, reused = cache.get_or_make(b"a", lambda: Sized(11))
    assert reused
    assert again is first
    assert (cache.made["factorization"], cache.reused["factorization"]) == (1, 1)


def test_factors_that_a_step_has_not_used_are_dropped_at_its_commit() -> None:
    cache = FactorCache(1000)
    for step in range(10):
        for iteration in range(2):
            _, reused = cache.get_or_make(b"of the reference mesh", lambda: Sized(10))
            assert reused == bool(step or iteration)
            _, reused = cache.get_or_make(b"of state %d" % step, lambda: Sized(10))
            assert reused == bool(iteration)
        cache.next_step()
        assert len(cache) == 2


def test_room_is_made_before_a_large_entry() -> None:
    """Old and new entries together could exceed the memory limit of the process."""
    cache, held = FactorCache(100), []

    def large() -> Sized:
        held.append(cache.nbytes)
        return Sized(80)

    for key in (b"a", b"b", b"c"):
        cache.get_or_make(key, lambda: Sized(30))
    cache.get_or_make(b"d", large)
    assert held == [30]
    assert cache.nbytes == 80


def test_kinds_share_one_budget_and_are_kept_apart() -> None:
    cache = FactorCache(100)
    factorization, _ = cache.get_or_make(b"a", lambda: Sized(40))
    operators, reused = cache.get_or_make(b"a", lambda: Sized(5), "operators")
    assert not reused
    assert operators is not factorization
    assert cache.held() == {"factorization": 40, "operators": 5}
    cache.get_or_make(b"a", lambda: Sized(0))  # the factorization is the one used last
    cache.get_or_make(b"b", lambda: Sized(60), "operators")
    assert cache.held() == {"factorization": 40, "operators": 60}
    assert (cache.made, cache.reused) == ({"factorization": 1, "operators": 2}, {"factorization": 1})


def test_the_least_recently_used_goes_first() -> None:
    cache = FactorCache(100)
    for key in (b"a", b"b"):
        cache.get_or_make(key, lambda: Sized(25))
    cache.get_or_make(b"a", lambda: Sized(0))
    cache.get_or_make(b"c", lambda: Sized(60))
    assert cache.get_or_make(b"c", lambda: Sized(1))[1]
    assert not cache.get_or_make(b"b", lambda: Sized(1))[1]


def test_bytes_stay_within_the_budget_but_the_newest_is_kept() -> None:
    cache = FactorCache(100)
    for number in range(20):
        cache.get_or_make(bytes([number]), lambda: Sized(30))
        assert cache.nbytes <= 100
    cache.get_or_make(b"large", lambda: Sized(500))
    assert (len(cache), cache.nbytes) == (1, 500)
    assert cache.get_or_make(b"large", lambda: Sized(1))[1]
    cache.clear()
    assert len(cache) == 0


def _disc(**choices: str) -> tuple[MotionModel, np.ndarray, np.ndarray]:
    """A square of quads with a square hole that moves, interpolated in two scales; two displacements of the hole."""
    points, cells, patches = square_frame(30, kind="quad")
    moving = patches["block"].nodes
    method = Method(support_radius=2.0, correction="none", **choices)
    with mock.patch.object(factorization, "AUTOMATIC_FROM", 0):
        model = MotionModel.build(points, cells, patches, method)
    turn = 0.02 * (points[moving] - 0.5) @ np.array([[0.0, 1.0], [-1.0, 0.0]])
    return model, turn + np.array([0.01, 0.0]), turn


def test_coupling_iterations_reuse_what_a_step_has_made_and_a_step_makes_its_own() -> None:
    model, *displacements = _disc()
    cache, committed = FactorCache(1 << 24), model.points
    for _ in range(3):
        reported = []
        for iteration in range(3):
            targets = committed[model.roles.moving] + displacements[iteration % 2]
            motion = model.move(committed, targets, cache)
            reported.append((motion.caches["factorization"], motion.caches["operators"]))
            alone = model.move(committed, targets)
            assert motion.points.tobytes() == alone.points.tobytes()
        assert reported == [("made", "made"), ("reused", "reused"), ("reused", "reused")]
        assert set(cache.held()) == {"factorization", "operators"}
        committed = motion.points


def test_steps_that_all_start_from_the_reference_mesh_make_nothing_after_the_first() -> None:
    model, displacement, _ = _disc(displacement="absolute")
    cache, committed = FactorCache(1 << 24), model.points
    for step in range(1, 4):
        motion = model.move(committed, model.points[model.roles.moving] + step * displacement, cache)
        reported = "made" if step == 1 else "reused"
        assert (motion.caches["factorization"], motion.caches["operators"]) == (reported, reported)
        committed = motion.points
    assert (cache.made, cache.reused) == ({"factorization": 1, "operators": 1}, {"factorization": 2, "operators": 2})


def test_a_budget_too_small_for_anything_changes_nothing_but_time() -> None:
    model, *displacements = _disc()
    cache, roomy = FactorCache(0), FactorCache(1 << 24)
    for iteration in range(3):
        targets = model.points[model.roles.moving] + displacements[iteration % 2]
        small, large = (model.move(model.points, targets, kept) for kept in (cache, roomy))
        assert small.points.tobytes() == large.points.tobytes()
        assert small.caches["factorization"] == "made"
        assert len(cache) == 1
