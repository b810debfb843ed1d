"""States that were logged instead of stored: logs the input of a Move, and recomputes states from it.

The recomputation must give the digest that was journaled, bit for bit, or nothing is opened. It is the same function of
the same bytes, so it succeeds on the same machine with the same software. Another version of the server or of its
numerical libraries, or a processor for which these choose other instructions, may round differently. Threads, caches
and coupling iterations before the committed one do not matter. The log names the versions and the processor of each
step, and a session that was closed needs no recomputation (``journal.durability``).
"""

import platform
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache
from importlib import metadata
from pathlib import Path

import msgpack
import numpy as np
from mesh_motion_numerics.arrays import Floats
from mesh_motion_numerics.motion.time_levels import STORED_ARRAYS, TimeLevel
from mesh_motion_protocol.digests import state_digest
from mesh_motion_protocol.errors import DataLoss, MeshMotionError

from mesh_motion_server import __version__
from mesh_motion_server.session.factors import FactorCache
from mesh_motion_server.session.journal.journal import Journal
from mesh_motion_server.session.journal.ledger import BoundaryInput, Commit
from mesh_motion_server.session.model import Model
from mesh_motion_server.session.motions import compute
from mesh_motion_server.session.partitions.meshes import MergedMesh
from mesh_motion_server.session.spec import StoredSpec
from mesh_motion_server.session.state import CommittedState, MoveInput, Trial, durable_rows, state_after

Progress = Callable[[int], None]
#: States whose recomputation took longer than this are stored, seconds.
_LONG_SECONDS = 10.0
#: Largest difference of a field's coefficients between versions, as a share of the largest coefficient.
_ROUNDING = 1e-5


def silent(_step: int) -> None:
    """Ignore the progress."""


def boundary_input(mesh: MergedMesh, move_input: MoveInput) -> BoundaryInput:
    """The input of a Move that is logged."""
    rows = np.ascontiguousarray(move_input.boundary_displacement[mesh.moving_by_id], dtype="<f8")
    return BoundaryInput(move_input.frame, rows.tobytes(), maker())


def restore(
    journal: Journal,
    model: Model,
    mesh: MergedMesh,
    factors: FactorCache,
    rest: CommittedState,
    progress: Progress = silent,
    *,
    spec: StoredSpec,
) -> CommittedState:
    """The last committed state of a journal, read or computed; ``rest`` is the state of the uploaded mesh.

    A state that took long to compute is stored at once: otherwise a worker that dies repeatedly would have more work
    each time. Raises DataLoss if the state does not verify; and as :func:`recompute`.
    """
    snapshot = journal.ledger.snapshot
    stored = rest
    if snapshot is not None:
        rows, n = journal.read_state(), len(mesh.points)
        count = 1 + STORED_ARRAYS[spec.time_levels]
        points, *arrays = (_in_canonical_order(rows[i * n : (i + 1) * n], mesh) for i in range(count))
        coefficients = None if rest.coefficients is None else rows[n:]
        stored = CommittedState(snapshot.step, points, coefficients)
        _check_field(stored, model, mesh, factors)
        answered = next((commit for commit in journal.ledger.commits if commit.step == snapshot.step), None)
        times = (None, None) if answered is None else _times(answered)
        stored = replace(stored, level=TimeLevel(*times, tuple(arrays)))
    began = time.monotonic()
    found = recompute(model, mesh, factors, stored, journal.ledger.logged, progress, time_levels=spec.time_levels)
    if time.monotonic() - began > _LONG_SECONDS:
        journal.snapshot(durable_rows(mesh, found))
    return found if rest.coefficients is None else replace(found, corrected=_was_corrected(journal.ledger.commits))


def _in_canonical_order(rows: Floats, mesh: MergedMesh) -> Floats:
    """(n, d) read-only rows that were stored ascending by global id."""
    found = np.empty_like(mesh.points)
    found[mesh.id_order] = rows
    found.flags.writeable = False
    return found


def _was_corrected(commits: Sequence[Commit]) -> bool:
    """Whether the answer to the last commit says that the mesh was corrected."""
    return bool(commits) and bool(msgpack.unpackb(commits[-1].receipt).get("corrected", False))


def _times(commit: Commit) -> tuple[float | None, float | None]:
    """The times of a step and of the one before, if their COMMITs had them."""
    time, previous = msgpack.unpackb(commit.receipt).get("times", (None, None))
    return time, previous


def _check_field(stored: CommittedState, model: Model, mesh: MergedMesh, factors: FactorCache) -> None:
    """Check that stored coefficients are those of the field that this version describes, up to rounding.

    Raises DataLoss: DATA_LOSS.RECOVERY_DIVERGED.
    """
    if stored.coefficients is None:
        return
    moving = mesh.moving
    reached = MoveInput("reference", stored.points[moving] - mesh.points[moving])
    field = compute(model, mesh, mesh.points, reached, factors).field
    known = stored.coefficients
    if field is None or field.coefficients.shape != known.shape or not _near(field.coefficients, known):
        raise DataLoss(
            f"the field of step {stored.step} was computed in another way; the session is not opened",
            code="DATA_LOSS.RECOVERY_DIVERGED",
            hint=f"this is {maker()}: resume it with the version that made it",
            details={"step": stored.step, "expected": "", "made_by": "unknown"},
        )


def _near(found: Floats, known: Floats) -> bool:
    """Whether two arrays differ by rounding only."""
    return bool(np.max(np.abs(found - known), initial=0.0) <= _ROUNDING * np.max(np.abs(known), initial=0.0))


@cache
def maker() -> str:
    """Versions and processor of this process, for people: they must be the same for a recomputation to succeed."""
    libraries = (f"{name} {metadata.version(name)}" for name in ("numpy", "scipy"))
    return ", ".join([f"mesh-motion-server {__version__}", *libraries, _processor()])[:200]


def recompute(
    model: Model,
    mesh: MergedMesh,
    factors: FactorCache,
    start: CommittedState,
    logged: Sequence[Commit],
    progress: Progress = silent,
    *,
    time_levels: str = "",
) -> CommittedState:
    """The last committed state.

    Raises DataLoss: DATA_LOSS.RECOVERY_DIVERGED if a recomputed step does not have its digest.

    Parameters
    ----------
    start : CommittedState
        State of the last snapshot.
    logged : sequence of Commit
        The commits after it.
    progress : callable
        Called after each recomputed step.
    time_levels : str
        The session's value.
    """
    model = model.without_distributions()
    for commit in logged:
        after = _state_after(model, mesh, factors, start, commit, time_levels)
        found = state_digest(commit.step, durable_rows(mesh, after))
        if found != commit.digest:
            raise _diverged(commit, f"digest {found.hex()[:16]}… instead of {commit.digest.hex()[:16]}…")
        start = after
        progress(commit.step)
    return start


def _state_after(
    model: Model, mesh: MergedMesh, factors: FactorCache, before: CommittedState, commit: Commit, time_levels: str
) -> CommittedState:
    """The state of a logged commit."""
    boundary, order = commit.boundary, mesh.moving_by_id
    if boundary is None or len(boundary.rows) != 8 * order.size * mesh.points.shape[1]:
        raise _diverged(commit, "displacements that are not those of this mesh's moving nodes")
    displacement = np.empty((order.size, mesh.points.shape[1]))
    displacement[order] = np.frombuffer(boundary.rows, dtype="<f8").reshape(displacement.shape)
    move_input = MoveInput(boundary.frame, displacement)
    try:
        found = compute(model, mesh, before.points, move_input, factors, with_displacements=False)
        coefficients = None if found.field is None else found.field.coefficients
        time, previous = _times(commit)
        before = replace(before, level=replace(before.level, time=previous))
        trial = Trial(commit.step, 1, found.points, None, move_input, coefficients)
        return state_after(before, trial, time_levels, time)
    except MeshMotionError as error:
        raise _diverged(commit, f"{error.code} ({error.message})") from error


def _diverged(commit: Commit, what: str) -> DataLoss:
    made_by = commit.boundary.maker if commit.boundary is not None else "unknown"
    return DataLoss(
        f"computing step {commit.step} again gave {what}; the session is not opened",
        code="DATA_LOSS.RECOVERY_DIVERGED",
        hint=f"made by {made_by}; this is {maker()}: resume it there and close it, then it can be resumed here",
        details={"step": commit.step, "expected": commit.digest.hex(), "made_by": made_by},
    )


def _processor() -> str:
    """The processor's name, if the system gives it."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        lines = []
    named = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    return next(named, platform.machine())
