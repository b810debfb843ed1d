"""The row of conformance: its choice of cases and programs, and its report about wrong servers and clients."""

from random import Random

import pytest
from mesh_motion_conformance.case import Case, Outcome
from mesh_motion_conformance.client import client_cases
from mesh_motion_conformance.server import server_cases

from tests.faults import conformance
from tests.faults.conformance import CLIENTS_VARIABLE, choice, clients, verdict


@pytest.mark.parametrize("cases", [server_cases(), client_cases()], ids=["server", "client"])
def test_a_choice_has_every_section_in_the_documents_order(cases: list[Case]) -> None:
    sections = {case.section for case in cases}
    for count in (0, 100, len(cases)):
        chosen = choice(cases, count, Random(1))
        assert {case.section for case in chosen} == sections
        assert len(chosen) == min(max(count, len(sections)), len(cases))
        assert chosen == [case for case in cases if case in chosen]
    assert choice(cases, 30, Random(1)) == choice(cases, 30, Random(1)) != choice(cases, 30, Random(2))


def test_a_failure_and_a_case_that_was_left_out_are_reported() -> None:
    outcomes = [
        Outcome(Case("2", "good", "a demand", lambda stage: None), "PASS", 0.1),
        Outcome(Case("3", "bad", "a demand", lambda stage: None), "FAIL", 0.1, "PONG", "ERROR", "PING"),
        Outcome(Case("8", "FROZEN", "a demand", lambda stage: None), "SKIP", 0.0),
        Outcome(Case("9", "odd", "a demand", lambda stage: None), "SKIP", 0.0, got="no server is there"),
    ]
    counted = verdict("server", outcomes)
    assert (counted["cases"], counted["passed"], counted["skipped"]) == (4, 1, ["8-FROZEN", "9-odd"])
    assert [case["id"] for case in counted["failed"]] == ["3-bad", "9-odd"]
    result = conformance._result({"server": counted, "Python": verdict("Python", outcomes[:1])})
    assert not result.passed
    assert result.got == "2 of 5 failed: server 3-bad, server 9-odd"
    assert conformance._result({"Python": verdict("Python", outcomes[:1])}).got.endswith("C, C++, Fortran not built")


def test_clients_are_command_lines(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "")
    assert list(clients()) == ["Python"]
    monkeypatch.setenv(CLIENTS_VARIABLE, "C=build/driver --fast;Rust = r")
    assert clients() | {"C": "build/driver --fast", "Rust": "r"} == clients()
