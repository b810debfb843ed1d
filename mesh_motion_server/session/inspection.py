"""Read-only inspection of a session's folder: shows the journal's content, and which parts of it verify.

It changes nothing and takes no lock: it may be used on a live session. A commit that is being written may then look
unfinished.
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mesh_motion_numerics.motion.time_levels import STORED_ARRAYS
from mesh_motion_protocol.errors import DataLoss

from mesh_motion_server.absence import is_missing
from mesh_motion_server.session.journal.files import MANIFEST, NEXT_MANIFEST, SLOTS, read_journal, read_stored_state
from mesh_motion_server.session.journal.filesystem import FileSystem, PosixFileSystem
from mesh_motion_server.session.journal.mesh_store import MESH, read_mesh
from mesh_motion_server.session.journal.recovery import Findings
from mesh_motion_server.session.spec import SPEC, StoredSpec, check_digest, spec_bytes
from mesh_motion_server.session.unbuilt import UNBUILT, never_built


@dataclass(frozen=True)
class Check:
    """One verification: its name, its result, and the error, if any."""

    name: str
    passed: bool
    message: str = ""


@dataclass(frozen=True)
class Inspection:
    """The content of a session's folder."""

    folder: str
    session: str
    #: label, dimension, partitions, durability, settings: empty or 0 if the session's ``spec.json`` is lost or damaged
    label: str
    dimension: int
    partitions: int
    nodes: int
    durability: str  # the session's level
    settings: dict[str, Any]  # the keys of the case file's ``[method]``
    #: step, epoch: last committed step and current epoch; -1 if the journal does not contain it
    step: int
    stored_step: int  # the step of the stored state; RESUME recomputes the steps after it
    epoch: int
    digest: str  # state digest of the last committed step, hexadecimal; empty at step 0
    #: {"whole", "unfinished", "damaged", "unbuilt"}. ``unfinished``: a crash left something that the next RESUME
    #: completes or drops without loss.
    state: str
    checks: tuple[Check, ...]


def inspect_session(folder: Path | str) -> Inspection:
    """Inspect one session's folder.

    Raises DataLoss if it is not a session's folder: it has none of a session's files.
    """
    path, files = Path(folder), PosixFileSystem()
    if not is_session_folder(path):
        spec_bytes(path)  # raises if it is not a session's folder
    found, journal_check = _journal(path, files)
    spec, spec_check = _spec(path, found)
    checks = [journal_check, spec_check]
    if found is not None:
        foundation = found.ledger.foundation
        checks += [
            _check("mesh", lambda: read_mesh(path / MESH, files, foundation.mesh)),
            _check("state", lambda: read_stored_state(path, files, found.ledger)),
        ]
    last = found.ledger.commits[-1] if found is not None and found.ledger.commits else None
    return Inspection(
        folder=str(path),
        session=spec.session if spec else path.resolve().name,
        label=spec.label if spec else "",
        dimension=spec.dimension if spec else 0,
        partitions=spec.partitions if spec else 0,
        nodes=found.ledger.foundation.nodes // (1 + STORED_ARRAYS[spec.time_levels]) if found and spec else 0,
        durability=spec.durability if spec else "",
        settings=spec.settings.model_dump() if spec else {},
        step=found.ledger.step if found else -1,
        stored_step=_stored_step(found) if found else -1,
        epoch=found.ledger.epoch if found else -1,
        digest=last.digest.hex() if last else "",
        state=_judge(path, files, found, checks),
        checks=tuple(checks),
    )


def is_session_folder(folder: Path) -> bool:
    """Whether a folder has one of a session's files, or cannot be read: then the inspection says why."""
    try:
        return any(not is_missing(folder / name) for name in (SPEC, MANIFEST, NEXT_MANIFEST, *SLOTS, UNBUILT))
    except NotADirectoryError:
        return False
    except OSError:
        return True


def _stored_step(found: Findings) -> int:
    snapshot = found.ledger.snapshot
    return snapshot.step if snapshot else 0


def _journal(path: Path, files: FileSystem) -> tuple[Findings | None, Check]:
    try:
        return read_journal(path, files), Check("journal", passed=True)
    except DataLoss as error:
        return None, Check("journal", passed=False, message=error.message)


def _check(name: str, verify: Callable[[], object]) -> Check:
    try:
        verify()
    except DataLoss as error:
        return Check(name, passed=False, message=error.message)
    return Check(name, passed=True)


def _spec(path: Path, found: Findings | None) -> tuple[StoredSpec | None, Check]:
    """The content of the file; damage is not reported as another version."""
    try:
        raw = spec_bytes(path)
        if found is not None:
            check_digest(raw, found.ledger.foundation.spec)
        return StoredSpec.from_bytes(raw), Check("spec", passed=True)
    except DataLoss as error:
        return None, Check("spec", passed=False, message=error.message)


def _judge(path: Path, files: FileSystem, found: Findings | None, checks: list[Check]) -> str:
    if found is None and _is_unbuilt(path, files):
        return "unbuilt"
    if found is None or not all(check.passed for check in checks):
        return "damaged"
    return "unfinished" if found.torn or found.completion or found.dirty_slots else "whole"


def _is_unbuilt(path: Path, files: FileSystem) -> bool:
    try:
        return never_built(files, path)
    except OSError:
        return False
