"""Reads TOML of which nothing is known: what would take very long, or very deep calls, is an error like any other."""

import re
import tomllib
from typing import Any

__all__ = ["read_toml"]

#: A dotted key with more parts than this is refused: the time to read one grows with the square of its parts.
_MOST_PARTS = 100
#: Possessive, and only where a part begins, so that the search itself takes a time that grows with the text alone.
_PART = r"""(?:[\w-]++|"[^"\n]*+"|'[^'\n]*+')[ \t]*+"""
_LONG_KEY = re.compile(rf"(?<![\w-])(?:{_PART}\.[ \t]*+){{{_MOST_PARTS}}}")


def read_toml(text: str) -> dict[str, Any]:
    """The tables of a text.

    Raises
    ------
    tomllib.TOMLDecodeError
        If it is no TOML, or nested too deep to be read.
    """
    long = _LONG_KEY.search(text)
    if long is not None:
        line = text.count("\n", 0, long.start()) + 1
        raise tomllib.TOMLDecodeError(f"a key of more than {_MOST_PARTS} dotted parts (at line {line})")
    try:
        return tomllib.loads(text)
    except RecursionError as error:
        raise tomllib.TOMLDecodeError(str(error)) from None
