"""Reads the data for a replay from a stored session's folder: mesh, settings, boundary motion and results."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from mesh_motion_numerics.arrays import Floats
from mesh_motion_protocol.errors import DataLoss, InvalidInput

from mesh_motion_server.session.history.boundary import BoundaryLog
from mesh_motion_server.session.history.events import read_events
from mesh_motion_server.session.journal.files import read_ledger, read_stored_state
from mesh_motion_server.session.journal.filesystem import PosixFileSystem
from mesh_motion_server.session.journal.ledger import Ledger
from mesh_motion_server.session.journal.mesh_store import MESH, read_mesh
from mesh_motion_server.session.partitions.merging import merge
from mesh_motion_server.session.partitions.numbering import UploadView, upload_view
from mesh_motion_server.session.spec import StoredSpec, spec_bytes
from mesh_motion_server.watch.observation.series import Columns, Series, of_metric


@dataclass(frozen=True, eq=False)
class Recorded:
    """The data of a stored session for a replay."""

    folder: Path
    spec: StoredSpec
    mesh: UploadView  # nodes ascending by global id, as one partition
    log: BoundaryLog
    #: (s,) each. The committed steps whose events still exist, as in :class:`Series`; their quality is
    #: size-skew.
    columns: Columns
    digests: dict[int, bytes]  # of their states
    #: list of (int, str). First step, and the versions and processor that computed the steps from there on; an empty
    #: text if unknown.
    makers: list[tuple[int, str]]
    notes: list[str]  # the parts that cannot be replayed, with the reasons
    #: (int, (n, d) array) or None. The step whose coordinates are stored, and the coordinates; mesh length unit.
    stored: tuple[int, Floats] | None
    #: (n, d). Velocities at that step, mesh length unit per second: those of "bossak", or the difference
    #: of the last two levels of "bdf2".
    velocity: Floats | None

    def digest(self, step: int) -> bytes:
        """State digest of a recorded step; empty if unknown, or if it also includes unknown time levels."""
        if self.spec.time_levels and not self.log.timed:
            return b""
        return self.log.digest(step) or self.digests.get(step, b"")


def read_recorded(folder: Path) -> Recorded:
    """Read a session's folder or a copy of it, without changing it.

    Raises InvalidInput if the boundary motion is not recorded from step 1 on, or the cells are with the client. Raises
    DataLoss if the folder is not a session folder, or the data for a replay does not verify.
    """
    spec = StoredSpec.from_bytes(spec_bytes(folder))
    spec.require_cells()
    log = BoundaryLog(folder)
    if not log.steps:
        raise InvalidInput(
            f"{folder}: the motion of the boundary is not recorded from step 1 on, so nothing can be replayed",
            hint="the server's setting history_bytes must not be 0 when a session is opened",
        )
    files = PosixFileSystem()
    ledger = read_ledger(folder, files)  # only the chain: a copy of an active session may end inside a commit
    notes = list(_cut(log, ledger))
    if not log.steps:
        raise InvalidInput(f"{folder}: nothing can be replayed: {notes[-1]}")
    columns, digests = _steps(folder)
    if spec.time_levels and not log.timed:
        notes.append("digests include the time levels, but times are not recorded: only coordinates are compared")
    mesh = upload_view(merge(read_mesh(folder / MESH, files, ledger.foundation.mesh)))
    state = _stored(folder, files, ledger)
    return Recorded(
        folder=folder,
        spec=spec,
        mesh=mesh,
        log=log,
        columns=columns,
        digests=digests,
        makers=log.makers,
        notes=notes,
        stored=None if state is None else (state[0], state[1][: len(mesh.points)]),
        velocity=None if state is None else _velocity(*state, len(mesh.points), spec, log),
    )


def _stored(folder: Path, files: PosixFileSystem, ledger: Ledger) -> tuple[int, Floats] | None:
    """The stored state; None if it does not verify. It is used only to measure the distance of two runs."""
    try:
        return read_stored_state(folder, files, ledger)
    except DataLoss:
        return None


def _velocity(step: int, state: Floats, nodes: int, spec: StoredSpec, log: BoundaryLog) -> Floats | None:
    """Velocities (n, d) from the stored ``state`` of a step; None without time levels."""
    now, before = log.time(step), spec.time if step == 1 else log.time(step - 1)
    if not spec.time_levels or now is None or before is None:
        return None
    points, level = state[:nodes], state[nodes : 2 * nodes]
    return level if spec.time_levels == "bossak" else difference_velocity(points, level, now - before)


def difference_velocity(points: Floats, before: Floats, seconds: float) -> Floats:
    """(n, d) mean velocities between two positions (n, d)."""
    return np.asarray((points - before) / seconds)


def _cut(log: BoundaryLog, ledger: Ledger) -> Iterator[str]:
    """Cut the log after the last verified step of the session; yield the reasons."""
    log.cut(max(log.committed, ledger.step))
    known = [entry for entry in ledger.commits if log.digest(entry.step)]
    wrong = next((n for n, entry in enumerate(known) if log.digest(entry.step) != entry.digest), None)
    if wrong is not None:
        log.cut(known[wrong - 1].step if wrong else 0)
        yield f"the steps from {known[wrong].step} on were repeated while no history was recorded"
    verified = log.verified()
    if verified < log.steps:
        log.cut(verified)
        yield f"the recorded motion of the boundary in step {verified + 1} has a wrong checksum"


def _steps(folder: Path) -> tuple[Columns, dict[int, bytes]]:
    """The committed steps as columns with size-skew quality, and the digests of their states, from the events."""
    series, digests = Series(), {}
    for event in read_events(folder):
        is_commit = event["event"] == "committed"
        series.add(of_metric(event, "size-skew") if is_commit else event)  # some Moves lack metrics
        if is_commit:
            digests[event["step"]] = bytes.fromhex(event["digest"])
    return series.columns(), digests
