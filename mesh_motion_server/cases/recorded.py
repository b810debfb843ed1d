"""Read what a replay needs from a stored session's folder: mesh, settings, boundary motion and results."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from mesh_motion_server.errors import InvalidInput, JournalError
from mesh_motion_server.numerics.arrays import Floats
from mesh_motion_server.session.history.boundary import BoundaryLog
from mesh_motion_server.session.history.events import read_events
from mesh_motion_server.session.journal.files import read_ledger, read_stored_state
from mesh_motion_server.session.journal.filesystem import PosixFileSystem
from mesh_motion_server.session.journal.ledger import Ledger
from mesh_motion_server.session.journal.mesh_store import read_mesh
from mesh_motion_server.session.partitions.merging import merge
from mesh_motion_server.session.partitions.numbering import UploadView, upload_view
from mesh_motion_server.session.spec import StoredSpec, spec_bytes
from mesh_motion_server.watch.observation.fold import StepFold, is_corrected, number_of
from mesh_motion_server.watch.observation.series import PHASES

__all__ = ["Recorded", "StepFigures", "read_recorded"]


@dataclass
class StepFigures:
    """The results of a step, recorded or replayed.

    Attributes
    ----------
    min_quality, mean_quality : float
        Size-skew of the committed coordinates; NaN if not recorded.
    standard_min, predicted_min : float
        Minimum of the session's metric, predicted without and with the correction for the committed Move.
    moves, refusals : int
        Numbers of Moves and refusals in the step.
    corrected : bool
        Whether the committed Move was corrected.
    seconds : dict
        Seconds by phase, summed over all Moves of the step.
    seconds_total : float
        Server seconds, summed over all Moves of the step.
    digest : bytes
        Digest of the committed state; empty if unknown.
    """

    step: int
    min_quality: float = np.nan
    mean_quality: float = np.nan
    standard_min: float = np.nan
    predicted_min: float = np.nan
    moves: int = 0
    refusals: int = 0
    corrected: bool = False
    enrichment_points: int = 0
    freed_nodes: int = 0
    seconds: dict[str, float] = field(default_factory=lambda: dict.fromkeys(PHASES, 0.0))
    seconds_total: float = 0.0
    digest: bytes = b""

    def take_motion(self, quality: dict[str, Any], correction: dict[str, Any], seconds: dict[str, float]) -> None:
        """Add a Move of the step, as reported by MOVED."""
        self.moves += 1
        self.standard_min = number_of(quality["standard"].get("metric", {}).get("min"))
        self.predicted_min = number_of(quality["corrected"].get("metric", {}).get("min"))
        self.corrected = is_corrected(correction)
        self.enrichment_points, self.freed_nodes = correction["enrichment_points"], correction["freed_nodes"]
        for phase in PHASES:
            self.seconds[phase] += seconds.get(phase, 0.0)
        self.seconds_total += seconds.get("total", sum(seconds.get(phase, 0.0) for phase in PHASES))

    def take_commit(self, quality: dict[str, Any], digest: bytes) -> None:
        """Add the commit of the step, as reported by COMMITTED."""
        distribution = quality.get("size_skew", quality.get("metric", {}))
        self.min_quality, self.mean_quality = number_of(distribution.get("min")), number_of(distribution.get("mean"))
        self.digest = digest


@dataclass(frozen=True, eq=False)
class Recorded:
    """A stored session, as far as a replay needs it.

    Attributes
    ----------
    mesh : UploadView
        Nodes ascending by global id, as one partition.
    figures : dict
        Results by step, for the steps whose events still exist.
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
    figures: dict[int, StepFigures]
    makers: list[tuple[int, str]]
    notes: list[str]
    stored: tuple[int, Floats] | None

    def digest(self, step: int) -> bytes:
        """State digest of a recorded step; empty if unknown."""
        return self.log.digest(step) or self.figures.get(step, StepFigures(step)).digest


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
    notes = list(_cut(log, ledger))
    if not log.steps:
        raise InvalidInput(f"{folder}: nothing can be replayed: {notes[-1]}")
    return Recorded(
        folder=folder,
        spec=spec,
        mesh=upload_view(merge(read_mesh(folder / "mesh.bin", files, ledger.foundation.mesh))),
        log=log,
        figures=_figures(folder),
        makers=log.makers,
        notes=notes,
        stored=_stored(folder, files, ledger),
    )


def _stored(folder: Path, files: PosixFileSystem, ledger: Ledger) -> tuple[int, Floats] | None:
    """The stored coordinates; None if they do not verify. They only serve to measure the distance of two runs."""
    try:
        return read_stored_state(folder, files, ledger)
    except JournalError:
        return None


def _cut(log: BoundaryLog, ledger: Ledger) -> Iterator[str]:
    """Cut the log after the last verified step of the session; yield the reasons for the cut."""
    log.cut(max(log.committed, ledger.step))
    known = [entry for entry in ledger.commits if log.digest(entry.step)]
    wrong = next((n for n, entry in enumerate(known) if log.digest(entry.step) != entry.digest), None)
    if wrong is not None:
        log.cut(known[wrong - 1].step if wrong else 0)
        yield f"the steps from {known[wrong].step} on were made again, while no history was kept"
    verified = log.verified()
    if verified < log.steps:
        log.cut(verified)
        yield f"what the boundary did in step {verified + 1} does not verify"


def _figures(folder: Path) -> dict[int, StepFigures]:
    """The figures of each committed step, from the events."""
    found: dict[int, StepFigures] = {}
    current, fold = StepFigures(1), StepFold()
    for event in read_events(folder):
        name, place = event["event"], fold.take(event)
        if place.is_fresh:
            current = StepFigures(place.step)
        while place.undone and found and next(reversed(found)) >= place.undone:
            found.popitem()
        if name == "moved":
            current.take_motion(event["quality"], event["correction"], event["seconds"])
        elif name == "refused":
            current.refusals += 1
        elif name == "committed":
            current.step = event["step"]
            current.take_commit(event["quality"], bytes.fromhex(event["digest"]))
            found[current.step], current = current, StepFigures(current.step + 1)
    return found
