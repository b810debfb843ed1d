"""Section 14: the keys of OPEN's settings."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from mesh_motion_conformance.case import Rows, require
from mesh_motion_conformance.checks import refused
from mesh_motion_conformance.server.requests import Request
from mesh_motion_conformance.server.stage import Stage, suite
from mesh_motion_conformance.show import show
from mesh_motion_conformance.tables import tables

__all__ = ["refused_settings"]


#: Name, demand, and the arguments of :func:`refused_settings`.
Wrong = Iterator[tuple[Any, ...]]


def refused_settings(stage: Stage, key: str, settings: dict[str, Any], **fields: Any) -> None:
    """An OPEN with these settings is refused, and the refusal names the key."""
    request = Request("OPEN", {"dimension": 2, "settings": settings, **fields})
    reply = refused(stage.ask(request), "INVALID_ARGUMENT.SETTINGS", state="")
    require(key in str(reply.fields["details"]) + reply.fields["message"], f"an ERROR that names {key}", show(reply))


@suite.family(refused_settings, "14")
def wrong_types() -> Wrong:
    """A wrong type is refused."""
    values = {"str": "0.5", "bin": b"x", "int": 1, "float": 0.5, "bool": True, "nil": None, "array": [0.5], "map": {}}
    for key, row in tables().settings.items():
        admitted = {row["kind"]} | ({"int"} if row["kind"] == "float" else set()) | ({"nil"} if row["nil"] else set())
        for name in ("int", "str", "bool", "nil", "array" if row["kind"] == "str" else "map"):
            if name not in admitted:
                yield f"{key}-is-{name}", f"{key} is {row['kind']}", key, {key: values[name]}


@suite.family(refused_settings, "14")
def wrong_values() -> Wrong:
    """A value outside its choices or range is refused."""
    for key, row in tables().settings.items():
        if "choices" in row:
            yield f"{key}-no-choice", f"{key} is one of its choices", key, {key: "no-such-choice"}
        if "low" in row:
            step = 1 if row["kind"] == "int" else 0.001
            yield f"{key}-below", f"{key} is {row['low']} … {row['high']}", key, {key: row["low"] - step}
            yield f"{key}-above", f"{key} is {row['low']} … {row['high']}", key, {key: row["high"] + step}
        if "above" in row:
            for value in (0, -0.5):
                yield f"{key}-is-{value}".replace("-0.5", "negative"), f"{key} > 0", key, {key: value}


@suite.family(refused_settings, "14")
def unknown_keys() -> Wrong:
    """An unknown key is refused."""
    for key in ("no_such_setting", "Basis", "support radius", "method"):
        yield f"unknown-{key}".replace(" ", "_"), "An unknown key is refused", key, {key: 1}


def _in_force(stage: Stage) -> dict[str, Any]:
    """BUILT's settings of a session that was opened with three numbers, each encoded differently."""
    settings = {"support_radius": 1, "enrichment_radius": 0.5, "quality_threshold": 0.25, "displacement": None}
    session = stage.kept("settings", lambda: stage.open(settings=settings))
    if session.built is None:
        session.build()
    return session.built.fields["settings"] if session.built else {}


def _has(stage: Stage, key: str, wanted: Any) -> None:
    found = _in_force(stage)
    require(key in found, f"{key} in BUILT's settings", str(sorted(found)))
    require(wanted is None or found[key] == wanted, f"{key} = {wanted!r}", repr(found[key]))


def _effective() -> Rows:
    given = {"support_radius": 1.0, "enrichment_radius": 0.5, "quality_threshold": 0.25}
    return {f"{key}-in-BUILT": (key, given.get(key, row["default"])) for key, row in tables().settings.items()}


@suite("14", _effective)
def in_force(stage: Stage, key: str, wanted: Any) -> None:
    """BUILT's settings are those in force, defaults filled in."""
    _has(stage, key, wanted)


@suite("4.5")
def integer_for_a_float(stage: Stage) -> None:
    """An integer is admitted as the value of a float."""
    _has(stage, "support_radius", 1.0)


@suite("4.5")
def float_of_64_bits(stage: Stage) -> None:
    """Floats are of 32 or 64 bits."""
    _has(stage, "quality_threshold", 0.25)


@suite("4.7")
def nil_inside_a_map(stage: Stage) -> None:
    """nil is admitted inside fields of type map."""
    _has(stage, "displacement", None)
