"""The last page of a manifest of level "replay": it names the newest record that is known to be durable.

A commit whose state is stored has a copy of its record in the slot. A commit that is only logged has none. If the last
record of a manifest does not verify, there are two cases: a crash has torn the write and no client got a reply, or the
record was answered and damaged later. So the page names the newest record that was synced before; it is written with
the next record and needs no additional sync::

    offset  bytes  content
         0      8  magic "MMTAIL" 01 0a
         8      8  sequence of the record, little-endian
        16     32  its checksum
        48     32  sha256 of all bytes before
"""

from __future__ import annotations

import hashlib
import struct
from dataclasses import dataclass

from mesh_motion_server.session.journal.ledger import Foundation
from mesh_motion_server.session.journal.records import PAGE, Record

_MAGIC = b"MMTAIL\x01\n"
_CONTENT = struct.Struct("<8sQ32s")


def has_witness(foundation: Foundation) -> bool:
    """Whether a manifest of this level ends with such a page."""
    return foundation.durability == "replay"


def manifest_bytes(foundation: Foundation, capacity: int) -> int:
    """Length of a manifest file with this many bytes for records."""
    return capacity + PAGE * has_witness(foundation)


@dataclass(frozen=True)
class Witness:
    """A durable record: its sequence and checksum."""

    sequence: int
    checksum: bytes

    @classmethod
    def of(cls, record: Record) -> Witness:
        """The witness of this record."""
        return cls(record.sequence, record.checksum)

    def pack(self) -> bytes:
        """The page's content, without the zeros after it."""
        content = _CONTENT.pack(_MAGIC, self.sequence, self.checksum)
        return content + hashlib.sha256(content).digest()

    @classmethod
    def unpack(cls, page: bytes) -> Witness | None:
        """Read a witness from the page; None if it was never written, or does not verify."""
        if len(page) < _CONTENT.size + 32:
            return None
        magic, sequence, checksum = _CONTENT.unpack_from(page)
        known = hashlib.sha256(page[: _CONTENT.size]).digest() == page[_CONTENT.size : _CONTENT.size + 32]
        return cls(sequence, checksum) if known and magic == _MAGIC else None

    def agrees(self, last: Record) -> bool:
        """Whether a chain that ends with this record contains the witnessed record."""
        return self.sequence < last.sequence or self == Witness.of(last)
