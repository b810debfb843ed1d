"""The factor cache: reuse, its byte budget, and what it counts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mesh_motion_server.numerics.cells import CellTable
from mesh_motion_server.numerics.interpolant import Factorization
from mesh_motion_server.numerics.method import Method
from mesh_motion_server.numerics.motion import MotionModel
from mesh_motion_server.numerics.roles import Patch
from mesh_motion_server.session.factors import FactorCache


@dataclass
class Sized:
    nbytes: int


def test_the_same_key_is_made_once() -> None:
    cache: FactorCache[Sized] = FactorCache(100)
    first, reused = cache.get_or_make(b"a", lambda: Sized(10))
    assert not reused
    again, reused = cache.get_or_make(b"a", lambda: Sized(11))
    assert reused
    assert again is first
    assert (cache.made, cache.reused) == (1, 1)


def test_the_least_recently_used_goes_first() -> None:
    cache: FactorCache[Sized] = FactorCache(100)
    for key in (b"a", b"b"):
        cache.get_or_make(key, lambda: Sized(25))
    cache.get_or_make(b"a", lambda: Sized(0))
    cache.get_or_make(b"c", lambda: Sized(60))
    assert cache.get_or_make(b"c", lambda: Sized(1))[1]
    assert not cache.get_or_make(b"b", lambda: Sized(1))[1]


def test_bytes_stay_within_the_budget_but_the_newest_is_kept() -> None:
    cache: FactorCache[Sized] = FactorCache(100)
    for number in range(20):
        cache.get_or_make(bytes([number]), lambda: Sized(30))
        assert cache.nbytes <= 100
    cache.get_or_make(b"large", lambda: Sized(500))
    assert (len(cache), cache.nbytes) == (1, 500)
    assert cache.get_or_make(b"large", lambda: Sized(1))[1]
    cache.clear()
    assert len(cache) == 0


def test_a_motion_fills_an_empty_cache_and_is_bitwise_the_same_with_it() -> None:
    axis = np.linspace(0, 1, 5)
    points = np.stack(np.meshgrid(axis, axis, indexing="ij"), axis=-1).reshape(-1, 2)
    corner = np.arange(20).reshape(4, 5)[:, :4].ravel()
    quads = corner[:, None] + np.array([0, 5, 6, 1])
    left, right = np.flatnonzero(points[:, 0] == 0), np.flatnonzero(points[:, 0] == 1)
    sides = np.flatnonzero((points[:, 1] == 0) | (points[:, 1] == 1))
    patches = {"left": Patch("moving", left), "rest": Patch("fixed", np.union1d(right, np.setdiff1d(sides, left)))}
    model = MotionModel.build(points, CellTable.from_arrays({"quad": quads}), patches, Method(correction="none"))
    cache: FactorCache[Factorization] = FactorCache(1 << 20)
    targets = points[left] + (0.02, 0.0)
    first, second = (model.move(points, targets, cache) for _ in range(2))
    assert (first.caches, second.caches) == ({"factorization": "made"}, {"factorization": "reused"})
    assert (first.points == second.points).all()
