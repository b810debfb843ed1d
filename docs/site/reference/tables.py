"""Tables in Markdown, and the comments of declarations."""

from __future__ import annotations

import inspect
import re
from collections.abc import Sequence

__all__ = ["code", "comments_behind", "table"]

_FIELD = re.compile(r"^    (?P<name>[a-z_]+): .*?(?:  # (?P<comment>.+))?$")


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table; bars in cells are escaped."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |" for line in lines) + "\n"


def code(text: object) -> str:
    """A literal in running text; empty for an empty text."""
    return f"`{text}`" if str(text) else ""


def comments_behind(cls: type) -> dict[str, str]:
    """Field → the comment after its declaration, "" without a comment."""
    found = (_FIELD.match(line) for line in inspect.getsource(cls).splitlines())
    return {match["name"]: match["comment"] or "" for match in found if match}
