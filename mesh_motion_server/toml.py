"""Reads TOML from unknown sources: very long text, and text that needs very deep calls, gives an ordinary error."""

import re
import tomllib
from typing import Any

#: A dotted key with more parts than this is refused: the time to read it grows with the square of its parts.
_MOST_PARTS = 100
#: Possessive, and matched only at the start of a part, so that the time of the search grows linearly with the text.
_PART = r"""(?:[\w-]++|"[^"\n]*+"|'[^'\n]*+')[ \t]*+"""
_LONG_KEY = re.compile(rf"(?<![\w-])(?:{_PART}\.[ \t]*+){{{_MOST_PARTS}}}")
#: Finds the place where a text is nested too deep: this many brackets without a closing one.
_DEEP = re.compile(rf"(?:[\[{{][^\[\]{{}}]*+){{{_MOST_PARTS}}}")
_LONG_INTEGER = "an integer of more than 64 bits"


def read_toml(text: str) -> dict[str, Any]:
    """Return the tables of a text.

    Raises tomllib.TOMLDecodeError if it is no TOML, nested too deep to be read, or has an integer of more than 64 bits.
    """
    if long := _LONG_KEY.search(text):
        raise tomllib.TOMLDecodeError(f"a key of more than {_MOST_PARTS} dotted parts{_place(long)}")
    try:
        found = tomllib.loads(text)
    except RecursionError as error:
        raise tomllib.TOMLDecodeError(f"values nested too deep to be read{_place(_DEEP.search(text))}") from error
    except tomllib.TOMLDecodeError:
        raise
    except ValueError as error:  # Python does not read decimal numbers with this many digits
        raise tomllib.TOMLDecodeError(_LONG_INTEGER) from error
    if _has_long_integer(found):
        raise tomllib.TOMLDecodeError(_LONG_INTEGER)
    return found


def _place(found: re.Match[str] | None) -> str:
    line = found.string.count("\n", 0, found.start()) + 1 if found else 0
    return f" (at line {line})" if line else ""


def _has_long_integer(value: Any) -> bool:
    """Whether an integer exceeds TOML's range: such integers fit into no number, and some into no message."""
    left = [value]
    while left:
        value = left.pop()
        if isinstance(value, dict):
            left += value.values()
        elif isinstance(value, list):
            left += value
        elif isinstance(value, int) and not -(2**63) <= value < 2**63:
            return True
    return False
