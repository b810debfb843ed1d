"""Journal records: framed, checksummed, each naming the one before it (a hash chain).

A record fills whole pages of 4096 bytes, so that writing one never touches a page that holds an older one::

    offset  bytes  content
         0      8  magic "MMJRNL", the format's version, 0a
         8      8  sequence, little-endian: 0, 1, 2, … over the session's whole life
        16      8  length of the body, little-endian
        24     32  checksum of the record before it (zeros: the first)
        56      …  body: a msgpack map; its "kind" says which
         …     32  checksum: sha256 of all bytes before
         …      …  zeros up to the end of the page

Format 1 is used by sessions with durability "full": every commit has its slot. Format 2 is used by the other levels,
whose records have more fields (:mod:`.ledger`). A journal keeps the format in which it was started. A format is never
changed: a change that older versions would misread gets a new number. All earlier formats can still be read; a test
opens stored journals of each (``tests/references/journals``).
"""

from __future__ import annotations

import hashlib
import struct
from dataclasses import dataclass
from typing import Any

import msgpack
from mesh_motion_protocol.errors import DataLoss

FAMILY = b"MMJRNL"
#: The formats that this version reads and writes.
FORMATS = (1, 2)
PAGE = 4096
_FORMAT_OF = {FAMILY + bytes([number]) + b"\n": number for number in FORMATS}
_MAGIC_OF = {number: magic for magic, number in _FORMAT_OF.items()}
_HEAD = struct.Struct("<8sQQ32s")
_CHECKSUM_BYTES = 32


@dataclass(frozen=True)
class Record:
    """One record with a correct checksum."""

    sequence: int
    previous: bytes  # checksum of the record before it
    body: dict[str, Any]
    checksum: bytes
    length: int  # bytes of the record in the file, whole pages
    format: int = 1  # one of :data:`FORMATS`

    @property
    def kind(self) -> str:
        """The kind of the record: "build", "commit", "snapshot", "epoch" or "checkpoint"."""
        return str(self.body.get("kind", ""))

    def follows(self, other: Record) -> bool:
        """Whether this record is the next one of the chain."""
        follows = self.sequence == other.sequence + 1 and self.previous == other.checksum
        return follows and self.format == other.format


def pack_record(sequence: int, previous: bytes, body: dict[str, Any], format: int = 1) -> bytes:
    """Make the record's bytes, whole pages."""
    packed = msgpack.packb(body, use_bin_type=True)
    framed: bytes = _HEAD.pack(_MAGIC_OF[format], sequence, len(packed), previous) + packed
    framed += hashlib.sha256(framed).digest()
    return framed + bytes(-len(framed) % PAGE)


def unpack_record(data: bytes, offset: int = 0) -> Record | None:
    """The record at ``offset``; None if the bytes there do not verify."""
    if len(data) - offset < _HEAD.size + _CHECKSUM_BYTES:
        return None
    magic, sequence, length, previous = _HEAD.unpack_from(data, offset)
    start = offset + _HEAD.size
    end = start + length
    if magic not in _FORMAT_OF or end + _CHECKSUM_BYTES > len(data):
        return None
    checksum = data[end : end + _CHECKSUM_BYTES]
    if hashlib.sha256(memoryview(data)[offset:end]).digest() != checksum:
        return None
    used = end + _CHECKSUM_BYTES - offset
    # verified bytes were packed by pack_record, so that unpacking cannot fail
    body = msgpack.unpackb(data[start:end])
    return Record(sequence, previous, body, checksum, used + -used % PAGE, _FORMAT_OF[magic])


def verified(packed: bytes) -> Record:
    """The record that :func:`pack_record` has just packed."""
    record = unpack_record(packed)
    if record is None:
        raise DataLoss("a record has a wrong checksum right after it was packed", code="INTERNAL")
    return record


def find_record(data: bytes, offset: int) -> int | None:
    """Offset of the first page from ``offset`` on with the start of a valid record."""
    while (offset := data.find(FAMILY, offset)) >= 0:
        if offset % PAGE == 0 and unpack_record(data, offset) is not None:
            return offset
        offset += 1
    return None
