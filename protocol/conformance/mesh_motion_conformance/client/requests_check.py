"""Check that a client's message is a request by sections 4, 5 and 12 of SPEC.md."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from mesh_motion_conformance.tables import Field, tables
from mesh_motion_conformance.wire import KINDS, Message

__all__ = ["offences"]


def offences(request: Message) -> list[str]:
    """List all faults of a request."""
    if request.kind not in tables().requests:
        return [f"{request.kind} is not a request"]
    found = list(_fields(request)) + list(_arrays(request))
    if request.sequence < 1:
        found.append("sequence must be 1 or more")
    return found


def _fields(request: Message) -> Iterator[str]:
    specs = {field.name: field for field in tables().fields(request.kind)}
    for name in request.fields:
        if name not in specs:
            yield f"{request.kind} has no field {name!r}"
    for name, field in specs.items():
        if name in request.fields:
            yield from _value(f"{request.kind}.{name}", request.fields[name], field)
        elif field.required:
            yield f"{request.kind} must have the field {name}"


def _value(where: str, value: Any, field: Field) -> Iterator[str]:
    says = field.says
    if type(value) not in KINDS[field.kind]:
        yield f"{where} must be {field.kind}, got {value!r:.60}"
        return
    if not _finite(value):
        yield f"{where} must be finite"
    if "choices" in says and value not in says["choices"]:
        yield f"{where} must be one of {says['choices']}, got {value!r:.60}"
    if "low" in says and not says["low"] <= value <= says["high"]:
        yield f"{where} must be {says['low']} … {says['high']}, got {value}"
    size = len(value.encode() if isinstance(value, str) else value) if isinstance(value, (str, bytes)) else 0
    if "exactly" in says and size != says["exactly"]:
        yield f"{where} must have {says['exactly']} bytes, got {size}"
    if "at_most" in says and size > says["at_most"]:
        yield f"{where} must have at most {says['at_most']} bytes, got {size}"


def _finite(value: Any) -> bool:
    if isinstance(value, dict):
        return all(_finite(item) for item in value.values())
    if isinstance(value, list):
        return all(_finite(item) for item in value)
    return not isinstance(value, float) or math.isfinite(value)


def _arrays(request: Message) -> Iterator[str]:
    specs = {field.name: field for field in tables().arrays(request.kind)}
    for name, array in request.arrays.items():
        if name not in specs:
            yield f"{request.kind} has no array {name!r}"
            continue
        axes, dtypes = specs[name].says["axes"], specs[name].says["dtypes"]
        if array.ndim != len(axes) or f"<{array.dtype.kind}8" not in dtypes:
            yield f"{request.kind}.{name} must have the axes {axes} and a dtype of {dtypes}"
        elif array.dtype.kind == "f" and not np.isfinite(array).all():
            yield f"{request.kind}.{name} must be finite"
    for name, field in specs.items():
        if field.required and name not in request.arrays:
            yield f"{request.kind} must have the array {name}"
