"""Journal records: framed, checksummed, each naming the one before it (a hash chain).

A record fills whole pages of 4096 bytes, so that writing one never touches a page that holds an older one::

    offset  bytes  content
         0      8  magic "MMJRNL" 01 0a (01: format version)
         8      8  sequence, little-endian: 0, 1, 2, … over the session's whole life
        16      8  length of the body, little-endian
        24     32  checksum of the record before it (zeros: the first)
        56      …  body: a msgpack map; its "kind" says which
         …     32  checksum: sha256 of all bytes before
         …      …  zeros up to the end of the page
"""

from __future__ import annotations

import hashlib
import struct
from dataclasses import dataclass
from typing import Any

import msgpack

__all__ = ["MAGIC", "PAGE", "Record", "find_record", "pack_record", "unpack_record"]

MAGIC = b"MMJRNL\x01\n"
PAGE = 4096
_HEAD = struct.Struct("<8sQQ32s")
_CHECKSUM_BYTES = 32


@dataclass(frozen=True)
class Record:
    """One record that verified.

    Attributes
    ----------
    sequence : int
    previous : bytes
        Checksum of the record before it.
    body : dict
    checksum : bytes
    length : int
        Bytes it takes in the file, whole pages.
    """

    sequence: int
    previous: bytes
    body: dict[str, Any]
    checksum: bytes
    length: int

    @property
    def kind(self) -> str:
        """What the record says: "build", "commit", "epoch" or "checkpoint"."""
        return str(self.body.get("kind", ""))

    def follows(self, other: Record) -> bool:
        """Whether it is the next one of the chain."""
        return self.sequence == other.sequence + 1 and self.previous == other.checksum


def pack_record(sequence: int, previous: bytes, body: dict[str, Any]) -> bytes:
    """The record's bytes, whole pages."""
    packed = msgpack.packb(body, use_bin_type=True)
    framed: bytes = _HEAD.pack(MAGIC, sequence, len(packed), previous) + packed
    framed += hashlib.sha256(framed).digest()
    return framed + bytes(-len(framed) % PAGE)


def unpack_record(data: bytes, offset: int = 0) -> Record | None:
    """The record at ``offset``, or None when what is there does not verify."""
    if len(data) - offset < _HEAD.size + _CHECKSUM_BYTES:
        return None
    magic, sequence, length, previous = _HEAD.unpack_from(data, offset)
    start = offset + _HEAD.size
    end = start + length
    if magic != MAGIC or end + _CHECKSUM_BYTES > len(data):
        return None
    checksum = data[end : end + _CHECKSUM_BYTES]
    if hashlib.sha256(memoryview(data)[offset:end]).digest() != checksum:
        return None
    used = end + _CHECKSUM_BYTES - offset
    # what verified was packed by pack_record, so that unpacking cannot fail
    return Record(sequence, previous, msgpack.unpackb(data[start:end]), checksum, used + -used % PAGE)


def find_record(data: bytes, offset: int) -> int | None:
    """Offset of the first page from ``offset`` on that starts a record which verifies."""
    while (offset := data.find(MAGIC, offset)) >= 0:
        if offset % PAGE == 0 and unpack_record(data, offset) is not None:
            return offset
        offset += 1
    return None
