"""The cases for clients: a scripted server with all disturbances that a network and a server may cause."""

from __future__ import annotations

from collections.abc import Callable

from mesh_motion_conformance.case import Case
from mesh_motion_conformance.client.scenario import Scenario, scenarios
from mesh_motion_conformance.client.stage import Client, ClientStage

__all__ = ["Client", "ClientStage", "client_cases"]


def client_cases() -> list[Case]:
    """All cases for clients, one scenario each."""
    return [Case(scenario.section, scenario.name, scenario.demand, _play(scenario)) for scenario in scenarios()]


def _play(scenario: Scenario) -> Callable[[ClientStage], None]:
    def run(stage: ClientStage) -> None:
        stage.play(scenario)

    return run
