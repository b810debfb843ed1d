"""Words and numbers as a terminal may show them."""

from __future__ import annotations

import math
import unicodedata

__all__ = ["age", "clip", "number", "plain"]

_REPLACEMENT = "�"
#: Marks over one letter beyond which more are dropped: towers of them reach into other lines.
_MOST_MARKS = 2


def plain(text: object) -> str:
    """The text on one line without anything that a terminal obeys: control and format characters become ``�``.

    Labels come from whoever opened a session; an escape sequence among them could rewrite the screen, and a mark of
    direction could make a line read otherwise than it is.
    """
    letters: list[str] = []
    marks = 0
    for letter in str(text):
        if unicodedata.combining(letter) or unicodedata.category(letter) in ("Mn", "Me"):
            marks += 1
            if marks > _MOST_MARKS:
                continue
        else:
            marks = 0
        letters.append(letter if letter.isprintable() else " " if letter in "\t\r\n" else _REPLACEMENT)
    return "".join(letters)


def clip(text: str, width: int) -> str:
    """At most ``width`` columns of the text, with an ellipsis where it was longer."""
    from rich.cells import cell_len, set_cell_size  # noqa: PLC0415

    if cell_len(text) <= width:
        return text
    return set_cell_size(text, max(width - 1, 0)).rstrip() + "…" if width > 0 else ""


def number(value: float | None, digits: int = 3) -> str:
    """A quality, or ``–`` where it is not known."""
    return "–" if value is None or math.isnan(value) else f"{value:.{digits}f}"


def age(value: float, *, short: bool = False) -> str:
    """How long ago something was, in one or two units; short: in one."""
    whole = max(int(value), 0)
    for unit, size, smaller, part in (("d", 86400, "h", 3600), ("h", 3600, "min", 60), ("min", 60, "s", 1)):
        if whole >= size:
            rest = 0 if short or whole >= 10 * size else whole % size // part
            return f"{whole // size} {unit}" + (f" {rest} {smaller}" if rest else "")
    return f"{whole} s"
