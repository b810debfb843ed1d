"""VTU files with raw appended data, with each array moved into its own element, because meshio reads these correctly.

meshio 5.3 finds the arrays of raw appended data by their offsets, and writes new offsets into the same elements while
it reads: if an old and a new offset are equal, it confuses the two arrays. It unpacks whatever it is given, so the size
of compressed arrays is counted here first.

https://docs.vtk.org/en/latest/design_documents/VTKFileFormats.html
"""

import base64
import lzma
import re
import zlib
from collections.abc import Callable, Iterator
from typing import Any
from xml.etree import ElementTree

import numpy as np

__all__ = ["inlined", "unpacked_bytes"]

_APPENDED = re.compile(rb"<AppendedData\s[^>]*encoding\s*=\s*[\"']raw[\"'][^>]*>\s*_")
_END = b"</AppendedData>"
_UNPACKERS: dict[str | None, Callable[[], Any]] = {
    "vtkZLibDataCompressor": zlib.decompressobj,
    "vtkLZMADataCompressor": lzma.LZMADecompressor,
}


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
    integer = _header_type(root)
    for array in root.iter():
        if array.get("format") == "appended":
            place = begin.end() + int(array.attrib.pop("offset"))
            texts = _encoded(data, place, integer, is_compressed=root.get("compressor") is not None)
            array.set("format", "binary" if texts else "ascii")
            array.text = texts or "\n"
    return ElementTree.tostring(root)


def unpacked_bytes(raw: bytes, most: int) -> int:
    """Bytes that the compressed arrays of a file without raw appended data hold; counts to ``most`` + 1.

    Raises
    ------
    ValueError
        If an array is not in base64 or cannot be unpacked; XML errors and those of zlib and lzma pass through.
    """
    root = ElementTree.fromstring(raw)
    unpacker = _UNPACKERS.get(root.get("compressor"))
    if unpacker is None:
        return 0
    held = 0
    for block in _blocks(root):
        if held <= most:
            held += len(unpacker().decompress(block, most + 1 - held))
    return held


def _blocks(root: ElementTree.Element) -> Iterator[memoryview]:
    """The compressed blocks of all arrays."""
    integer, appended = _header_type(root), root.findtext("AppendedData", "").strip().removeprefix("_")
    for array in root.iter("DataArray"):
        text = (array.text or "").strip() if array.get("format") == "binary" else ""
        if array.get("format") == "appended":
            text = appended[int(array.get("offset", 0)) :]
        if text:
            count = int(np.frombuffer(_decoded(text, integer.itemsize), integer)[0])
            head = np.frombuffer(_decoded(text, size := integer.itemsize * (3 + count)), integer)
            begin, sizes = 4 * -(-size // 3), [int(packed) for packed in head[3:]]
            blocks = memoryview(_decoded(text[begin:], sum(sizes)))
            for packed in sizes:
                yield blocks[:packed]
                blocks = blocks[packed:]


def _decoded(text: str, count: int) -> bytes:
    """The first ``count`` bytes of a text in base64."""
    return base64.b64decode(text[: 4 * -(-count // 3)])[:count]


def _header_type(root: ElementTree.Element) -> np.dtype[np.generic]:
    """The type of the numbers before an array."""
    order = ">" if root.get("byte_order") == "BigEndian" else "<"
    return np.dtype(order + ("u8" if root.get("header_type") == "UInt64" else "u4"))


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
