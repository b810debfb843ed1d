"""Reads a journal after a crash or damage: what is certain, what must be repaired, what must be refused.

Writing a commit means: slot, sync, record, sync, answer. So a crash can leave only this:

- a slot that does not verify, and a manifest that ends cleanly: the commit had not reached its record;
- a complete slot, and a record that is missing or torn: the slot's copy of the record completes the manifest;
- a torn record of an epoch, or of a commit whose state is not stored but recomputed: it was not answered, and the
  next epoch skips its number.

Anything else is damage and refused: a record that does not verify before one that does, a slot or the witness
(:mod:`.witness`) that knows a record missing in the manifest, a torn commit record without its slot, a state whose
coordinates do not match their digest. Nothing is guessed. Reading changes nothing; :mod:`.journal` repairs.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from mesh_motion_protocol.errors import DataLoss

from mesh_motion_server.session.journal.ledger import Foundation, Ledger
from mesh_motion_server.session.journal.records import FAMILY, FORMATS, Record, find_record, unpack_record
from mesh_motion_server.session.journal.witness import Witness, has_witness

_HINT = "restore the session's folder from a backup, or discard the session"


@dataclass(frozen=True)
class SlotView:
    """The content of a slot."""

    record: Record | None  # the copy of its commit's record, if that verifies
    blank: bool  # whether the record area has only zeros: never written, or cleaned
    state_verifies: Callable[[], bool]  # whether the coordinates match the digest in ``record``; reads the whole slot


@dataclass(frozen=True)
class Findings:
    """The result of reading a journal."""

    ledger: Ledger  # includes the records that will be completed from slots
    end: int  # offset in the manifest at which its records end
    completion: tuple[Record, ...]  # the records with a state that are in slots but not in the manifest, oldest first
    torn: bool  # whether the manifest ends with bytes that are not a record
    dirty_slots: tuple[int, ...]  # slots of a commit that had not reached its record
    records: tuple[Record, ...]  # the records in the manifest


def examine(manifest: bytes, view_slots: Callable[[Foundation], tuple[SlotView, SlotView]], *, keep: int) -> Findings:
    """Judge a manifest and its slots.

    Raises DataLoss: DATA_LOSS.CHECKSUM on damage, with the place; UNIMPLEMENTED.VERSION on another format.

    Parameters
    ----------
    manifest : bytes
        The whole file.
    view_slots : callable
        Opens both slots, once their layout is known.
    keep : int
        Number of commits that the ledger keeps.
    """
    records, end = read_chain(manifest)
    ledger = sum_up(records, keep=keep)
    torn = len(manifest) < ledger.capacity or any(manifest[end : ledger.capacity])
    if (later := find_record(manifest, end)) is not None:
        raise _damage(
            f"the record at byte {end} of the manifest has a wrong checksum, but a later one at {later} is correct", end
        )
    slots = view_slots(ledger.foundation)
    completion = _completion(slots, ledger.last)
    for record in completion:
        ledger = ledger.after(record, keep)
    _check_witness(manifest, ledger, end)
    dirty = _dirty_slots(slots, ledger)
    if dirty and torn and not completion:
        raise _damage(f"the record at byte {end} of the manifest has a wrong checksum, and slot {dirty[0]} too", end)
    return Findings(ledger, end, completion, torn, dirty, tuple(records))


def sum_up(records: Sequence[Record], *, keep: int) -> Ledger:
    """The ledger after these records; it keeps the latest ``keep`` commits."""
    ledger = Ledger.start(records[0])
    for record in records[1:]:
        ledger = ledger.after(record, keep)
    return ledger


def read_chain(manifest: bytes) -> tuple[list[Record], int]:
    """Read records from the start as long as each follows the one before; return them and their end.

    Raises DataLoss if not even the first one verifies.
    """
    first = unpack_record(manifest)
    if first is None:
        if len(manifest) > 8 and manifest[:6] == FAMILY and manifest[6] not in FORMATS:
            raise DataLoss(
                f"the journal has format {manifest[6]}; this version reads the formats {FORMATS[0]} to {FORMATS[-1]}",
                code="UNIMPLEMENTED.VERSION",
                hint="open it with the version of the server that wrote it; nothing was changed",
                details={"got": manifest[6], "expected": list(FORMATS)},
            )
        raise _damage("the first record of the manifest has a wrong checksum", 0)
    records, end = [first], first.length
    while (record := unpack_record(manifest, end)) is not None and record.follows(records[-1]):
        records.append(record)
        end += record.length
    return records, end


def _completion(slots: tuple[SlotView, SlotView], last: Record) -> tuple[Record, ...]:
    """The records that complete slots have beyond the manifest; they must continue its chain."""
    found: list[Record] = []
    known = [(slot.record, number, slot) for number, slot in enumerate(slots) if slot.record is not None]
    for record, number, slot in sorted(known, key=lambda entry: entry[0].sequence):
        if record.sequence <= last.sequence:
            continue
        if not record.follows(last):
            raise _damage(
                f"slot {number} refers to record {record.sequence}, but the manifest ends with another record", 0
            )
        if slot.state_verifies():
            found.append(record)
            last = record
    return tuple(found)


def _check_witness(manifest: bytes, ledger: Ledger, end: int) -> None:
    """Check that the chain has the last record that is known to be durable."""
    if not has_witness(ledger.foundation):
        return
    witness = Witness.unpack(manifest[ledger.capacity :])
    if witness is not None and not witness.agrees(ledger.last):
        raise _damage(f"the record at byte {end} of the manifest has a wrong checksum, but it was correct once", end)


def _dirty_slots(slots: tuple[SlotView, SlotView], ledger: Ledger) -> tuple[int, ...]:
    """Slots that are not empty and have no commit of the ledger's past."""
    return tuple(
        number
        for number, slot in enumerate(slots)
        if not slot.blank and (slot.record is None or slot.record.sequence > ledger.last.sequence)
    )


def _damage(what: str, offset: int) -> DataLoss:
    return DataLoss(f"the journal is damaged: {what}", hint=_HINT, details={"offset": offset})
