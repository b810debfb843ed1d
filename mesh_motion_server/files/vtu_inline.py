"""VTU files as meshio reads them rightly and within bounds: each array in its own element, what is compressed measured.

meshio 5.3 finds the arrays of raw appended data by their offsets, and writes other offsets into the same elements as it
goes along: where an old and a new one are equal, it takes one array for another. And it unpacks whatever a block of a
compressed array holds: a megabyte may be a gigabyte. So each block is unpacked here first, to no more than its array's
head promises, and meshio gets what was measured.

https://docs.vtk.org/en/latest/design_documents/VTKFileFormats.html
"""

from __future__ import annotations

import base64
import lzma
import re
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from mesh_motion_server.files.memory import most_memory

__all__ = ["inlined"]

_APPENDED = re.compile(rb"<AppendedData\s[^>]*encoding\s*=\s*[\"']raw[\"'][^>]*>\s*_")
_END = b"</AppendedData>"
#: LZMA asks for its dictionary first: 65 MiB at its strongest preset.
_DICTIONARY = 128 << 20
_UNPACKERS: dict[str, Callable[[], Any]] = {
    "vtkZLibDataCompressor": zlib.decompressobj,
    "vtkLZMADataCompressor": lambda: lzma.LZMADecompressor(memlimit=_DICTIONARY),
}


def inlined(path: Path) -> bytes | None:
    """The same file without appended data; None if it has none that is raw and nothing is compressed.

    Raises
    ------
    ValueError
        If an array reaches beyond the file, or does not unpack to what its head promises, or all together promise more
        than a mesh may be, and what XML and the compressors raise.
    """
    raw = path.read_bytes()
    begin = _APPENDED.search(raw)
    if begin is None and _compressor(path) is None:
        return None
    end = len(raw) if begin is None else raw.rfind(_END)
    root = ElementTree.fromstring(raw if begin is None else raw[: begin.start()] + raw[end + len(_END) :])
    line = raw.rfind(b"\n", 0, end)  # the last one is no data
    data = raw[: line if raw[line:end].isspace() else end]
    text = _appended_text(root)
    arrays = _Arrays(root, most_memory(len(raw)))
    for array in root.iter():
        form = array.get("format")
        if form == "appended":
            place = int(array.attrib.pop("offset"))
            texts = arrays.of_base64(text[place:]) if begin is None else arrays.of_raw(data, begin.end() + place)
        elif form == "binary" and arrays.compressor is not None:
            texts = arrays.of_base64((array.text or "").strip())
        else:
            continue
        array.set("format", "binary" if texts else "ascii")
        array.text = "".join(texts) or "\n"
    return ElementTree.tostring(root)


def _compressor(path: Path) -> str | None:
    """What compressed the arrays, as the file's first element says."""
    with path.open("rb") as file:
        _, root = next(iter(ElementTree.iterparse(file, events=("start",))))
        found: str | None = root.get("compressor")
    return found


def _appended_text(root: ElementTree.Element) -> str:
    """Take the appended data in base64 out of a file; they are what follows an underscore."""
    found = root.find("AppendedData")
    if found is None:
        return ""
    root.remove(found)
    return (found.text or "").strip()[1:]


class _Arrays:
    """The binary arrays of a file in base64: head and values together, or apart if they are compressed.

    Of a compressed array the head has the number of its blocks, their length, that of the last, and what each takes.

    Parameters
    ----------
    root : Element
        The file's.
    most : int
        Bytes that all compressed arrays together may be.
    """

    def __init__(self, root: ElementTree.Element, most: int) -> None:
        order = ">" if root.get("byte_order") == "BigEndian" else "<"
        self._integer = np.dtype(order + ("u8" if root.get("header_type") == "UInt64" else "u4"))
        self._left = self._most = most
        self.compressor = root.get("compressor")

    def of_raw(self, raw: bytes, place: int) -> list[str]:
        """The array that begins at a place; nothing for an empty one."""
        count = int(np.frombuffer(raw, self._integer, 1, place)[0])
        if self.compressor is None:
            return [base64.b64encode(_cut(raw, place, self._integer.itemsize + count)).decode()]
        head = _cut(raw, place, self._head_bytes(count))
        return self._measured(head, lambda size: _cut(raw, place + len(head), size))

    def of_base64(self, text: str) -> list[str]:
        """The compressed array that a text begins with, head and blocks each encoded for itself."""
        word = base64.b64decode(text[: _characters(self._integer.itemsize)])
        size = self._head_bytes(int(np.frombuffer(word, self._integer, 1)[0]))
        head = _cut(base64.b64decode(text[: _characters(size)]), 0, size)
        rest = text[_characters(size) :]
        return self._measured(head, lambda size: _cut(base64.b64decode(rest[: _characters(size)]), 0, size))

    def _head_bytes(self, count: int) -> int:
        return self._integer.itemsize * (3 + count if count else 1)

    def _measured(self, head: bytes, blocks: Callable[[int], bytes]) -> list[str]:
        """Head and blocks in base64, if the blocks unpack to what the head promises."""
        count, *numbers = (int(number) for number in np.frombuffer(head, self._integer))
        if not count:
            return []
        size, last, *packed = numbers
        promised = [size] * (count - 1) + [last or size]
        self._left -= sum(promised)
        if self._left < 0:
            raise ValueError(f"its arrays unpack to more than {self._most} bytes: no mesh; save it uncompressed")
        data = blocks(sum(packed))
        begin = 0
        for length, expected in zip(packed, promised, strict=True):
            self._unpack(data[begin : begin + length], expected)
            begin += length
        return [base64.b64encode(head).decode(), base64.b64encode(data).decode()]

    def _unpack(self, block: bytes, expected: int) -> None:
        """Unpack a block, to throw it away; one byte more than expected is seen."""
        if self.compressor not in _UNPACKERS:
            raise ValueError(f"arrays compressed by {self.compressor}; known are {', '.join(_UNPACKERS)}")
        unpacker = _UNPACKERS[self.compressor]()
        found = unpacker.decompress(block, expected + 1)
        if len(found) != expected or not unpacker.eof or unpacker.unused_data:
            raise ValueError(f"a compressed block does not unpack to the {expected} bytes that its array promises")


def _characters(size: int) -> int:
    """That so many bytes take in base64."""
    return -(-size // 3) * 4


def _cut(raw: bytes, place: int, count: int) -> bytes:
    """So many bytes from a place on."""
    if place + count > len(raw):
        raise ValueError(f"an array of {count} bytes at {place} goes beyond the data")
    return raw[place : place + count]
