"""Frames as people read them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import msgpack

from mesh_motion_conformance.wire import Malformed, Message, read

__all__ = ["show", "show_frames"]

_LONGEST = 600


def show(message: Message) -> str:
    """``TYPE sequence {fields} arrays`` in one line."""
    arrays = [f"{name} {array.dtype.str}{list(array.shape)}" for name, array in message.arrays.items()]
    text = f"{message.kind} #{message.sequence} {_plain(message.fields)}"
    return _cut(" + ".join([text, ", ".join(arrays)] if arrays else [text]))


def show_frames(frames: Sequence[bytes]) -> str:
    """The message in the frames, or the readable part of them."""
    try:
        return show(read(frames))
    except Malformed:
        pass
    sizes = ", ".join(str(len(frame)) for frame in frames)
    try:
        header: Any = msgpack.unpackb(frames[0], raw=False, strict_map_key=False, ext_hook=msgpack.ExtType)
        return _cut(f"frames of {sizes} bytes: {_plain(header)}")
    except Exception:  # whatever a broken frame does to the reader
        return _cut(f"frames of {sizes} bytes: {frames[0][:48].hex(' ') if frames else 'none'}")


def _plain(value: Any) -> str:
    """Values as JSON-like text; binary in hexadecimal."""
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key!s}: {_plain(item)}" for key, item in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(_plain(item) for item in value[:12]) + (", …]" if len(value) > 12 else "]")
    if isinstance(value, bytes):
        return f"<{value[:8].hex()}{'…' if len(value) > 8 else ''}>"
    return repr(value) if isinstance(value, str) else str(value)


def _cut(text: str) -> str:
    """Cut to a number of characters, without control characters of a peer for the terminal."""
    text = "".join(letter if letter.isprintable() else repr(letter)[1:-1] for letter in text)
    return text if len(text) <= _LONGEST else text[: _LONGEST - 1] + "…"
