"""The interface between :mod:`.play` and the client: only what :mod:`.play` needs of a session.

Tests replace :class:`Driver` by a test double; all other code talks to a server over the wire.
"""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from typing import Any, Literal, Protocol

from mesh_motion_client import Credentials, Keys, Mesh, MeshMotionError, Patch, Session, connect
from mesh_motion_client.session import Report

from mesh_motion_server.cases.case import Case
from mesh_motion_server.cases.kept import Kept
from mesh_motion_server.files import MeshFile
from mesh_motion_server.numerics.arrays import Floats

__all__ = ["Driver", "Reply", "open_session"]


@dataclass(frozen=True, eq=False)
class Reply:
    """The part of a MOVED reply that :mod:`.play` keeps.

    Attributes
    ----------
    displacement : (n, d) array
        Total displacement of all nodes, mesh length unit.
    predicted, predicted_standard : float
        Minimum of the session's quality metric, with the correction and without.
    sub_steps : int
        Number of sub-steps of the motion.
    faces : dict of str to dict
        Face quality for finite-volume codes ``before`` and ``after``; empty if not requested.
    """

    displacement: Floats
    predicted: float
    predicted_standard: float
    enrichment_points: int
    freed_nodes: int
    seconds: Mapping[str, float]
    warnings: list[str]
    sub_steps: int = 1
    faces: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)


class Driver(Protocol):
    """An open session."""

    @property
    def settings(self) -> dict[str, Any]:
        """The settings in force."""

    @property
    def mesh_warnings(self) -> list[str]:
        """What the server noticed about the mesh."""

    @property
    def step(self) -> int:
        """The last committed step."""

    def points(self) -> Floats:
        """Committed coordinates (n, d)."""

    def move(self, displacement: Floats, *, report: Report = "") -> Reply:
        """Move the moving nodes (ascending) to their total displacement (k, d); ``report`` is that of MOVE."""

    def commit(self, final_step: int) -> None:
        """Commit the step of a run that ends with ``final_step``."""

    def peak_memory_bytes(self) -> int:
        """Peak memory of the processes that serve the session, as far as they report it."""


@contextmanager
def open_session(
    case: Case,
    mesh: MeshFile,
    endpoint: str | None,
    kept: Kept,
    *,
    resumed: bool = False,
    keys: Keys | None = None,
) -> Iterator[Driver]:
    """Open a session for a case, or resume the kept one (``resumed``); discard it when the block ends without an error.

    Parameters
    ----------
    endpoint : str or None
        None: a private server that ends with the session.
    kept : Kept
        Folder where a private server stores the session, and the credentials to resume it.
    keys : Keys, optional
        Keys for a server that requires them.
    """
    patches = {name: Patch(role, mesh.patches[name]) for name, role in case.content.patches.items()}
    asked = {"roles": dict(case.content.patches), "method": case.content.method.model_dump(exclude_unset=True)}
    settings = kept.settings(asked) if resumed else {}
    state = kept.state if endpoint is None else None
    with connect(endpoint, state=state, keys=keys) as server:
        if resumed:
            session = server.resume(Credentials.load(kept.credentials))
        else:
            session = server.open(Mesh(mesh.points, mesh.cells, patches), asked["method"], label=case.name)
            session.credentials.save(kept.credentials)
            settings = dict(session.settings)
            kept.begin(asked, settings)
        outcome: Literal["keep", "discard"] = "keep"
        try:
            yield _Session(session, settings)
            outcome = "discard"
        finally:
            with suppress(MeshMotionError):  # the results do not depend on it
                session.close(outcome if session.step else "discard")


class _Session:
    """A client's session as a :class:`Driver`."""

    def __init__(self, session: Session, settings: dict[str, Any]) -> None:
        self._session, self.settings = session, settings

    @property
    def step(self) -> int:
        return self._session.step

    def points(self) -> Floats:
        return self._session.points()

    @property
    def mesh_warnings(self) -> list[str]:
        return list(self._session.mesh_report.get("warnings", []))

    def move(self, displacement: Floats, *, report: Report = "") -> Reply:
        moved = self._session.move(displacement, report=report)
        return Reply(
            displacement=moved.displacement,
            predicted=float(moved.quality["corrected"]["metric"]["min"]),
            predicted_standard=float(moved.quality["standard"]["metric"]["min"]),
            enrichment_points=len(moved.enrichment_points),
            freed_nodes=int(moved.correction.get("freed_nodes", 0)),
            seconds=moved.seconds,
            warnings=list(moved.warnings),
            sub_steps=int(moved.correction.get("sub_steps", 1)),
            faces=moved.faces,
        )

    def commit(self, final_step: int) -> None:
        self._session.commit(final_step=final_step)

    def peak_memory_bytes(self) -> int:
        return int(self._session.status().report.get("peak_memory_bytes", 0))
