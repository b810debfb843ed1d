"""What a stored session's folder has for a replay: mesh, settings, what the boundary did, and what came of it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mesh_motion_server.errors import InvalidInput, JournalError
from mesh_motion_server.session.history.boundary import BoundaryLog
from mesh_motion_server.session.history.events import read_events
from mesh_motion_server.session.journal.files import read_ledger, read_stored_state
from mesh_motion_server.session.journal.filesystem import PosixFileSystem
from mesh_motion_server.session.journal.ledger import Ledger
from mesh_motion_server.session.journal.mesh_store import read_mesh
from mesh_motion_server.session.listing import SPEC
from mesh_motion_server.session.partitions.merging import merge
from mesh_motion_server.session.partitions.numbering import UploadView, upload_view
from mesh_motion_server.session.spec import StoredSpec
from mesh_motion_server.watch.observation.fold import StepFold, is_corrected
from mesh_motion_server.watch.observation.series import PHASES

__all__ = ["Recorded", "StepFigures", "read_recorded"]

FloatArray = NDArray[np.float64]


@dataclass
class StepFigures:
    """What a step came to, as it was recorded or replayed.

    Attributes
    ----------
    step : int
    min_quality, mean_quality : float
        Size-skew of the committed coordinates; NaN where it was not told.
    standard_min, predicted_min : float
        The session's metric, as predicted without and with the correction, of the Move that was committed.
    moves, refusals : int
        Of the step.
    corrected : bool
        Whether the Move that was committed was.
    enrichment_points, freed_nodes : int
    seconds : dict
        By phase, of all its Moves.
    seconds_total : float
        Of all its Moves, in the server.
    digest : bytes
        Of the committed state, empty where it is not known.
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
        """One more Move of the step, as MOVED tells of it."""
        self.moves += 1
        self.standard_min = _number(quality["standard"].get("metric", {}).get("min"))
        self.predicted_min = _number(quality["corrected"].get("metric", {}).get("min"))
        self.corrected = is_corrected(correction)
        self.enrichment_points, self.freed_nodes = correction["enrichment_points"], correction["freed_nodes"]
        for phase in PHASES:
            self.seconds[phase] += seconds.get(phase, 0.0)
        self.seconds_total += seconds.get("total", sum(seconds.get(phase, 0.0) for phase in PHASES))

    def take_commit(self, quality: dict[str, Any], digest: bytes) -> None:
        """Its commit, as COMMITTED tells of it."""
        distribution = quality.get("size_skew", quality.get("metric", {}))
        self.min_quality, self.mean_quality = _number(distribution.get("min")), _number(distribution.get("mean"))
        self.digest = digest


@dataclass(frozen=True, eq=False)
class Recorded:
    """A stored session, as far as a replay needs it.

    Attributes
    ----------
    folder : Path
    spec : StoredSpec
    mesh : UploadView
        Nodes ascending by global id, as one partition.
    log : BoundaryLog
    figures : dict
        Step → what it came to, of the steps whose events are still there.
    makers : list of (int, str)
        From which step on what computed it, versions and processor; empty text where it is not known.
    notes : list of str
        What of it cannot be replayed, and why.
    stored : (int, (n, d) array) or None
        The step whose coordinates are stored, and these; mesh length unit.
    """

    folder: Path
    spec: StoredSpec
    mesh: UploadView
    log: BoundaryLog
    figures: dict[int, StepFigures]
    makers: list[tuple[int, str]]
    notes: list[str]
    stored: tuple[int, FloatArray] | None

    def digest(self, step: int) -> bytes:
        """State digest of a recorded step, empty where it is not known."""
        return self.log.digest(step) or self.figures.get(step, StepFigures(step)).digest


def read_recorded(folder: Path) -> Recorded:
    """Read a session's folder, or a copy of one; nothing is changed.

    Raises
    ------
    InvalidInput
        If what the boundary did is not recorded from step 1 on.
    JournalError
        If the folder is no session's, or what a replay needs does not verify.
    """
    spec = _spec(folder)
    log = BoundaryLog(folder)
    if not log.steps:
        raise InvalidInput(
            f"{folder}: what the boundary did is not recorded from step 1 on, so nothing can be replayed",
            hint="the server's setting history_bytes must not be 0 when a session is opened",
        )
    files = PosixFileSystem()
    ledger = read_ledger(
        folder, files
    )  # the chain alone: a copy of a session at work may end in the middle of a commit
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


def _spec(folder: Path) -> StoredSpec:
    try:
        return StoredSpec.from_bytes((folder / SPEC).read_bytes())
    except OSError as error:
        raise JournalError(
            f"{folder} is no session's folder: {error.strerror or error}",
            hint="give a folder below STATE FOLDER/sessions, or a copy of one",
        ) from error


def _stored(folder: Path, files: PosixFileSystem, ledger: Ledger) -> tuple[int, FloatArray] | None:
    """The stored coordinates, None where they do not verify: they say how far apart two runs are, no more."""
    try:
        return read_stored_state(folder, files, ledger)
    except JournalError:
        return None


def _cut(log: BoundaryLog, ledger: Ledger) -> Iterator[str]:
    """Let the log end where the session's own, verified steps do; says why it is shorter than it looks."""
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
    """What the events say of each committed step."""
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


def _number(value: float | None) -> float:
    return np.nan if value is None else float(value)
