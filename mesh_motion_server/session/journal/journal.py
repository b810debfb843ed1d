"""The journal of one session: a committed step survives kill -9 and loss of power, bitwise.

The journal's files in a session's folder:

``manifest``
    Append-only hash-chained records (:mod:`.records`,
    :mod:`.ledger`), preallocated with zeros. When it is full, ``manifest.new`` is written with a "checkpoint" of all
    data that still matter and renamed over it. Until then ``manifest.new`` is empty and holds the space of the next
    manifest, so that a built session needs no more disk space.
``slot-0``, ``slot-1``
    Preallocated and used in turn, the first state in slot 1: the older state is overwritten and the newer one is kept.
    At offset 0 is the copy of the state's record, at ``record_area`` the coordinates: an (n, d) row-major array of
    little-endian doubles, ascending by global id.

:meth:`Journal.store` writes the slot, syncs, appends the record with its replies, and syncs; the coordinates may be
written and synced before their record is known (:meth:`Journal.write_ahead`): a slot whose record is older than its
coordinates was being overwritten. :meth:`Journal.log` syncs only a record, from which the state can be recomputed. The
level of durability decides which of the two is used (:mod:`.durability`). New and renamed files are synced with their
folder before they are used. After a failed operation nothing is retried (the kernel may have dropped data that it could
not write, and a second fsync would say "done"): the journal is frozen until another process opens it and reads the real
content of the disk.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
from mesh_motion_numerics.arrays import Floats
from mesh_motion_protocol.errors import DataLoss

from mesh_motion_server.failpoints import failpoint
from mesh_motion_server.session.journal.background_call import BackgroundCall
from mesh_motion_server.session.journal.files import (
    KEPT_COMMITS,
    MANIFEST,
    NEXT_MANIFEST,
    SLOTS,
    read_journal,
    verified_state,
)
from mesh_motion_server.session.journal.filesystem import FileSystem, disk_failure, write_all, write_file
from mesh_motion_server.session.journal.ledger import Commit, Foundation, Ledger, slot_of
from mesh_motion_server.session.journal.next_manifest import (
    create_manifest,
    manifest_capacity,
    replace_manifest,
    reserve,
)
from mesh_motion_server.session.journal.records import PAGE, Record, pack_record, verified
from mesh_motion_server.session.journal.recovery import Findings
from mesh_motion_server.session.journal.witness import Witness, has_witness, manifest_bytes

#: A state of at least this many bytes is synced before its record is written: one more sync takes less time than
#: hashing, which runs at the same time.
_LARGE_STATE = 4 << 20


def record_area(partitions: int, commits: int = 1) -> int:
    """Bytes reserved for a record of this many commits, each with a receipt of a few kB and request ids."""
    return commits * (16 * 1024 + -(-256 * partitions // PAGE) * PAGE)


class Journal:
    """The durable part of one session; held by one process.

    Attributes
    ----------
    ledger : Ledger
        The durable records.
    frozen : bool
        Whether an operation failed; then all further operations are refused.
    """

    def __init__(self, folder: Path, files: FileSystem, ledger: Ledger, end: int) -> None:
        self.ledger = ledger
        self.frozen = False
        self._folder = folder
        self._files = files
        self._end = end
        self._handles: list[int] = []
        self._ahead: tuple[Floats, BackgroundCall[None]] | None = None

    @classmethod
    def create(
        cls, folder: Path, files: FileSystem, foundation: Foundation, *, capacity: int | None = None, epoch: int = 1
    ) -> Journal:
        """Start the journal of a session that was just built; durable on return.

        Raises OSError if the disk cannot store it; then there is no manifest.

        Parameters
        ----------
        capacity : int, optional
            Bytes of each manifest, whole pages for a checkpoint and two records at least; by default some 250 commits.
        epoch : int
            The session's epoch, which is larger than 1 if it was resumed before it was built.
        """
        for name in SLOTS:
            write_file(files, folder / name, b"", foundation.record_area + foundation.state_bytes)
        failpoint("journal.create.slots")
        capacity = capacity or manifest_capacity(foundation)
        body = {"kind": "build", **foundation.as_body(), "capacity": capacity, "epoch": epoch}
        packed = pack_record(0, bytes(32), body, foundation.format)
        create_manifest(folder, files, packed, manifest_bytes(foundation, capacity))
        record = verified(packed)
        journal = cls(folder, files, Ledger.start(record), record.length)
        reserve(folder, files, manifest_bytes(foundation, capacity))
        journal._open_files()
        return journal

    @classmethod
    def open(cls, folder: Path, files: FileSystem, found: Findings | None = None) -> Journal:
        """Read the journal, or take its already read content ``found``, and repair it after a crash.

        Raises DataLoss on damage (DATA_LOSS.CHECKSUM), another format, or an operation that failed.
        """
        found = found or read_journal(folder, files)
        journal = cls(folder, files, found.ledger, found.end)
        with journal._freezing("opening the journal"):
            failpoint("journal.open.read")
            journal._open_files()
            journal._settle(found)
        return journal

    def store(self, entry: Commit, state: Floats, earlier: Sequence[Commit] = ()) -> None:
        """Make a step durable: its coordinates and its replies.

        Raises DataLoss: RESOURCE_EXHAUSTED.DISK if an operation failed; the journal is then frozen.

        Parameters
        ----------
        entry : Commit
            The commit of the step after the last one, or after the last of ``earlier``.
        state : (n, d) array, mesh length unit
            The coordinates, ascending by global id.
        earlier : sequence of Commit
            With "relaxed": the steps in between, whose states are not stored; only the latest of them are needed.
        """
        self._require_fitting(state, entry.step)
        body = entry.as_body()
        if self.ledger.foundation.format > 1:
            since = self.ledger.step if self.ledger.foundation.durability == "relaxed" else entry.step - 1
            body |= {"slot": self.ledger.next_slot, "since": since, "earlier": [e.as_body() for e in earlier]}
        with self._freezing(f"committing step {entry.step}"):
            failpoint("journal.commit.start")
            self._store(body, state)

    def write_ahead(self, state: Floats) -> None:
        """Write the next step's coordinates to its slot, before :meth:`store`; large ones in the background.

        Raises DataLoss as :meth:`store`, if an earlier one failed.

        Parameters
        ----------
        state : (n, d) array, mesh length unit
            Must not be changed before it is stored.
        """
        self._require_fitting(state, self.ledger.step + 1)
        with self._freezing(f"committing step {self.ledger.step + 1}"):
            self._take_ahead()
        slot, large = self.ledger.next_slot, state.nbytes >= _LARGE_STATE

        def write() -> None:
            self._write_state(slot, state)
            failpoint("journal.commit.ahead")
            if large:
                self._files.sync(self._handles[1 + slot])

        self._ahead = state, BackgroundCall(write, worth_a_thread=large)

    def _take_ahead(self) -> Floats | None:
        """Return the coordinates that were written ahead, after their write has ended."""
        if self._ahead is None:
            return None
        (state, written), self._ahead = self._ahead, None
        written.result()
        return state

    def log(self, entry: Commit) -> None:
        """Make a step durable without its coordinates: they can be computed from ``entry.boundary``.

        Raises DataLoss as :meth:`store`.
        """
        self._require_usable()
        with self._freezing(f"committing step {entry.step}"):
            self._append(self._fitting_record(entry.as_body()))

    def snapshot(self, state: Floats) -> None:
        """Store the coordinates (n, d) of the last committed step, ascending by global id, in place of logged commits.

        Raises DataLoss as :meth:`store`.
        """
        last = self.ledger.commits[-1]
        self._require_fitting(state, last.step)
        slot = self.ledger.next_slot
        with self._freezing(f"storing step {last.step}"):
            self._store({"kind": "snapshot", "step": last.step, "digest": last.digest, "slot": slot}, state)

    def _require_fitting(self, state: Floats, step: int) -> None:
        self._require_usable()
        foundation = self.ledger.foundation
        if state.shape != (foundation.nodes, foundation.dimension):
            raise DataLoss(f"the state of step {step} does not fit its slot: {state.shape}", code="INTERNAL")

    def raise_epoch(self) -> int:
        """Fence all earlier holders, durably; return the new epoch. Raises DataLoss as :meth:`store`."""
        self._require_usable()
        with self._freezing("raising the epoch"):
            failpoint("journal.epoch.start")
            self._append(self._fitting_record({"kind": "epoch", "epoch": self.ledger.epoch + 1}))
        return self.ledger.epoch

    def read_state(self) -> Floats:
        """The coordinates (n, d) of the last snapshot, ascending by global id, verified.

        Raises DataLoss: DATA_LOSS.CHECKSUM if they do not match their digest.
        """
        snapshot, foundation = self.ledger.snapshot, self.ledger.foundation
        if snapshot is None:
            raise DataLoss("no state is stored yet", code="INTERNAL")
        raw = self._files.read(self._handles[1 + snapshot.slot], foundation.record_area, foundation.state_bytes)
        return verified_state(raw, self.ledger)

    def close(self) -> None:
        """Close the files; idempotent."""
        if self._ahead is not None:
            self._ahead[1].wait()
        while self._handles:
            self._files.close(self._handles.pop())

    def _open_files(self) -> None:
        for name in (MANIFEST, *SLOTS):
            self._handles.append(self._files.open(self._folder / name))

    def _next_record(self, body: dict[str, object]) -> bytes:
        last = self.ledger.last
        return pack_record(last.sequence + 1, last.checksum, body, self.ledger.foundation.format)

    def _fitting_record(self, body: dict[str, object]) -> bytes:
        """The next record, in another manifest if this one is full."""
        packed = self._next_record(body)
        if self._end + len(packed) > self.ledger.capacity:
            self._start_next_manifest()
            packed = self._next_record(body)
        return packed

    def _store(self, body: dict[str, object], state: Floats) -> None:
        """Store a record and the coordinates that belong to it."""
        ahead = self._take_ahead() is state
        packed = self._fitting_record(body)
        self._write_slot(self.ledger.next_slot, packed, None if ahead else state)
        failpoint("journal.commit.slot-synced")
        self._append(packed)

    def _write_slot(self, slot: int, packed: bytes, state: Floats | None) -> None:
        """Write the record's copy, and the coordinates unless they were written ahead; sync."""
        area = self.ledger.foundation.record_area
        if len(packed) > area:
            raise DataLoss(f"a record for slot {slot} takes {len(packed)} bytes of {area}", code="INTERNAL")
        handle = self._handles[1 + slot]
        write_all(self._files, handle, 0, packed)
        if state is not None:
            self._write_state(slot, state)
        failpoint("journal.commit.slot-unsynced")
        self._files.sync(handle)

    def _write_state(self, slot: int, state: Floats) -> None:
        """Write the coordinates (n, d), without a sync."""
        raw = np.ascontiguousarray(state, dtype="<f8").data.cast("B")
        write_all(self._files, self._handles[1 + slot], self.ledger.foundation.record_area, raw)

    def _append(self, packed: bytes) -> None:
        """Append the record to the manifest and sync it; then update the ledger."""
        if self._end + len(packed) > self.ledger.capacity:
            raise DataLoss(f"a record of {len(packed)} bytes does not fit the manifest", code="INTERNAL")
        self._witness()
        write_all(self._files, self._handles[0], self._end, packed)
        failpoint("journal.record.unsynced")
        self._files.sync(self._handles[0])
        failpoint("journal.record.synced")
        self._advance(verified(packed))

    def _witness(self) -> None:
        """Note, for the next sync, that the last record is durable."""
        if has_witness(self.ledger.foundation):
            write_all(self._files, self._handles[0], self.ledger.capacity, Witness.of(self.ledger.last).pack())

    def _advance(self, record: Record) -> None:
        self.ledger = self.ledger.after(record, KEPT_COMMITS)
        self._end += record.length

    def _start_next_manifest(self) -> None:
        """Replace the full manifest by one that starts with a checkpoint."""
        failpoint("journal.rotate")
        capacity = self.ledger.capacity
        packed = self._next_record(self.ledger.checkpoint_body(capacity))
        replace_manifest(self._folder, self._files, packed, manifest_bytes(self.ledger.foundation, capacity))
        record = verified(packed)
        self._files.close(self._handles[0])
        self._handles[0] = self._files.open(self._folder / MANIFEST)
        self.ledger = Ledger.start(record)
        self._end = record.length
        self._renew_reserve()

    def _settle(self, found: Findings) -> None:
        """Make the content that was read durable, and clean up after a crash; a crash in between is handled likewise.

        The content that was read may be in the page cache only, after a write whose sync failed, and a sync alone would
        not write it again: so the last record and its slot are written again. Slots are cleaned last, because a torn
        manifest is judged by them. Operations that may be refused come first, so that a refusal changes nothing.
        """
        state = self.read_state() if self.ledger.snapshot else None
        self._renew_reserve()
        again = found.completion or found.records[-1:]
        packed = b"".join(pack_record(r.sequence, r.previous, r.body, r.format) for r in again)
        self._files.sync_folder(self._folder)
        slot = slot_of(again[-1])
        if slot is not None:
            self._write_slot(slot, packed[-again[-1].length :], state)
        start = found.end if found.completion else found.end - len(packed)
        self._end = start + len(packed)
        rest = bytes(self.ledger.capacity - self._end) if found.torn else b""
        write_all(self._files, self._handles[0], start, packed + rest)
        self._files.sync(self._handles[0])
        failpoint("journal.settle.record")
        if has_witness(self.ledger.foundation):
            self._witness()
            self._files.sync(self._handles[0])
        for number in found.dirty_slots:
            write_all(self._files, self._handles[1 + number], 0, bytes(self.ledger.foundation.record_area))
            self._files.sync(self._handles[1 + number])
        if found.torn and not found.completion:
            # the torn record may be an epoch that was answered
            self.ledger = replace(self.ledger, epoch=self.ledger.epoch + 1)
        failpoint("journal.settle.done")

    def _renew_reserve(self) -> None:
        """Reserve the space of the next manifest; without space, the session continues as long as it can."""
        try:
            reserve(self._folder, self._files, manifest_bytes(self.ledger.foundation, self.ledger.capacity))
        except OSError:
            self._files.remove(self._folder / NEXT_MANIFEST)

    def _require_usable(self) -> None:
        if self.frozen:
            raise DataLoss(
                "the journal is frozen since an earlier operation failed",
                code="RESOURCE_EXHAUSTED.DISK",
                hint="check the disk, then resume the session",
            )

    @contextmanager
    def _freezing(self, doing: str) -> Iterator[None]:
        """Freeze after any error, because then the content of the disk is unknown."""
        try:
            yield
        except BaseException as error:
            self.frozen = True
            if not isinstance(error, OSError):
                raise
            hint = "check the disk, then resume the session"
            raise disk_failure(DataLoss, doing, error, "; nothing more is written", hint) from error
