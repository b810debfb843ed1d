"""VTU files of raw appended data with each array in its own element instead, as meshio reads it rightly.

meshio 5.3 finds the arrays of appended data by their offsets, and writes other offsets into the same elements as it
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
    line = raw.rfind(b"\n", begin.end(), end)  # the last one is no data
    data = raw[: line if raw[line:end].isspace() else end]
    order = ">" if root.get("byte_order") == "BigEndian" else "<"
    integer = np.dtype(order + ("u8" if root.get("header_type") == "UInt64" else "u4"))
    for array in root.iter():
        if array.get("format") == "appended":
            place = begin.end() + int(array.attrib.pop("offset"))
            texts = _texts(data, place, integer, compressed="compressor" in root.attrib)
            array.set("format", "binary" if texts else "ascii")
            array.text = "".join(texts) or "\n"
    return ElementTree.tostring(root)


def _texts(raw: bytes, place: int, integer: np.dtype[np.unsignedinteger], *, compressed: bool) -> list[str]:
    """The array that begins at a place in base64: head and values together, or apart if it is compressed.

    Of a compressed array the head has the number of its blocks, their length, that of the last, and what each takes.
    """
    head = np.frombuffer(raw, integer, 1, place)
    if not compressed:
        return [_encoded(raw, place, integer.itemsize + int(head[0]))]
    if not head[0]:
        return []
    head = np.frombuffer(raw, integer, 3 + int(head[0]), place)
    return [_encoded(raw, place, head.nbytes), _encoded(raw, place + head.nbytes, sum(map(int, head[3:])))]


def _encoded(raw: bytes, place: int, count: int) -> str:
    """So many bytes in base64."""
    if place + count > len(raw):
        raise ValueError(f"an array of {count} bytes at {place} goes beyond the data")
    return base64.b64encode(raw[place : place + count]).decode()
