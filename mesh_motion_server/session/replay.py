"""States that were logged, not stored: logs the input of a Move, and recomputes states from it.

The recomputation must give the digest that was journaled, bit for bit, or nothing is opened. It is the same function of
the same bytes, so it does on the same machine with the same software. Another version of the server or of its numerical
libraries, or a processor for which these choose other instructions, may round otherwise. Threads, caches and coupling
iterations before the committed one do not matter. The log says for each step what computed it, and a session that was
closed needs no recomputation (``journal.durability``).
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
from mesh_motion_protocol.digests import state_digest

from mesh_motion_server import __version__
from mesh_motion_server.distributed.field import Field
from mesh_motion_server.errors import JournalError, MeshMotionError
from mesh_motion_server.numerics.arrays import Floats
from mesh_motion_server.session.factors import FactorCache
from mesh_motion_server.session.journal.journal import Journal
from mesh_motion_server.session.journal.ledger import BoundaryInput, Commit
from mesh_motion_server.session.model import Model
from mesh_motion_server.session.motions import compute
from mesh_motion_server.session.partitions.meshes import MergedMesh
from mesh_motion_server.session.state import CommittedState, MoveInput, durable_rows

__all__ = ["Progress", "boundary_input", "maker", "recompute", "restore", "silent"]

Progress = Callable[[int], None]
#: States that took longer than this to compute again are stored, seconds.
_LONG_SECONDS = 10.0
#: Share of the largest coefficient by which those of one field may differ between versions.
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
    progress: Progress = silent,
    *,
    field: Field | None = None,
) -> CommittedState:
    """The last committed state of a journal, read or computed; with the ``field`` at rest if the client evaluates it.

    What took long to compute is stored at once: else a worker that falls again and again would have ever more to do.

    Raises
    ------
    JournalError
        If it does not verify; as :func:`recompute`.
    """
    snapshot = journal.ledger.snapshot
    stored = CommittedState(0, mesh.points, None if field is None else field.coefficients)
    if snapshot is not None:
        rows, points = journal.read_state(), np.empty_like(mesh.points)
        points[mesh.id_order] = rows[: len(points)]
        points.flags.writeable = False
        coefficients = None if field is None else rows[len(points) :]
        stored = CommittedState(snapshot.step, points, coefficients)
        _check_field(stored, model, mesh, factors)
    began = time.monotonic()
    found = recompute(model, mesh, factors, stored, journal.ledger.logged, progress)
    if time.monotonic() - began > _LONG_SECONDS:
        journal.snapshot(durable_rows(mesh, found))
    return found if field is None else replace(found, corrected=_was_corrected(journal.ledger.commits))


def _was_corrected(commits: Sequence[Commit]) -> bool:
    """Whether the answer to the last commit says so."""
    return bool(commits) and bool(msgpack.unpackb(commits[-1].receipt).get("corrected", False))


def _check_field(stored: CommittedState, model: Model, mesh: MergedMesh, factors: FactorCache) -> None:
    """Check that stored coefficients are those of the field that this version describes, but for rounding.

    Raises
    ------
    JournalError
        DATA_LOSS.RECOVERY_DIVERGED.
    """
    if stored.coefficients is None:
        return
    moving = mesh.moving
    reached = MoveInput("reference", stored.points[moving] - mesh.points[moving])
    field = compute(model, mesh, mesh.points, reached, factors).field
    known = stored.coefficients
    if field is None or field.coefficients.shape != known.shape or not _near(field.coefficients, known):
        raise JournalError(
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
) -> CommittedState:
    """The last committed state.

    Parameters
    ----------
    start : CommittedState
        That of the last snapshot.
    logged : sequence of Commit
        The commits behind it.
    progress : callable
        Hears of each step that was computed again.

    Raises
    ------
    JournalError
        DATA_LOSS.RECOVERY_DIVERGED if a step does not give its digest again.
    """
    model = model.without_distributions()
    for commit in logged:
        after = _state_after(model, mesh, factors, start, commit)
        found = state_digest(commit.step, durable_rows(mesh, after))
        if found != commit.digest:
            raise _diverged(commit, f"digest {found.hex()[:16]}… instead of {commit.digest.hex()[:16]}…")
        start = after
        progress(commit.step)
    return start


def _state_after(
    model: Model, mesh: MergedMesh, factors: FactorCache, before: CommittedState, commit: Commit
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
        field = found.field
        return CommittedState(commit.step, found.points, None if field is None else field.coefficients)
    except MeshMotionError as error:
        raise _diverged(commit, f"{error.code} ({error.message})") from error


def _diverged(commit: Commit, what: str) -> JournalError:
    made_by = commit.boundary.maker if commit.boundary is not None else "unknown"
    return JournalError(
        f"computing step {commit.step} again gave {what}; the session is not opened",
        code="DATA_LOSS.RECOVERY_DIVERGED",
        hint=f"made by {made_by}; this is {maker()}: resume it there and close it, then it can be resumed here",
        details={"step": commit.step, "expected": commit.digest.hex(), "made_by": made_by},
    )


def _processor() -> str:
    """The processor's name, as far as the system tells it."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        lines = []
    named = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    return next(named, platform.machine())
