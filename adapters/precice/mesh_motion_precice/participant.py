"""The coupling loop: each step is a trial move; a complete window is committed, a repeated one is rolled back.

preCICE asks an implicitly coupled participant to keep its state where a window begins and to restore it when the window
is computed again. The server keeps it: a move is a trial from the last committed state, at every repetition, and only
``commit`` changes that state. So writing a checkpoint needs no action, and reading it is ``rollback``.
With several steps in a window each is a trial from the beginning of the window, and the last one is committed. The
server knows the committed windows only: its velocity is that of a window's first step, and the velocity of a later step
is its displacement divided by its time.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from mesh_motion_client import Credentials, InvalidInput, Mesh, Server, Session, SessionError
from mesh_motion_protocol.shared_nodes import Torn, united
from numpy.typing import NDArray

from mesh_motion_precice.api import Coupling
from mesh_motion_precice.configuration import Configuration
from mesh_motion_precice.run_length import count_windows
from mesh_motion_precice.vertices import VolumeVertices, WetVertices

__all__ = ["Participant", "Window", "load_mesh", "resume_session"]

_LOG = logging.getLogger(__name__)

#: Steps of a window are equal; a rest of it shorter than this share of the longest step is no step of its own.
_REST = 1e-9


@dataclass(frozen=True)
class Window:
    """A window that is complete.

    Attributes
    ----------
    number : int
        Number of the session's committed steps; counting continues after a restart.
    time : float
        The window's end, since this run began, time unit.
    iterations : int
        How often the window was computed.
    lowest_quality : float
        Smallest size-skew of a cell.
    warnings : tuple of str
        The server's warnings of the committed move.
    """

    number: int
    time: float
    iterations: int
    lowest_quality: float
    warnings: tuple[str, ...]


class Participant:
    """The participant: construct it, open the session, :meth:`begin`, then go through :meth:`windows`.

    The constructor reports each fault that it can find without the other participants, before there is a session.

    Parameters
    ----------
    coupling : Coupling
        preCICE's participant, not yet initialized.
    mesh : Mesh
        The reference mesh.

    Raises
    ------
    InvalidInput
        preCICE's meshes or data do not have the mesh's dimension.
    RuntimeError
        preCICE's error: a mesh or data is not configured for this participant.
    """

    def __init__(self, coupling: Coupling, mesh: Mesh, configuration: Configuration) -> None:
        self._coupling = coupling
        self._mesh = mesh
        self._frame = configuration.frame
        self._time_step = configuration.time_step
        self._scheme = configuration.velocity_scheme if configuration.volume.velocity else ""
        self._windows = count_windows(configuration.precice_config)
        self._surfaces = [WetVertices.provide(coupling, surface, mesh) for surface in configuration.surfaces]
        self._volume = VolumeVertices.prepare(coupling, configuration.volume, mesh)

    def begin(self, session: Session) -> None:
        """Initialize preCICE; give it the mesh's present displacement if it requires initial data.

        Returns when the other participants are there.

        Parameters
        ----------
        session : Session
            READY, with the reference mesh; it stays open.

        Raises
        ------
        InvalidInput
            A moving node is on no patch that is read, or the solver's mesh is not the mesh file's.
        RuntimeError
            preCICE's own.
        """
        self._session = session
        self._final_step = session.step + self._windows if self._windows else 0  # for people who watch the session
        read = np.unique(np.concatenate([surface.nodes for surface in self._surfaces]))
        if (missing := np.setdiff1d(session.moving_nodes, read)).size:
            raise InvalidInput(f"the moving node {int(missing[0])} is on no patch that is read")
        self._start = self._displacement_so_far()
        if self._coupling.requires_initial_data():
            if self._volume.volume.received:
                raise InvalidInput(
                    f"initial data cannot be written to the received mesh {self._volume.volume.mesh!r}",
                    hint='leave initialize="true" away from its <exchange>',
                )
            self._volume.write(self._coupling, self._start, np.zeros_like(self._start))
        self._coupling.initialize()
        self._volume = self._volume.settled(self._coupling, self._mesh)

    def windows(self) -> Iterator[Window]:
        """Couple until preCICE ends the coupling; yield each window once it is committed.

        Raises
        ------
        QualityRefused
            No acceptable mesh was found; the session is at its last committed window.
        MeshMotionError
            As :meth:`mesh_motion_client.Session.move`.
        RuntimeError
            preCICE's error, for example that another participant has ended.
        """
        coupling, time, iterations = self._coupling, 0.0, 1
        start, before, first = time, self._start, self._session.time or 0.0
        while coupling.is_coupling_ongoing():
            if coupling.requires_writing_checkpoint():
                start = time
            step = self._step(coupling.get_max_time_step_size())
            boundary, now = self._boundary(step), first + time + step
            moved = self._session.move(boundary, frame=self._frame, time=now, velocity=self._scheme)
            velocity = moved.velocity
            if velocity is not None and before is not self._start:  # the server has that since the window began
                velocity = (moved.displacement - before) / step
            self._volume.write(coupling, moved.displacement, velocity)
            coupling.advance(step)
            time, before = time + step, moved.displacement
            if coupling.requires_reading_checkpoint():
                self._session.rollback()
                _LOG.debug("iteration %d of t %.6g is repeated", iterations, time)
                time, before, iterations = start, self._start, iterations + 1
            elif coupling.is_time_window_complete():
                committed = self._session.commit(final_step=self._final_step)
                quality = float(committed.quality["size_skew"]["min"])
                yield Window(self._session.step, time, iterations, quality, tuple(moved.warnings))
                before = self._start = np.zeros_like(before) if self._frame == "committed" else before
                start, iterations = time, 1
        coupling.finalize()

    def _displacement_so_far(self) -> NDArray[np.float64]:
        """(n, d) displacement of the committed state in the frame; not zero after a restart."""
        if self._frame == "committed" or self._session.step == 0:
            return np.zeros_like(self._mesh.points)
        return self._session.points("committed") - self._mesh.points

    def _step(self, rest: float) -> float:
        """Length of the next step: the rest of the window is divided into the fewest possible equal steps."""
        return rest / max(1, math.ceil(rest / self._time_step - _REST))

    def _boundary(self, relative_time: float) -> NDArray[np.float64]:
        """(k, d) displacements of the moving nodes.

        Raises
        ------
        InvalidInput
            If two patches move a node to different places.
        """
        moving = self._session.moving_nodes
        rows, places = [], []
        for surface in self._surfaces:
            at = np.minimum(np.searchsorted(moving, surface.nodes), len(moving) - 1)
            moves = moving[at] == surface.nodes
            rows.append(surface.read(self._coupling, relative_time)[moves])
            places.append(at[moves])
        try:
            return united(rows, places, len(moving), float(np.ptp(self._mesh.points, axis=0).max()))
        except Torn as torn:
            one, other = (self._surfaces[part].surface.mesh for part in torn.parts)
            raise InvalidInput(
                f"node {int(moving[torn.place])} is read from the preCICE meshes {one!r} and {other!r}, which move it "
                f"to different places: by {torn.values[0].tolist()} and {torn.values[1].tolist()}",
                hint="read both patches from one preCICE mesh, so that one mapping gives the node",
            ) from None


def load_mesh(configuration: Configuration) -> Mesh:
    """The mesh file with the patches' roles; raises InvalidInput if they do not agree, or it cannot be read."""
    return Mesh.load(configuration.mesh_file, configuration.patches, zone=configuration.mesh_zone)


def resume_session(server: Server, mesh: Mesh, credentials: Path) -> Session:
    """The session of an earlier run, at its last committed window.

    Raises
    ------
    InvalidInput
        There is no such file, or the session has another reference mesh.
    SessionError
        The server does not have the session.
    """
    if not credentials.is_file():
        raise InvalidInput(f"there is nothing to restart from: no file {credentials}", hint="run without --restart")
    try:
        session = server.resume(Credentials.load(credentials))
    except SessionError as error:
        error.hint = error.hint or f"without --restart a new session begins; {credentials} is replaced"
        raise
    reference = session.points("reference")
    if reference.shape != mesh.points.shape or not np.array_equal(reference, mesh.points):
        session.close()
        raise InvalidInput(f"the mesh of the session in {credentials} is not that of the mesh file")
    return session
