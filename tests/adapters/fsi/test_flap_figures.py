"""The proof's period, amplitude and verdict, on known histories."""

import importlib
import sys
from pathlib import Path

import numpy as np
import pytest
from mesh_motion_fsi import Row

EXAMPLE = Path(__file__).resolve().parents[3] / "examples" / "perpendicular_flap"


@pytest.fixture
def proof(monkeypatch):
    monkeypatch.syspath_prepend(str(EXAMPLE))
    yield importlib.import_module("proof")
    for name in ("proof", "flap"):
        sys.modules.pop(name, None)


def history(proof, *, period=1.625, swing=0.0989, error=""):
    """An oscillation that begins at rest and dies slowly, with a second mode, as the flap's."""
    t = np.arange(1, 501) * 0.01
    x = swing * (1.0 - np.exp(-0.02 * t) * np.cos(2.0 * np.pi * t / period)) + 0.001 * np.sin(2.0 * np.pi * t / 0.26)
    rows = [
        Row(i + 1, float(a), float(b), 0.0, 0.0, 0.0, 2, 1e-4, 0.5) for i, (a, b) in enumerate(zip(t, x, strict=True))
    ]
    return proof.Outcome(proof.CASES[0], rows, error, 1.0)


def test_period_and_amplitude_of_a_known_oscillation(proof):
    t, x = history(proof, period=1.55).history
    assert proof.period(t, x) == pytest.approx(1.55, rel=1e-3)
    assert proof.amplitude(t, x) == pytest.approx(0.0989, rel=0.03)


@pytest.mark.parametrize(
    ("change", "good"),
    [
        ({}, True),
        ({"period": 1.625 * 1.06}, False),
        ({"swing": 0.0989 * 0.85}, False),
        ({"error": "the fluid ended"}, False),
    ],
)
def test_the_verdict(proof, change, good):
    lines, passed = proof.judge(history(proof, **change))
    assert passed is good
    assert len(lines) == 2


def test_a_run_without_windows_is_no_pass(proof):
    outcome = proof.Outcome(proof.CASES[0], [], "the fluid did not start", 0.0)
    assert not proof.judge(outcome)[1]
    assert "0 of 500 windows" in proof.line(outcome)


def test_the_picture(proof, tmp_path):
    proof.draw([history(proof)], tmp_path / "tip.png")
    assert (tmp_path / "tip.png").stat().st_size > 10_000
