"""Text and numbers that are safe to show on a terminal."""

import math
import unicodedata

#: Maximum number of combining marks on one letter; more are dropped, because they would overlap other lines.
_MOST_MARKS = 2


def plain(text: object) -> str:
    """The text on one line, with ``�`` for every control and format character.

    Labels come from the client that opened a session: an escape sequence could rewrite the screen, and a direction mark
    could change the order in which a line is read.
    """
    letters: list[str] = []
    marks = 0
    for letter in str(text):
        marks = marks + 1 if unicodedata.category(letter) in ("Mn", "Me") or unicodedata.combining(letter) else 0
        if marks <= _MOST_MARKS:
            letters.append(letter if _is_shown(letter) else " " if letter in "\t\r\n" else "�")
    return "".join(letters)


def _is_shown(letter: str) -> bool:
    """Whether a character is shown. Python counts all spaces but one as not printable: U+202F in ``12 000``, U+00A0."""
    return letter.isprintable() or unicodedata.category(letter) == "Zs"


def number(value: float | None) -> str:
    """A quality, or ``–`` if unknown."""
    return "–" if value is None or math.isnan(value) else f"{value:.3f}"
