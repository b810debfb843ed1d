"""Golden vectors: frames as hex, with the message that they contain or the error code that they must raise.

``valid.json`` and ``invalid.json`` are lists of cases for any language; :mod:`.generate` writes them again.
"""

from __future__ import annotations

import json
from importlib import resources
from typing import Any

__all__ = ["load"]


def load(name: str) -> list[dict[str, Any]]:
    """Return the cases of ``"valid"`` or ``"invalid"``."""
    text = resources.files(__name__).joinpath(f"{name}.json").read_text(encoding="utf-8")
    cases: list[dict[str, Any]] = json.loads(text)
    return cases
