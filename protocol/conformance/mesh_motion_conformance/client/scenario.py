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
    """One scenario; the head of ``scenarios.toml`` explains its parts."""

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
    """The scenarios of the file, then one for each error code and each malformed value of a reply."""
    for entry in tomllib.loads(SCENARIOS.read_text(encoding="utf-8"))["scenario"]:
        yield _scenario(entry)
    yield from (_scenario(entry) for entry in (*_codes(), *_wrong_types(), *_wrong_headers()))


def _codes() -> Iterator[dict[str, Any]]:
    """Each error code as the answer to a MOVE; the driver must report it unchanged.

    Codes that a client may handle itself, by a retry or by RESUME, have separate scenarios.
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


#: By the kind of a field: a value of another type.
_OTHER_TYPE = {"int": "1", "float": "0.5", "bool": 1, "str": 7, "bin": "text", "array": {}, "map": [1]}
_ENTRY = {"name": "displacement", "dtype": "<f8", "shape": [4, 2]}
_NONE = {"name": "enrichment_points", "dtype": "<f8", "shape": [0, 2]}
#: Frame 0 of a MOVED with one thing wrong, as :data:`mesh_motion_protocol.vectors` has it for requests.
_WRONG_HEADERS: dict[str, dict[str, Any]] = {
    "version-true": {"v": True},
    "type-number": {"type": 7},
    "fields-array": {"fields": []},
    "arrays-map": {"arrays": {}},
    "big-endian": {"arrays": [_ENTRY | {"dtype": ">f8"}, _NONE]},
    "dtype-of-another-kind": {"arrays": [_ENTRY | {"dtype": "<i8"}, _NONE]},
    "dtype-number": {"arrays": [_ENTRY | {"dtype": 8}, _NONE]},
    "shape-text": {"arrays": [_ENTRY | {"shape": "4,2"}, _NONE]},
    "shape-of-one-axis": {"arrays": [_ENTRY | {"shape": [8]}, _NONE]},
    "shape-of-three-axes": {"arrays": [_ENTRY | {"shape": [4, 2, 1]}, _NONE]},
    "shape-negative": {"arrays": [_ENTRY | {"shape": [-4, -2]}, _NONE]},
    "shape-float": {"arrays": [_ENTRY | {"shape": [4.0, 2.0]}, _NONE]},
    "shape-of-another-dimension": {"arrays": [_ENTRY | {"shape": [2, 4]}, _NONE]},
    "array-with-a-fourth-key": {"arrays": [_ENTRY | {"more": 1}, _NONE]},
    "array-without-dtype": {"arrays": [{"name": "displacement", "shape": [4, 2]}, _NONE]},
    "array-missing": {"arrays": [_ENTRY | {"name": "force"}, _NONE]},
    "array-twice": {"arrays": [_ENTRY, _NONE, _NONE]},
}


def _wrong_types() -> Iterator[dict[str, Any]]:
    """Each required field of OPENED, BUILT, MOVED and COMMITTED with a value of another type."""
    for request, reply, verb in (("OPEN", "OPENED", 1), ("BUILD", "BUILT", 1), ("MOVE", "MOVED", 2),
                                 ("COMMIT", "COMMITTED", 3)):  # fmt: skip
        for field in tables().messages[reply]:
            kind = field.kind.split()[0]
            if field.required and kind in _OTHER_TYPE:
                change = {"do": "fields", "set": {field.name: _OTHER_TYPE[kind]}}
                yield _refused_reply("12", f"{reply}-{field.name}-of-another-type", verb, request, change)


def _wrong_headers() -> Iterator[dict[str, Any]]:
    """MOVED with each malformed frame 0."""
    for name, change in _WRONG_HEADERS.items():
        section = "5" if "arrays" in change and name != "arrays-map" else "4"
        yield _refused_reply(section, f"MOVED-{name}", 2, "MOVE", {"do": "header", "set": change})


def _refused_reply(section: str, name: str, verb: int, request: str, change: dict[str, Any]) -> dict[str, Any]:
    """All replies to a verb (0: hello, 1: open, 2: move …) are malformed; the verb must report this and use none."""
    return {
        "section": section,
        "name": name,
        "demand": "A malformed reply is reported, not used",
        "verbs": " ".join(_VERBS.split()[: verb + 1]),
        "timeout": 3,
        "disturb": [{"request": request, "times": 99} | change],
        "expect": {"codes": {str(verb + 1): [""]}},
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
