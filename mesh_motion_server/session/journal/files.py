"""Reads the journal's files and verifies them; :mod:`.journal` writes them."""

from contextlib import suppress
from pathlib import Path

import numpy as np
from mesh_motion_numerics.arrays import Floats
from mesh_motion_protocol.digests import state_digest
from mesh_motion_protocol.errors import DataLoss

from mesh_motion_server.session.journal.filesystem import FileSystem, bounded_size, read_whole, reading, unreadable
from mesh_motion_server.session.journal.ledger import Foundation, Ledger, slot_of
from mesh_motion_server.session.journal.records import PAGE, Record, unpack_record
from mesh_motion_server.session.journal.recovery import Findings, SlotView, examine, read_chain, sum_up

MANIFEST = "manifest"
NEXT_MANIFEST = "manifest.new"
FIRST_MANIFEST = "manifest.first"
SLOTS = ("slot-0", "slot-1")

#: Number of commits whose replies are kept, and therefore restored after a crash.
KEPT_COMMITS = 8
#: Number of bytes of a manifest that are read first for a list: some ten commits.
_FIRST_BYTES = 16 * PAGE
#: More than any manifest has: 24 records of 256 partitions, and the log of level "replay".
_MOST_BYTES = 1 << 28


def read_journal(folder: Path, files: FileSystem) -> Findings:
    """Judge the journal in a session's folder; changes nothing.

    Raises DataLoss on damage, a missing file, or another format.
    """

    def view_slots(foundation: Foundation) -> tuple[SlotView, SlotView]:
        first, second = (view_slot(folder / name, files, foundation) for name in SLOTS)
        return first, second

    try:
        return examine(read_whole(files, folder / MANIFEST, _MOST_BYTES), view_slots, keep=KEPT_COMMITS)
    except OSError as error:
        raise unreadable("the journal", error) from error


def read_ledger(folder: Path, files: FileSystem) -> Ledger:
    """Read only the manifest, for lists: a commit that only its slot completes is not included.

    Raises DataLoss on damage of the chain, a missing file, or another format.
    """
    try:
        return sum_up(_read_chain(files, folder / MANIFEST), keep=1)
    except OSError as error:
        raise unreadable("the journal", error) from error


def _read_chain(files: FileSystem, path: Path) -> list[Record]:
    """Read a manifest's records; of the empty rest, most of a young session's manifest, only little is read."""
    with reading(files, path) as handle:
        size, part = bounded_size(files, handle, _MOST_BYTES), _FIRST_BYTES
        while part < size:
            data = files.read(handle, 0, part)
            with suppress(DataLoss):
                records, end = read_chain(data)
                if end + PAGE <= len(data) and not any(data[end : end + PAGE]):
                    return records  # no record begins in an empty page
            part *= 4
        return read_chain(files.read(handle, 0, size))[0]


def read_stored_state(folder: Path, files: FileSystem, ledger: Ledger) -> tuple[int, Floats] | None:
    """The last step whose coordinates are stored, with the coordinates (n, d), ascending by global id; None at step 0.

    Raises DataLoss: DATA_LOSS.CHECKSUM if they do not match their digest.
    """
    snapshot = ledger.snapshot
    if snapshot is None:
        return None
    foundation = ledger.foundation
    try:
        raw = _read_part(files, folder / SLOTS[snapshot.slot], foundation.record_area, foundation.state_bytes)
    except OSError as error:
        raise unreadable("a slot", error) from error
    return snapshot.step, verified_state(raw, ledger)


def verified_state(raw: bytes, ledger: Ledger) -> Floats:
    """The last stored state (n, d) from its slot's bytes."""
    last = ledger.snapshot
    if last is None:
        raise DataLoss("no state is stored yet", code="INTERNAL")
    state = _as_state(raw, ledger.foundation)
    if state is None or state_digest(last.step, state) != last.digest:
        raise DataLoss(
            f"the coordinates of committed step {last.step} do not match their digest",
            hint="restore the session's folder from a backup, or discard the session",
            details={"step": last.step},
        )
    return state


def view_slot(path: Path, files: FileSystem, foundation: Foundation) -> SlotView:
    """Return a slot's record; its coordinates are read only on request."""
    area = foundation.record_area
    head = _read_part(files, path, 0, area)
    record = unpack_record(head)

    def state_verifies() -> bool:
        state = _as_state(_read_part(files, path, area, foundation.state_bytes), foundation)
        if state is None or record is None or slot_of(record) is None:
            return False
        digest: bytes = record.body["digest"]
        return state_digest(record.body["step"], state) == digest

    return SlotView(record, not any(head), state_verifies)


def _as_state(raw: bytes, foundation: Foundation) -> Floats | None:
    """(n, d) coordinates, or None when bytes are missing."""
    if len(raw) != foundation.state_bytes:
        return None
    state = np.frombuffer(raw, dtype="<f8").reshape(foundation.nodes, foundation.dimension)
    return state.astype(np.float64, copy=False)


def _read_part(files: FileSystem, path: Path, offset: int, size: int) -> bytes:
    with reading(files, path) as handle:
        return files.read(handle, offset, size)
