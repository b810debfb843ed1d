"""The text of files of other programs."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray


def text_of(data: bytes) -> str:
    """UTF-8; lines that are not are in the Western alphabet of Windows: two names never become one."""
    try:
        return data.decode("utf-8")
    except UnicodeDecodeError:
        lines = data.splitlines(keepends=True)
    if len(lines) == 1:
        return data.decode("cp1252", errors="backslashreplace")
    return "".join(map(text_of, lines))


def integer(word: str | bytes, base: int = 10) -> int:
    """A word of a file as an integer. Raises ValueError if it is not an integer, for example ``1_000`` or ``١٢``."""
    return int(_plain(word), base)


def real(word: str | bytes) -> float:
    """A word of a file as a number; Fortran writes exponents with D too. Raises ValueError if it is not a number."""
    return float(_fortran(_plain(word)))


def number_array(words: Sequence[str] | Sequence[bytes], dtype: DTypeLike) -> NDArray[Any]:
    """Words of a file as numbers (n,), as :func:`real` takes them. Raises ValueError if a word is not a number."""
    whole = b"".join(words) if words and isinstance(words[0], bytes) else "".join(words)  # type: ignore[arg-type]
    if not _is_plain(whole):
        for word in words:
            _plain(word)
    exponents = np.dtype(dtype).kind == "f" and _fortran(whole) != whole
    return np.array([_fortran(word) for word in words] if exponents else words, dtype=dtype)


def _fortran(word: str | bytes) -> str | bytes:
    """The exponent D as E."""
    if isinstance(word, bytes):
        return word.replace(b"D", b"E").replace(b"d", b"e")
    return word.replace("D", "E").replace("d", "e")


def _plain(word: str | bytes) -> str | bytes:
    """A word without what Python reads in numbers and no file format has: underscores, and digits of other scripts."""
    if not _is_plain(word):
        raise ValueError(f"{word.decode(errors='replace') if isinstance(word, bytes) else word!r} is not a number")
    return word


def _is_plain(text: str | bytes) -> bool:
    return text.isascii() and (b"_" not in text if isinstance(text, bytes) else "_" not in text)
