"""The motion of the boundary, step by step: the data that a replay needs in addition to the mesh and the settings.

A segment is a sequence of records, little-endian, each with a head of 40 bytes and a body::

    0   4  "MMBH"
    4   4  CRC-32 of all that follows
    8   8  bytes of the body
    16  8  step
    24  4  kind: 1 input, 2 outcome, 3 maker, 4 taken up, 5 time
    28  4  frame of an input: 0 committed, 1 reference
    32  8  bytes a row of an input: 8 d

The body of an input contains the displacements of the moving nodes in the frame, doubles, ascending by global id.
The body of an outcome is the state digest of the committed step. The body of a maker names the versions and the
processor that compute the steps from here on, in UTF-8. "Taken up" has no body: the session continues at that step, and
a crash lost the later steps of the log. The body of a time is the time of the step, a double, seconds; a step without a
time has no such record. An input and its time are written before the commit and the outcome after it: so every answered
step has its input, and the last input of a step is the valid one.
"""

import os
import struct
import zlib
from array import array
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from mesh_motion_numerics.arrays import Floats
from mesh_motion_protocol.errors import DataLoss

from mesh_motion_server.session.history.events import FOLDER
from mesh_motion_server.session.history.segments import list_segments

BOUNDARY = "boundary"
FRAMES = ("committed", "reference")

_HEAD = struct.Struct("<4sIQQIIQ")
_MAGIC = b"MMBH"
_INPUT, _OUTCOME, _MAKER, _TAKEN_UP, _TIME = 1, 2, 3, 4, 5
_SECONDS = struct.Struct("<d")
#: Number of bits of a record's place that hold its offset.
_OFFSET_BITS = 40
#: Place of a step without a record; valid places are not negative.
_NOWHERE = -1


@dataclass(frozen=True, eq=False)
class BoundaryStep:
    """The boundary's motion in one committed step."""

    step: int
    frame: str  # {"committed", "reference"}
    rows: Floats  # (k, d), mesh length unit. Displacements of the moving nodes, ascending by global id
    digest: bytes = b""  # state digest of the committed step; empty if it is not known
    time: float | None = None  # time of the step, seconds; None if it is not known


@dataclass(frozen=True, slots=True)
class _Head:
    """A record's head, and begin and end of its body."""

    checksum: int
    step: int
    kind: int
    frame: int
    row_bytes: int
    begin: int
    end: int
    checked: bytes


class BoundaryLog:
    """The steps of a session's boundary log, read one at a time.

    Attributes
    ----------
    steps : int
        The log has the steps 1 … ``steps`` without a gap.
    committed : int
        The last step that is known to be committed.
    makers : list of (int, str)
        Pairs of a first step and the versions and processor that computed the steps from there on; the text is empty if
        unknown.
    """

    def __init__(self, session_folder: Path) -> None:
        self._paths = list_segments(session_folder / FOLDER, BOUNDARY)
        # by step - 1: see _place; millions of steps fit
        self._inputs, self._outcomes, self._times = array("q"), array("q"), array("q")
        self._maker = ""
        self.makers: list[tuple[int, str]] = []
        for number, path in enumerate(self._paths):
            with suppress(FileNotFoundError), _opened(path) as handle:
                for head in _heads(handle):
                    self._take(handle, head, _place(number, head))
        self.steps = len(self._inputs)

    @property
    def committed(self) -> int:
        step = self.steps
        while step and self._outcomes[step - 1] == _NOWHERE:
            step -= 1
        return step

    def cut(self, last: int) -> None:
        """Ignore the steps after ``last``."""
        self.steps = min(self.steps, last)

    def verified(self) -> int:
        """Number of steps, from 1 on, that verify; reads all of them."""
        for step in range(1, self.steps + 1):
            try:
                self.read(step)
            except DataLoss:
                return step - 1
        return self.steps

    def read(self, step: int) -> BoundaryStep:
        """Read one step. Raises DataLoss if the step does not verify, or its record was removed meanwhile."""
        place = self._inputs[step - 1]
        found = self._record(place)
        if found is None or found[0].row_bytes < 8:
            raise DataLoss(
                f"{self._paths[place >> _OFFSET_BITS]}: the recorded motion of the boundary in step {step} "
                "has a wrong checksum",
                hint=f"replay the steps before it: --until {step - 1}",
                details={"step": step},
            )
        head, body = found
        rows = np.frombuffer(body, dtype="<f8").astype(np.float64, copy=False)
        frame = FRAMES[min(head.frame, 1)]
        return BoundaryStep(step, frame, rows.reshape(-1, head.row_bytes // 8), self.digest(step), self.time(step))

    def digest(self, step: int) -> bytes:
        """State digest of a committed step; empty if it is not known."""
        return self._body(self._outcomes, step)

    def time(self, step: int) -> float | None:
        """Time of a step, seconds; None if it is not known."""
        body = self._body(self._times, step)
        return float(_SECONDS.unpack(body)[0]) if len(body) == _SECONDS.size else None

    @property
    def timed(self) -> bool:
        """Whether the time of each step is known."""
        return _NOWHERE not in self._times[: self.steps]

    def _body(self, places: "array[int]", step: int) -> bytes:
        """Body of a step's record of a kind; empty if there is none, or if it does not verify."""
        known = 0 < step <= len(places) and places[step - 1] != _NOWHERE
        found = self._record(places[step - 1]) if known else None
        return found[1] if found else b""

    def _record(self, place: int) -> tuple[_Head, bytes] | None:
        """A record's head and body; None if it does not verify, or was removed meanwhile."""
        with suppress(FileNotFoundError), _opened(self._paths[place >> _OFFSET_BITS]) as handle:
            for head in _heads(handle, place & ((1 << _OFFSET_BITS) - 1)):
                body = _verified(handle, head)
                return None if body is None else (head, body)
        return None

    def _take(self, handle: int, head: _Head, place: int) -> None:
        if head.kind in (_OUTCOME, _TIME):
            places = self._outcomes if head.kind == _OUTCOME else self._times
            if 0 < head.step <= len(self._inputs) and _verified(handle, head):
                places[head.step - 1] = place
        elif head.kind == _MAKER:
            self._maker = (_verified(handle, head) or b"").decode("utf-8", "replace")
        elif head.kind == _TAKEN_UP:
            if _verified(handle, head) is not None:
                self._drop(head.step + 1)
        elif head.kind == _INPUT and 0 < head.step <= len(self._inputs) + 1:  # otherwise there is a gap before it
            self._drop(head.step)
            self._inputs.append(place)
            self._outcomes.append(_NOWHERE)
            self._times.append(_NOWHERE)
            if not self.makers or self.makers[-1][1] != self._maker:
                self.makers.append((head.step, self._maker))

    def _drop(self, first: int) -> None:
        """Drop steps from before a restart that are not in the journal."""
        del self._inputs[first - 1 :], self._outcomes[first - 1 :], self._times[first - 1 :]
        self.makers = [change for change in self.makers if change[0] < first]


def pack_input(step: int, frame: str, rows: bytes, row_bytes: int) -> bytes:
    """Make the record of a commit's input; ``rows`` are doubles, ``row_bytes`` of them per node."""
    return _pack(step, _INPUT, FRAMES.index(frame), row_bytes, rows)


def pack_time(step: int, time: float) -> bytes:
    """Make the record of the time of a step, seconds."""
    return _pack(step, _TIME, 0, 0, _SECONDS.pack(time))


def pack_outcome(step: int, digest: bytes) -> bytes:
    """Make the record of the state digest of a committed step."""
    return _pack(step, _OUTCOME, 0, 0, digest)


def pack_maker(step: int, maker: str) -> bytes:
    """Make the record with the maker of the steps from this one on."""
    return _pack(step, _MAKER, 0, 0, maker.encode())


def pack_taken_up(step: int) -> bytes:
    """Make the record of a session that continues at a committed step."""
    return _pack(step, _TAKEN_UP, 0, 0, b"")


def digest_at(session_folder: Path, step: int) -> bytes:
    """The latest recorded state digest of a step; empty if there is none, or if its input was replaced.

    A worker calls this at each RESUME. It reads the heads one at a time, because a list of all heads of a segment would
    need more memory than most other data of the worker.

    """
    digest = b""
    for path in reversed(list_segments(session_folder / FOLDER, BOUNDARY)):
        with _opened(path) as handle:
            begun, found = _outcome_in(handle, step)
        digest = digest or found
        if begun is not None:
            return digest if begun == step else b""
    return b""


def _outcome_in(handle: int, step: int) -> tuple[int | None, bytes]:
    """The step at which the last input or "taken up" of a segment starts, and the digest of ``step`` after it."""
    begun: int | None = None
    digest = b""
    for head in _heads(handle):
        if head.step > step:
            continue
        if head.kind == _OUTCOME and head.step == step:
            digest = _verified(handle, head) or digest
        elif head.kind == _INPUT or (head.kind == _TAKEN_UP and head.step < step):
            begun, digest = head.step, b""
    return begun, digest


def cut_torn_record(handle: int) -> None:
    """Cut off an incomplete last record that a crash left in a segment."""
    end = max((head.end for head in _heads(handle)), default=0)
    if os.fstat(handle).st_size > end:
        os.ftruncate(handle, end)


def _pack(step: int, kind: int, frame: int, row_bytes: int, body: bytes) -> bytes:
    head = _HEAD.pack(_MAGIC, 0, len(body), step, kind, frame, row_bytes)[8:]
    checksum = zlib.crc32(body, zlib.crc32(head))
    return b"".join((_MAGIC, checksum.to_bytes(4, "little"), head, body))


def _verified(handle: int, head: _Head) -> bytes | None:
    """A record's body; None if it does not verify."""
    body = os.pread(handle, head.end - head.begin, head.begin)
    return body if zlib.crc32(body, zlib.crc32(head.checked)) == head.checksum else None


@contextmanager
def _opened(path: Path) -> Iterator[int]:
    handle = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    try:
        yield handle
    finally:
        os.close(handle)


def _place(number: int, head: _Head) -> int:
    """The place of a record: the segment's number and the offset in it as one integer."""
    return number << _OFFSET_BITS | head.begin - _HEAD.size


def _heads(handle: int, offset: int = 0) -> Iterator[_Head]:
    """The heads of all complete records, from an offset on; bodies are not read."""
    size = os.fstat(handle).st_size
    while len(raw := os.pread(handle, _HEAD.size, offset)) == _HEAD.size:
        magic, checksum, length, step, kind, frame, row_bytes = _HEAD.unpack(raw)
        begin, offset = offset + _HEAD.size, offset + _HEAD.size + length
        if magic != _MAGIC or offset > size:
            return
        yield _Head(checksum, step, kind, frame, row_bytes, begin, offset, raw[8:])
