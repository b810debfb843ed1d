"""Our client meets every requirement of SPEC.md that a scripted server can test."""

from concurrent.futures import ThreadPoolExecutor

from mesh_motion_client.conformance import play
from mesh_motion_conformance.client import ClientStage, client_cases
from mesh_motion_conformance.runner import run


def test_every_scenario():
    with ThreadPoolExecutor(4) as pool:  # they wait most of the time
        played = pool.map(lambda case: run([case], ClientStage(play)), client_cases())
        failed = [(outcome.case.id, outcome.got) for (outcome,) in played if outcome.verdict != "PASS"]
    assert failed == []
