"""VTU files with raw appended data, each array moved into its own element, as meshio reads them rightly.

meshio 5.3 finds the arrays of raw appended data by their offsets, and writes other offsets into the same elements as it
goes along: where an old and a new one are equal, it takes one array for another.

https://docs.vtk.org/en/latest/design_documents/VTKFileFormats.html
"""

from __future__ import annotations

import base64
import re
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

__all__ = ["inlined"]

_APPENDED = re.compile(rb"<AppendedData\s[^>]*encoding\s*=\s*[\"']raw[\"'][^>]*>\s*_")
_END = b"</AppendedData>"


def inlined(path: Path) -> bytes | None:
    """The same file without appended data; None if it has none that is raw.

    Raises
    ------
    ValueError
        If an array reaches beyond the file, and what XML raises.
    """
    raw = path.read_bytes()
    begin = _APPENDED.search(raw)
    if begin is None:
        return None
    end = raw.rfind(_END)
    root = ElementTree.fromstring(raw[: begin.start()] + raw[end + len(_END) :])
    line = raw.rfind(b"\n", 0, end)  # the last one is no data
    data = raw[: line if raw[line:end].isspace() else end]
    order = ">" if root.get("byte_order") == "BigEndian" else "<"
    integer = np.dtype(order + ("u8" if root.get("header_type") == "UInt64" else "u4"))
    for array in root.iter():
        if array.get("format") == "appended":
            place = begin.end() + int(array.attrib.pop("offset"))
            texts = _encoded(data, place, integer, is_compressed=root.get("compressor") is not None)
            array.set("format", "binary" if texts else "ascii")
            array.text = texts or "\n"
    return ElementTree.tostring(root)


def _encoded(data: bytes, place: int, integer: np.dtype[np.generic], *, is_compressed: bool) -> str:
    """An array in base64: head and values together, or apart if they are compressed; empty for an empty one.

    Of a compressed array the head has the number of its blocks, their length, that of the last, and what each takes.
    """
    count = int(np.frombuffer(data, integer, 1, place)[0])
    if not is_compressed:
        return base64.b64encode(_cut(data, place, integer.itemsize + count)).decode()
    if not count:
        return ""
    head = _cut(data, place, integer.itemsize * (3 + count))
    blocks = _cut(data, place + len(head), int(np.frombuffer(head, integer)[3:].sum()))
    return base64.b64encode(head).decode() + base64.b64encode(blocks).decode()


def _cut(data: bytes, place: int, count: int) -> bytes:
    """So many bytes from a place on."""
    if place + count > len(data):
        raise ValueError(f"an array of {count} bytes at {place} goes beyond the data")
    return data[place : place + count]
