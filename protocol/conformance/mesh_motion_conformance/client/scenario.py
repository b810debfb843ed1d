"""Scenarios as ``scenarios.toml`` has them."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mesh_motion_conformance.client.scripted_server import Disturbance
from mesh_motion_conformance.tables import tables

__all__ = ["SCENARIOS", "Scenario", "scenarios"]

SCENARIOS = Path(__file__).with_name("scenarios.toml")
_VERBS = "hello open move commit close"


@dataclass(frozen=True)
class Scenario:
    """One scenario; the head of ``scenarios.toml`` says what its parts mean."""

    section: str
    name: str
    demand: str
    verbs: str
    timeout: float
    disturbances: tuple[Disturbance, ...]
    welcome: Mapping[str, Any]
    codes: Mapping[int, list[str]]
    results: Mapping[int, dict[str, Any]]
    executed: Mapping[str, int]
    arrivals: Mapping[str, str]
    same: tuple[str, ...]
    new: tuple[str, ...]
    sent: Mapping[str, dict[str, Any]]


def scenarios() -> Iterator[Scenario]:
    """Those of the file, then one for each error code."""
    for entry in tomllib.loads(SCENARIOS.read_text(encoding="utf-8"))["scenario"]:
        yield _scenario(entry)
    yield from (_scenario(entry) for entry in _codes())


def _codes() -> Iterator[dict[str, Any]]:
    """Each error code in answer to a MOVE, reported as it is.

    What a client may answer itself, by trying again or by resuming, is told by scenarios of its own.
    """
    for code, row in tables().errors.items():
        if not row["retryable"] and code not in ("ABORTED.TRIAL_LOST", "UNAUTHENTICATED"):
            yield {
                "section": "17",
                "name": f"{code}-is-reported",
                "demand": "An ERROR is reported to the caller with its code; nothing is tried again by itself",
                "verbs": "hello open move",
                "timeout": 3,
                "disturb": [{"request": "MOVE", "do": "refuse", "times": 99, "code": code}],
                "expect": {"codes": {"3": [code]}, "arrivals": {"MOVE": "1"}},
            }


def _scenario(entry: dict[str, Any]) -> Scenario:
    expect = entry.get("expect", {})
    return Scenario(
        section=entry["section"],
        name=entry["name"],
        demand=entry["demand"],
        verbs=entry.get("verbs", _VERBS),
        timeout=float(entry.get("timeout", 8)),
        disturbances=tuple(_disturbance(dict(given)) for given in entry.get("disturb", ())),
        welcome=entry.get("welcome", {}),
        codes={int(number): list(codes) for number, codes in expect.get("codes", {}).items()},
        results={int(number): values for number, values in expect.get("results", {}).items()},
        executed=expect.get("executed", {}),
        arrivals={kind: str(count) for kind, count in expect.get("arrivals", {}).items()},
        same=tuple(expect.get("same", ())),
        new=tuple(expect.get("new", ())),
        sent=expect.get("sent", {}),
    )


def _disturbance(given: dict[str, Any]) -> Disturbance:
    request, action = given.pop("request"), given.pop("do")
    return Disturbance(request, action, given.pop("nth", 1), given.pop("times", 1), given)
