"""The mesh of a part, moved by the server: open or resume a session, move as often as the coupling needs, commit.

A session's reference is the mesh that the session was opened with: the initial mesh, or the mesh of the restart if a
restarted run found no session to continue. The part's displacements count from the initial mesh; the difference of
the two meshes is added.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from mesh_motion_client import Mesh, MeshMotionError, Patch, QualityRefused, Server, Session, SessionError, connect
from numpy.typing import NDArray

from mesh_motion_kratos.errors import MotionError, PartError, SettingsError
from mesh_motion_kratos.part import MovingPart
from mesh_motion_kratos.session_file import StoredSession, digest
from mesh_motion_kratos.settings import RemoteSettings

__all__ = ["Participant", "Roles", "roles_of"]

#: Two meshes are the same if no coordinate differs by more than this share of the mesh's extent: round-off.
_SAME = 1e-12


@dataclass(frozen=True)
class Roles:
    """Which node does what.

    Attributes
    ----------
    moving : (k,) int64 array
        Rows whose displacement every move gives, ascending.
    fixed : (f,) int64 array
        Rows that stay.
    patches : dict
        Names and roles, as they are sent to the server.
    """

    moving: NDArray[np.int64]
    fixed: NDArray[np.int64]
    patches: dict[str, Patch]


def roles_of(part: MovingPart, settings: RemoteSettings) -> Roles:
    """Sort the nodes: nodes that are prescribed in every component move; nodes of sub parts with a role have that role.

    Raises
    ------
    PartError
        No node is prescribed, or a node is prescribed in some components only and does not slide on a part.
    """
    prescribed = part.prescribed()
    rows = {name: part.rows_of(name) for name in settings.roles}
    patches = {name: Patch(role, rows[name]) for name, role in settings.roles.items()}
    fixed = _union([rows[name] for name, role in settings.roles.items() if role == "fixed"])
    sliding = _union([rows[name] for name, role in settings.roles.items() if role != "fixed"])
    moving = np.setdiff1d(np.flatnonzero(prescribed.all(axis=1)), fixed)
    partly = np.asarray(prescribed.any(axis=1) & ~prescribed.all(axis=1))
    partly[fixed] = partly[sliding] = False
    if partly.any():
        raise PartError(
            f"node {part.node_ids[np.argmax(partly)]} has some components of MESH_DISPLACEMENT fixed, not all",
            'name its sub model part in "roles": slip or symmetry',
        )
    if not len(moving):
        raise PartError(
            "no node has all components of MESH_DISPLACEMENT fixed",
            "fix them on the interface and on the outer boundary, as for Kratos' own mesh solvers",
        )
    return Roles(moving, fixed, {"prescribed": Patch("moving", moving), **patches})


class Participant:
    """One part and its session.

    Parameters
    ----------
    restarted : bool
        Whether the run continues from a restart file, and with its session if any.
    warn : callable
        Takes a warning for the user, one line.
    """

    def __init__(
        self, part: MovingPart, settings: RemoteSettings, *, restarted: bool, warn: Callable[[str], None]
    ) -> None:
        self._part, self._settings, self._warn = part, settings, warn
        self._roles = roles_of(part, settings)
        self._server: Server = connect(
            settings.address or None, timeout=settings.timeout, compute_timeout=settings.compute_timeout
        )
        self._session: Session | None = None
        try:
            self.resumed = restarted and self._resume()
            if self._session is None:
                self._open()
            self._offset = self.session.points("reference") - part.initial_points()
        except BaseException:
            self.close(keep=self._session is not None and restarted)
            raise

    @property
    def session(self) -> Session:
        """The session in use.

        Raises
        ------
        PartError
            It has been closed.
        """
        if self._session is None:
            raise PartError("the mesh's session is closed", "a finalized solver cannot move the mesh")
        return self._session

    def check_roles(self) -> None:
        """Raise PartError if other nodes are prescribed than at the start."""
        moving = roles_of(self._part, self._settings).moving
        changed = np.setxor1d(moving, self._roles.moving)
        if len(changed):
            node = self._part.node_ids[changed[0]]
            raise PartError(
                f"node {node} {'is' if changed[0] in moving else 'is no longer'} prescribed, unlike at the start",
                "which nodes have MESH_DISPLACEMENT fixed may not change within a run",
            )

    def move(self) -> Any:
        """One coupling iteration: read the given displacements, set all others.

        Returns
        -------
        Moved
            The server's answer.

        Raises
        ------
        MotionError
            No acceptable mesh was found; the part does not change.
        PartError
            A part with the role ``fixed`` was given a displacement.
        """
        given = self._part.displacements() - self._offset
        self._check_fixed(given)
        try:
            moved = self.session.move(given[self._roles.moving])
        except QualityRefused as error:
            raise self._refused(error) from None
        for warning in moved.warnings:
            self._warn(warning)
        answer = moved.displacement + self._offset
        answer[self._roles.moving] = given[self._roles.moving] + self._offset[self._roles.moving]
        self._part.set_displacements(answer)
        return moved

    def commit(self) -> Any:
        """Commit the last move: the next step starts from its mesh. None without a move since the last commit."""
        return self.session.commit() if self.session.iteration else None

    def close(self, *, keep: bool | None = None) -> None:
        """End the use of the session, and the private server if any; idempotent."""
        if keep is None:
            keep = bool(self._settings.session_file)
        session, self._session = self._session, None
        try:
            if session is not None:
                session.close("keep" if keep else "discard")
        finally:
            self._server.close()

    def _check_fixed(self, given: NDArray[np.float64]) -> None:
        astray = self._roles.fixed[(given[self._roles.fixed] != 0.0).any(axis=1)]
        if len(astray):
            raise PartError(
                f"node {self._part.node_ids[astray[0]]} of a part with the role fixed is to move by {given[astray[0]]}",
                "take the role away: its nodes then move with their own displacements",
            )

    def _open(self) -> None:
        mesh = Mesh(self._part.current_points(), self._part.cells, self._roles.patches)
        settings = self._settings
        self._session = self._server.open(
            mesh, settings.method, label=settings.label, durability=settings.durability or None
        )
        for warning in self._session.mesh_report.get("warnings", []):
            self._warn(warning)
        if settings.session_file:
            StoredSession(self._session.credentials, digest(settings)).save(Path(settings.session_file))

    def _resume(self) -> bool:
        """Resume the session of the session file; False, with a warning, if it does not continue from this mesh."""
        if not self._settings.session_file:
            self._warn('no "session_file" is set: a new session begins with the restart\'s mesh')
            return False
        try:
            stored = StoredSession.load(Path(self._settings.session_file))
            if stored.opened_with != digest(self._settings):
                raise SettingsError("the session was opened with another method or other roles")
            session = self._server.resume(stored.credentials)
        except (SettingsError, SessionError) as error:
            self._warn(f"a new session begins with the restart's mesh: {error.message}")
            return False
        try:
            reason = self._differs(session)
        except MeshMotionError:
            session.close("keep")
            raise
        if reason:
            session.close("keep")
            self._warn(f"a new session begins with the restart's mesh: {reason}")
            return False
        self._session = session
        return True

    def _differs(self, session: Session) -> str:
        """The reason why the session does not continue from the present part; empty if it does."""
        if not np.array_equal(session.moving_nodes, self._roles.moving):
            return "other nodes are prescribed than in its session"
        points, here = session.points("committed"), self._part.current_points()
        if points.shape != here.shape or np.abs(points - here).max() > _SAME * np.ptp(here, axis=0).max():
            return f"its session has gone on to step {session.step}, with another mesh"
        return ""

    def _refused(self, error: QualityRefused) -> MotionError:
        """The server's refusal as an error with Kratos' numbers."""
        worst = [str(self._part.cell_ids[cell["type"]][cell["cell"]]) for cell in error.worst[:5]]
        where = f"; worst elements: {', '.join(worst)}" if worst else ""
        hint = error.hint
        if error.fraction:
            hint = f"{error.fraction:.0%} of the step's displacement would do; a smaller time step may help"
        return MotionError(f"{error.message}{where}", hint)


def _union(groups: list[NDArray[np.int64]]) -> NDArray[np.int64]:
    """All rows of the groups, ascending."""
    return np.unique(np.concatenate([np.empty(0, dtype=np.int64), *groups]))
