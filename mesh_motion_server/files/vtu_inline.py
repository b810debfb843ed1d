"""VTU files with raw appended data, with each array moved into its own element, because meshio reads these correctly.

meshio 5.3 finds the arrays of raw appended data by their offsets, and writes new offsets into the same elements while
it reads: if an old and a new offset are equal, it confuses the two arrays.

https://docs.vtk.org/en/latest/design_documents/VTKFileFormats.html
"""

import base64
import re
from xml.etree import ElementTree

import numpy as np

__all__ = ["inlined"]

_APPENDED = re.compile(rb"<AppendedData\s[^>]*encoding\s*=\s*[\"']raw[\"'][^>]*>\s*_")
_END = b"</AppendedData>"


def inlined(raw: bytes) -> bytes | None:
    """The same file without appended data; None if it has no raw appended data.

    Raises
    ------
    ValueError
        If an array reaches beyond the file; XML errors pass through.
    """
    begin = _APPENDED.search(raw)
    if begin is None:
        return None
    end = raw.rfind(_END)
    root = ElementTree.fromstring(raw[: begin.start()] + raw[end + len(_END) :])
    line = raw.rfind(b"\n", 0, end)  # the last line is not data
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
    """An array in base64: header and values together, or separate if compressed; empty for an empty array.

    The header of a compressed array has the number of blocks, their length, that of the last, and each stored size.
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
    """``count`` bytes from ``place`` on."""
    if place + count > len(data):
        raise ValueError(f"an array of {count} bytes at {place} goes beyond the data")
    return data[place : place + count]
