"""Read what a replay needs from a stored session's folder: mesh, settings, boundary motion and results."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from mesh_motion_server.errors import InvalidInput, JournalError
from mesh_motion_server.numerics.arrays import Floats
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

__all__ = ["Recorded", "read_recorded"]


@dataclass(frozen=True, eq=False)
class Recorded:
    """A stored session, as far as a replay needs it.

    Attributes
    ----------
    mesh : UploadView
        Nodes ascending by global id, as one partition.
    columns : dict of str to (s,) arrays
        The committed steps whose events still exist, as in :class:`Series`; their quality is size-skew.
    digests : dict of int to bytes
        Of their states.
    makers : list of (int, str)
        First step, and the versions and processor that computed from it on; an empty text if unknown.
    notes : list of str
        What cannot be replayed, and why.
    stored : (int, (n, d) array) or None
        The step whose coordinates are stored, and the coordinates; mesh length unit.
    """

    folder: Path
    spec: StoredSpec
    mesh: UploadView
    log: BoundaryLog
    columns: Columns
    digests: dict[int, bytes]
    makers: list[tuple[int, str]]
    notes: list[str]
    stored: tuple[int, Floats] | None

    def digest(self, step: int) -> bytes:
        """State digest of a recorded step; empty if unknown, or if it is also that of time levels."""
        if self.spec.time_levels:
            return b""
        return self.log.digest(step) or self.digests.get(step, b"")


def read_recorded(folder: Path) -> Recorded:
    """Read a session's folder or a copy of it, without changing it.

    Raises
    ------
    InvalidInput
        If the boundary motion is not recorded from step 1 on, or the cells are with the client.
    JournalError
        If the folder is not a session folder, or the data for a replay does not verify.
    """
    spec = StoredSpec.from_bytes(spec_bytes(folder))
    spec.require_cells()
    log = BoundaryLog(folder)
    if not log.steps:
        raise InvalidInput(
            f"{folder}: what the boundary did is not recorded from step 1 on, so nothing can be replayed",
            hint="the server's setting history_bytes must not be 0 when a session is opened",
        )
    files = PosixFileSystem()
    ledger = read_ledger(folder, files)  # only the chain: a copy of an active session may end in the middle of a commit
    notes = list(_cut(log, ledger, spec.time_levels))
    if not log.steps:
        raise InvalidInput(f"{folder}: nothing can be replayed: {notes[-1]}")
    columns, digests = _steps(folder)
    mesh = upload_view(merge(read_mesh(folder / MESH, files, ledger.foundation.mesh)))
    return Recorded(
        folder=folder,
        spec=spec,
        mesh=mesh,
        log=log,
        columns=columns,
        digests=digests,
        makers=log.makers,
        notes=notes,
        stored=_stored(folder, files, ledger, len(mesh.points)),
    )


def _stored(folder: Path, files: PosixFileSystem, ledger: Ledger, nodes: int) -> tuple[int, Floats] | None:
    """The stored coordinates; None if they do not verify. They only serve to measure the distance of two runs."""
    try:
        stored = read_stored_state(folder, files, ledger)
        return None if stored is None else (stored[0], stored[1][:nodes])  # without earlier time levels
    except JournalError:
        return None


def _cut(log: BoundaryLog, ledger: Ledger, levels: str) -> Iterator[str]:
    """Cut the log after the last verified step of the session; yield the reasons, and what is not compared."""
    log.cut(max(log.committed, ledger.step))
    known = [entry for entry in ledger.commits if log.digest(entry.step)]
    wrong = next((n for n, entry in enumerate(known) if log.digest(entry.step) != entry.digest), None)
    if wrong is not None:
        log.cut(known[wrong - 1].step if wrong else 0)
        yield f"the steps from {known[wrong].step} on were made again, while no history was kept"
    if levels:
        yield "digests are also those of time levels, and times are not recorded: only coordinates are compared"
    verified = log.verified()
    if verified < log.steps:
        log.cut(verified)
        yield f"what the boundary did in step {verified + 1} does not verify"


def _steps(folder: Path) -> tuple[Columns, dict[int, bytes]]:
    """The committed steps as columns, their quality as size-skew, and the digests of their states, from the events."""
    series, digests = Series(), {}
    for event in read_events(folder):
        is_commit = event["event"] == "committed"
        series.add(of_metric(event, "size-skew") if is_commit else event)  # not every Move has all metrics
        if is_commit:
            digests[event["step"]] = bytes.fromhex(event["digest"])
    return series.columns(), digests
