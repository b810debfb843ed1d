"""Blocks of a page that a run fills: ``<!-- benchmark: NAME -->`` up to ``<!-- end -->``."""

from __future__ import annotations

import re
from pathlib import Path

__all__ = ["README", "fill_block", "seconds_shown"]

README = Path(__file__).parent / "README.md"


def fill_block(name: str, text: str, page: Path = README) -> None:
    """Put the text between ``<!-- benchmark: NAME -->`` and the next ``<!-- end -->``.

    Raises
    ------
    ValueError
        If the page has no such lines.
    """
    before = page.read_text(encoding="utf-8")
    block = re.compile(rf"(<!-- benchmark: {re.escape(name)} -->\n).*?(<!-- end -->)", re.DOTALL)
    if not block.search(before):
        raise ValueError(f"{page.name}: expected a line '<!-- benchmark: {name} -->' and then '<!-- end -->'")
    page.write_text(block.sub(lambda m: m[1] + text + m[2], before), encoding="utf-8")


def seconds_shown(value: float) -> str:
    """Two significant digits without an exponent."""
    return f"{value:.0f}" if value >= 10 else f"{value:.2g}"
