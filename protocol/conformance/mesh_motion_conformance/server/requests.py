"""Requests before they are sent: correct by default, wrong in one place if a case needs it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mesh_motion_conformance.wire import declaration, frames_of, pack

__all__ = ["Header", "Request"]

Header = dict[str, Any]


@dataclass(frozen=True)
class Request:
    """A request without its id; ``kind`` is ``type`` in the header."""

    kind: str
    fields: dict[str, Any] = field(default_factory=dict)
    arrays: dict[str, NDArray[Any]] = field(default_factory=dict)

    def having(self, **fields: Any) -> Request:
        """The same with other fields."""
        return replace(self, fields=self.fields | fields)

    def without(self, *names: str) -> Request:
        """The same without these fields."""
        return replace(self, fields={name: value for name, value in self.fields.items() if name not in names})

    def carrying(self, **arrays: Any) -> Request:
        """The same with other arrays."""
        return replace(self, arrays=self.arrays | {name: np.asarray(array) for name, array in arrays.items()})

    def header(self, client: bytes, sequence: int) -> Header:
        """The content of frame 0, before it is packed."""
        return {
            "v": 1,
            "type": self.kind,
            "client": client,
            "sequence": sequence,
            "fields": dict(self.fields),
            "arrays": [declaration(name, array) for name, array in self.arrays.items()],
        }

    def body(self) -> list[bytes]:
        """The frames after frame 0."""
        return [frame for array in self.arrays.values() for frame in frames_of(array)]

    def frames(self, client: bytes, sequence: int, change: Callable[[Header], Any] | None = None) -> list[bytes]:
        """All frames; ``change`` may alter the header in place, or return a replacement of frame 0."""
        header = self.header(client, sequence)
        changed = change(header) if change is not None else None
        first = changed if isinstance(changed, bytes) else pack(header if changed is None else changed)
        return [first, *self.body()]
