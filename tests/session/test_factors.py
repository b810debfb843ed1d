"""The factor cache: reuse, its byte budget, and what it counts."""

from __future__ import annotations

from dataclasses import dataclass

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
