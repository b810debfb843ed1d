"""Our client meets every requirement of SPEC.md that a scripted server can test."""

import shlex
import sys

import pytest
from mesh_motion_conformance.command import Subject, conform

DRIVER = shlex.join([sys.executable, "-m", "mesh_motion_client.conformance"])


@pytest.mark.nightly
@pytest.mark.timeout(900)
def test_every_scenario():
    lines = []
    outcomes = conform(Subject(client=DRIVER), lines.append, quiet=True)
    assert [outcome.case.id for outcome in outcomes if outcome.verdict != "PASS"] == [], "\n".join(lines)
