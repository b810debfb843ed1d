"""Tests of the suite: each wrong server and each wrong client is detected by the cases that must detect it."""

from contextlib import closing

import pytest
from in_process import ListeningServer
from mesh_motion_client.conformance import play
from mesh_motion_conformance.case import Case, require
from mesh_motion_conformance.checks import answered, refused
from mesh_motion_conformance.command import Subject, conform
from mesh_motion_conformance.runner import run
from mesh_motion_conformance.server.stage import Stage
from seeded_faults import FAULTS
from wrong_clients import WRONG_CLIENTS

from mesh_motion_server.transport.telemetry import configure

#: Cases that these servers cannot pass: their plain model checks no mesh and judges no cells.
WITHOUT_JUDGEMENT = [
    "13.2-what-a-mesh-needs",
    *("13.3-inverted-cell", "15-BUILT-quality", "15-COMMITTED-quality", "15-MOVED-headroom-asked", "15-MOVED-quality"),
]


@pytest.fixture(autouse=True)
def quiet():
    configure("conformance", "critical")


def failing(endpoint, only=(), seconds=3.0):
    subject = Subject(endpoint=endpoint, seconds=seconds, opening_seconds=seconds)
    outcomes = conform(subject, lambda line: None, only=only)
    assert {outcome.case.id for outcome in outcomes} >= set(only)
    return [outcome.case.id for outcome in outcomes if outcome.verdict == "FAIL"]


@pytest.mark.timeout(600)
def test_a_server_without_fault_fails_no_case(tmp_path):
    """Gateway, control, worker and sessions run in one process: the whole suite computes for three seconds."""
    failed = []
    for folder in (tmp_path / "once", tmp_path / "again"):  # a machine that stands still fails a case once
        with closing(ListeningServer(folder)) as server:
            # a short time-out detects a wrong, silent server; a correct one may be as slow as the machine
            failed = failing(server.endpoint, failed, seconds=30.0)
    assert sorted(failed) == WITHOUT_JUDGEMENT


@pytest.mark.parametrize("wrong", [False, True])
def test_sessions_of_a_case_end_with_it_and_shared_ones_do_not(wrong, tmp_path):
    sessions = []

    def opens(stage):
        sessions[:] = [stage.session("READY"), stage.open().reach("READY")]
        require(not wrong, "nothing", "something")

    with closing(ListeningServer(tmp_path)) as server:
        stage = Stage(server.endpoint, seconds=30.0)
        (outcome,) = run([Case("1", "opens", "a demand", opens)], stage)
        assert outcome.verdict == ("FAIL" if wrong else "PASS")
        shared, own = (stage.ask(session.request("RESUME")) for session in sessions)
        answered(shared, "RESUMED")
        refused(own, "NOT_FOUND")
        stage.close()


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.name)
def test_a_wrong_server_is_caught(fault, tmp_path, monkeypatch):
    fault.seed(monkeypatch)
    with closing(ListeningServer(tmp_path)) as server:
        assert sorted(failing(server.endpoint, fault.caught)) == sorted(fault.caught)


@pytest.mark.parametrize("fault", WRONG_CLIENTS, ids=lambda fault: fault.name)
def test_a_wrong_client_is_caught(fault, monkeypatch):
    fault.seed(monkeypatch)
    outcomes = conform(Subject(client=play), lambda line: None, only=fault.caught)
    assert [outcome.verdict for outcome in outcomes] == ["FAIL"] * len(fault.caught)
