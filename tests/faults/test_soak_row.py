"""The soak row: some steps, and detection of servers that keep memory, descriptors or replies."""

from collections.abc import Callable
from dataclasses import replace
from random import Random

import numpy as np
import pytest

from tests.faults.check import BrokenPromise
from tests.faults.soak import Reading, allowed_slope, judge, soaking
from tests.faults.soak_client import Soaker

Seed = Callable[..., None]
_MIB = 1 << 20


@pytest.mark.nightly
def test_memory_and_descriptors_that_are_kept_are_found(seed: Seed, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SEEDED_BYTES", "20000")  # of 400 steps; what 100 bytes are of some thousands
    seed("a list that grows with each commit", "a descriptor kept for each join")
    with soaking(1) as soak:
        while len(soak.stored) < 16:
            soak.go(25)
    with pytest.raises(BrokenPromise, match=r"worker [12] grows by \d+\.\d+ MB in 100 000 steps"):
        judge(soak.readings, soak.stored)
    calm = {name: [replace(each, resident_bytes=_MIB) for each in all_] for name, all_ in soak.readings.items()}
    with pytest.raises(BrokenPromise, match=r"worker [12] has \d+ files or more at the end"):
        judge(calm, soak.stored)


@pytest.mark.nightly
def test_replies_that_are_never_dropped_are_found(seed: Seed) -> None:
    seed("replies that are never dropped")
    with soaking(1) as soak:
        while len(soak.stored) < 12:
            soak.go(25)
    with pytest.raises(BrokenPromise, match=r"worker [12] grows by \d+\.\d+ MB in 100 000 steps"):
        judge(soak.readings, soak.stored)


class Still:
    """A session of four moving nodes that sums the positions of its boundary."""

    def __init__(self) -> None:
        self.moving_nodes, self.step = range(4), 0
        self.boundary, self._trial = np.zeros((4, 2)), np.zeros((4, 2))

    def move(self, rows: np.ndarray, frame: str) -> None:
        assert frame == "committed"
        self._trial = rows

    def rollback(self) -> None:
        self._trial = np.full((4, 2), np.nan)

    def commit(self) -> None:
        self.boundary, self.step = self.boundary + self._trial, self.step + 1


def test_a_boundary_stays_where_it_is_however_long_the_soak() -> None:
    """The boundary drifted away, by a random step in each second iteration, until the motion was refused after 10⁵
    steps.
    """
    soaker, still = object.__new__(Soaker), Still()
    soaker.random, soaker._client = Random(1), still  # type: ignore[assignment]
    for _ in range(2000):
        soaker._client_step()
        if still.step % 2 == 0:
            assert np.abs(still.boundary).max() < 1e-12


@pytest.mark.nightly
def test_a_client_that_fails_says_why() -> None:
    with soaking(1) as soak, pytest.raises(BrokenPromise, match=r"(?s)ended by itself, after \d+ steps.*TypeError"):
        soak.go("some")  # type: ignore[arg-type]


def readings(slope_bytes: float, *, steps: int = 100_000, files: float = 0.0) -> list[Reading]:
    noise = np.random.default_rng(1).integers(0, 16, 60) * 4096
    at = np.linspace(0, steps, 60).astype(int)
    jump = np.where(at > 0.95 * steps, 3 * _MIB, 0)  # a pool, once
    return [
        Reading(int(s), int(_MIB + slope_bytes * s + n + j), 20 + int(files * s), 3)
        for s, n, j in zip(at, noise, jump, strict=True)
    ]


def test_slopes_are_robust_and_bounded() -> None:
    assert allowed_slope(50_000, 100_000) == allowed_slope(500_000, 1_000_000) == 10.0
    assert allowed_slope(20_000, 40_000) == 40.0  # tables are still filled
    assert allowed_slope(2000, 4000) == pytest.approx(65.5, abs=0.1)
    assert judge({"worker": readings(8.0)}, [0, 0])["worker"] == pytest.approx(8.0, abs=4.0)
    with pytest.raises(BrokenPromise, match="worker grows by"):
        judge({"worker": readings(100.0)}, [0, 0])
    with pytest.raises(BrokenPromise, match=r"worker has \d+ files or more"):
        judge({"worker": readings(0.0, files=1e-4)}, [0, 0])
    with pytest.raises(BrokenPromise, match="the state folder grows by"):
        judge({"worker": readings(0.0)}, [0, 100 * _MIB])
