"""SPEC.md's tables in the form that the cases use."""

from __future__ import annotations

import functools
import json
from dataclasses import dataclass
from typing import Any

from mesh_motion_conformance.spec_tables import TABLES

__all__ = ["Field", "Tables", "tables"]


@dataclass(frozen=True)
class Field:
    """A field of a message, from its row in section 12."""

    name: str
    kind: str  # str, bin, int, float, bool, array, map, any or frames
    required: bool
    #: Further contents of the row: ``choices``, ``low``, ``high``, ``exactly``, ``at_most``, ``item``, ``dtypes``,
    #: ``axes``, ``default``.
    says: dict[str, Any]


@dataclass(frozen=True)
class Tables:
    """The tables of SPEC.md."""

    requests: dict[str, dict[str, Any]]  # request → ``endpoint`` (control, data, both), ``collective``, ``reply``
    messages: dict[str, list[Field]]  # message → its fields
    states: dict[str, dict[str, str | None]]  # state → operation → the state afterwards, None if it is refused
    #: limits, settings, errors: by name, key, code
    limits: dict[str, dict[str, Any]]
    settings: dict[str, dict[str, Any]]
    errors: dict[str, dict[str, Any]]

    @property
    def control(self) -> list[str]:
        """Requests that the control endpoint takes."""
        return [name for name, row in self.requests.items() if row["endpoint"] in ("control", "both")]

    @property
    def data(self) -> list[str]:
        """Requests that a data endpoint takes."""
        return [name for name, row in self.requests.items() if row["endpoint"] in ("data", "both")]

    def fields(self, message: str) -> list[Field]:
        """The fields that are not arrays."""
        return [field for field in self.messages[message] if field.kind != "frames"]

    def arrays(self, message: str) -> list[Field]:
        """The fields that are arrays."""
        return [field for field in self.messages[message] if field.kind == "frames"]


@functools.cache
def tables() -> Tables:
    """The tables of the document that this suite was made from."""
    raw = json.loads(TABLES.read_text(encoding="utf-8"))
    known = ("name", "kind", "required")
    raw["messages"] = {
        message: [
            Field(f["name"], f["kind"], f["required"], {key: f[key] for key in f if key not in known}) for f in fields
        ]
        for message, fields in raw["messages"].items()
    }
    return Tables(**raw)
