"""Tables from the benchmarks' page and the README, for other pages."""

from __future__ import annotations

import re
from pathlib import Path

__all__ = ["benchmark"]

ROOT = Path(__file__).resolve().parents[3]
_BLOCK = r"<!-- benchmark: {} -->\n(.*?)<!-- end -->"


def benchmark(name: str) -> str:
    """The block of a benchmark up to the end of its first table.

    Raises
    ------
    KeyError
        If no page has a block of this name.
    """
    for page in ("README.md", "benchmarks/README.md"):
        text = (ROOT / page).read_text(encoding="utf-8")
        if found := re.search(_BLOCK.format(re.escape(name)), text, re.DOTALL):
            rows = re.search(r"^\|.*?(?=\n\n|\Z)", found[1], re.MULTILINE | re.DOTALL)
            return f"{rows[0].strip()}\n" if rows else ""
    raise KeyError(name)
