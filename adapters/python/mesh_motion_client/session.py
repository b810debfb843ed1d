"""A session: move, commit, roll back, and read the node coordinates."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Mapping
from dataclasses import replace
from types import TracebackType
from typing import Any, Literal, Self, TypeVar

import numpy as np
from mesh_motion_protocol import messages
from mesh_motion_protocol.errors import InvalidInput, MeshMotionError, MeshMotionWarning, SessionError
from mesh_motion_protocol.messages import (
    Close,
    Closed,
    Commit,
    Cotangent,
    CotangentFound,
    Fetch,
    Fetched,
    Move,
    Rollback,
    RolledBack,
    Status,
    StatusReport,
    Tangent,
    TangentFound,
)
from numpy.typing import ArrayLike, NDArray

from mesh_motion_client.boundary_rows import boundary_rows
from mesh_motion_client.committed import Committed
from mesh_motion_client.display import draw
from mesh_motion_client.mesh import real_numbers, whole_numbers
from mesh_motion_client.moved import Moved
from mesh_motion_client.opened import OpenedSession
from mesh_motion_client.own_cells import OwnCells

__all__ = ["Frame", "HeadroomAlong", "Report", "Scheme", "Session"]

#: Settings that :meth:`Session.description` names.
_SHOWN = ("support_radius", "correction", "quality_threshold", "displacement")

#: Largest limit on computing time, in seconds: about 30 years.
_LONGEST_LIMIT = 1e9

_Found = TypeVar("_Found")

Frame = Literal["committed", "reference"]
Report = Literal["", "faces", "swept"]
HeadroomAlong = Literal["step", "displacement", "velocity"]
Scheme = Literal["", "tangent", "bdf1", "bdf2", "bossak"]


class Session(OpenedSession):
    """One partition's view of a session; used by one thread at a time. Made by :class:`.server.Server`.

    Attributes
    ----------
    credentials : Credentials
        They resume the session from another process: save them.
    partition : int
    step : int
        The last committed step.
    durable_step : int
        The last step that survives a crash or a power loss, as the last commit reported it. With durability "relaxed"
        it may be earlier than :attr:`step`. :meth:`status` has the current value.
    iteration : int
        Number of moves of the current step so far, 0 = none.
    moving_nodes : (k,) int array
        The nodes whose displacement every move gives, ascending.
    settings : Settings
        The settings in force, as BUILT reported them; empty in a session that was resumed.
    mesh_report : dict
        The mesh report of BUILT; empty in a session that was resumed.
    quality : QualitySummary or None
        Quality of the uploaded mesh; None in a session that was resumed.
    derivatives : bool or None
        Whether the session has :meth:`tangent` and :meth:`cotangent`; None in a session that was resumed.
    time : float or None
        Time of the last committed step, seconds; None if it is not known.
    """

    @property
    def step(self) -> int:
        """The last committed step."""
        return self._courier.step

    @property
    def iteration(self) -> int:
        """Number of moves of the current step so far, 0 = none."""
        return self._courier.iteration

    # --- the verbs ---------------------------------------------------------------------------------------------------

    def move(
        self,
        displacements: ArrayLike | Mapping[str, ArrayLike],
        *,
        frame: Frame = "reference",
        report: Report = "",
        headroom_along: HeadroomAlong = "step",
        time: float | None = None,
        velocity: Scheme = "",
        boundary_velocity: ArrayLike | Mapping[str, ArrayLike] | None = None,
        swept_faces: ArrayLike | None = None,
        compute_limit: float = 0.0,
        timeout: float | None = None,
    ) -> Moved:
        """One coupling iteration: boundary displacements in, displacements of all nodes out. Nothing is final yet.

        Parameters
        ----------
        displacements : (k, d) array, mesh length unit, or dict
            In the order of :attr:`moving_nodes`; or patch name → (p, d) array in the order of the patch's nodes.
        frame : {"reference", "committed"}
            Start of the displacements: the reference mesh for totals, as structural codes have them, or the committed
            state for increments.
        report : {"", "faces", "headroom", "swept"}
            "faces": add the face quality of a finite-volume code, ``faces["before"]`` and ``faces["after"]`` of the
            reply; it takes time, so request it once a step. "headroom", and with "faces" too: how many more such steps
            the mesh admits until a cell inverts and until the threshold, in ``headroom`` of the reply. "swept": the
            volume that each face sweeps in this step, ``swept`` of the reply and :meth:`.moved.Moved.swept_of_cells`.
        headroom_along : {"step", "displacement", "velocity"}
            The unit of the headroom, if every node continues its motion: such steps; multiples of the whole
            displacement since the reference mesh; or seconds of ``velocity``.
        time : float, optional
            Time at the end of the step, seconds; later than :attr:`time`.
        velocity : {"", "tangent", "bdf1", "bdf2", "bossak"}
            Scheme of the nodes' velocities in ``velocity`` of the reply; "bdf2" and "bossak" need a session that was
            opened with the same ``time_levels``.
        boundary_velocity : (k, d) array or dict, optional
            Only with "tangent": the velocities of the moving nodes, in the form of the displacements.
        swept_faces : (f, k) integer array, optional
            With "swept": the nodes of each face, filled up with -1. In 3D they are anticlockwise as seen from the side
            to which the normal points; in 2D the normal is on the right of the edge. By default all faces of the cells,
            with outward normals.
        compute_limit : float
            Seconds after which the server gives up computing; 0: never. Without a limit the server goes on computing
            after ``timeout`` has ended this call, and the repeated call gets the answer.
        timeout : float, optional
            Seconds for this call.

        Returns
        -------
        Moved
            ``displacement`` (n, d) in ``frame``, ``quality``, ``correction``, ``warnings``, ``seconds``, …; if
            requested, ``velocity`` (n, d) and ``swept`` (f,).

        Raises
        ------
        QualityRefused
            If no acceptable mesh was found; the session is unchanged, but an earlier trial is lost if the client
            evaluates the volume.
        InvalidInput, SessionError, Unavailable, Timeout
            Timeout also if the server gave up; SessionError also if a time level or a derivative is missing.
        """
        if not 0.0 <= compute_limit <= _LONGEST_LIMIT:
            raise InvalidInput(f"compute_limit: expected 0 to {_LONGEST_LIMIT:g} s, got {compute_limit!r}")
        seconds, own = timeout or self._compute_timeout, self._own_cells_if_here()
        moving, velocities = (self.moving_nodes, self._patches), None
        if boundary_velocity is not None:
            velocities = boundary_rows(
                boundary_velocity, *moving, dimension=self.dimension, extent=None, what="boundary_velocity"
            )
        move = Move(
            **self._address,
            step=self.step + 1,
            frame=frame,
            report=report,
            headroom_along=headroom_along,
            time=None if time is None else float(time),
            velocity=velocity,
            compute_limit_ms=math.ceil(1000 * compute_limit),
            field_known=own is not None and own.volume.field_known,
            displacement=boundary_rows(displacements, *moving, dimension=self.dimension, extent=self._extent),
            boundary_velocity=velocities,
            swept_faces=None if swept_faces is None else whole_numbers(swept_faces, "swept_faces").astype(np.int64),
        )
        moved = self._courier.deliver(move, messages.Moved, seconds)
        self._courier.trial, self._courier.iteration = (replace(move, compute_limit_ms=0),), moved.iteration
        answered = vars(moved)
        if own is not None:
            answered = answered | own.take_trial(moved, seconds)
        for text in answered["warnings"]:
            warnings.warn(text, MeshMotionWarning, stacklevel=2)
        return Moved(**answered, mesh=self._mesh, is_total=frame == "reference", session=self)

    def tangent(
        self, velocity: ArrayLike, what: Literal["trial", "committed"] | None = None, *, timeout: float | None = None
    ) -> NDArray[np.float64]:
        """J v: the velocities of all nodes for velocities of the moving nodes. Collective over partitions.

        Parameters
        ----------
        velocity : (k, d) or (c, k, d) array
            Velocities of the moving nodes (:attr:`moving_nodes`), in a unit of length per any parameter; or c vectors
            at once.
        what : {"trial", "committed"}, optional
            The state at which the motion is differentiated; by default the open trial, if any.
        timeout : float, optional
            Seconds for this call.

        Returns
        -------
        (n, d) or (c, n, d) array
            Velocities of this partition's nodes.

        Raises
        ------
        InvalidInput
            If a shape is wrong, or the method has no derivative (:attr:`derivatives`): the message names the key.
        SessionError
            If this mesh was corrected, but not by the smooth correction.
        """
        rows, many = self._columns(velocity, len(self.moving_nodes), "velocity")
        seconds, own = timeout or self._compute_timeout, self._own_cells_if_here()

        def ask(state: Literal["trial", "committed"]) -> TangentFound:
            request = Tangent(**self._address, what=state, velocity=rows)
            return self._courier.deliver(request, TangentFound, seconds)

        found = self._at_state(ask, what, own, seconds)
        return self._vectors(found.velocity if own is None else own.volume.velocity(found), many=many)

    def cotangent(
        self, weights: ArrayLike, what: Literal["trial", "committed"] | None = None, *, timeout: float | None = None
    ) -> NDArray[np.float64]:
        """Jᵀ w: the derivative of Σ w · x, x the nodes' positions, by the positions of the moving nodes.

        Collective over partitions. The weights that several partitions give to one node are added, and each partition
        gets the whole derivative.

        Parameters
        ----------
        weights : (n, d) or (c, n, d) array
            Derivative of an objective by the positions of this partition's nodes; or c derivatives at once.
        what, timeout
            The same as for :meth:`tangent`.

        Returns
        -------
        (k, d) or (c, k, d) array
            Derivative by the positions of the moving nodes (:attr:`moving_nodes`).

        Raises
        ------
        InvalidInput, SessionError
            As :meth:`tangent` does.
        """
        seconds, own = timeout or self._compute_timeout, self._own_cells_if_here()
        count = None if self._mesh is None else len(self._mesh.points)
        rows, many = self._columns(weights, count, "weights")

        def ask(state: Literal["trial", "committed"]) -> CotangentFound:
            given = {"weights": rows} if own is None else own.counted(rows, self.step + (state == "trial"))
            return self._courier.deliver(Cotangent(**self._address, what=state, **given), CotangentFound, seconds)

        return self._vectors(self._at_state(ask, what, own, seconds).weights, many=many)

    def _at_state(
        self,
        ask: Callable[[Literal["trial", "committed"]], _Found],
        what: Literal["trial", "committed"] | None,
        own: OwnCells | None,
        seconds: float,
    ) -> _Found:
        """Get a result at a state; if the client has the volume, both sides first get the correction of that state."""
        state = what or self._latest_state
        if own is not None and state == "committed" and not own.knows(self.step):
            self.points(timeout=seconds)
        try:
            return ask(state)
        except SessionError as error:
            if own is None or state == "trial" or error.details.get("missing") != "region":
                raise
        own.forget()  # the server was restarted, and all partitions get this answer
        self.points(timeout=seconds)
        return ask(state)

    def state_of(self, step: int, iteration: int) -> Literal["trial", "committed"]:
        """Return where the trial of this step and iteration is now: "trial" or "committed".

        Raises
        ------
        SessionError
            If the trial was replaced or dropped, or a later step is committed.
        """
        if (self.step + 1, self.iteration) == (step, iteration):
            return "trial"
        if self._committed == (step, iteration):
            return "committed"
        raise SessionError(
            f"the trial of step {step}, iteration {iteration}, is not where the session is",
            hint="differentiate a trial before the next move replaces it, a committed one before the next commit",
        )

    @property
    def _latest_state(self) -> Literal["trial", "committed"]:
        return "trial" if self.iteration else "committed"

    def _columns(self, values: ArrayLike, count: int | None, name: str) -> tuple[NDArray[np.float64], bool]:
        """Return (m, c d) rows of one vector (m, d) or of c vectors (c, m, d), and whether there were c vectors."""
        given = real_numbers(values, name)
        many, d = given.ndim == 3, self.dimension
        wrong = given.ndim not in (2, 3) or given.shape[-1] != d or (many and not len(given))
        if wrong or (count is not None and given.shape[-2] != count):
            rows = "n" if count is None else count
            raise InvalidInput(f"{name}: expected shape ({rows}, {d}) or (c, {rows}, {d}), c ≥ 1, got {given.shape}")
        stacked = given if many else given[None]
        return np.ascontiguousarray(np.moveaxis(stacked, 0, 1).reshape(given.shape[-2], len(stacked) * d)), many

    def _vectors(self, rows: NDArray[np.float64], *, many: bool) -> NDArray[np.float64]:
        found = np.moveaxis(rows.reshape(len(rows), rows.shape[1] // self.dimension, self.dimension), 1, 0)
        return np.ascontiguousarray(found) if many else found[0]

    def commit(self, *, time: float | None = None, final_step: int = 0, timeout: float | None = None) -> Committed:
        """Make the trial the committed state; when this returns, the session is durable up to :attr:`durable_step`.

        Parameters
        ----------
        time : float, optional
            Time of the step, seconds; by default the time of its last move, if any.
        final_step : int
            The last step of the run, if it is known: the monitor then shows when the run ends.
        timeout : float, optional
            Seconds for this call.

        Raises
        ------
        StepsLost
            With durability "relaxed", possible in every call: the server crashed, and committed steps are lost.
        """
        of_move = next((request.time for request in self._courier.trial if isinstance(request, Move)), None)
        commit = Commit(**self._address, step=self.step + 1, time=time, final_step=final_step)
        committed = self._courier.deliver(commit, messages.Committed, timeout or self._compute_timeout)
        self._committed, self.time = (committed.step, self.iteration), of_move if time is None else float(time)
        self._courier.step, self._courier.iteration, self._courier.trial = committed.step, 0, ()
        if self._own_cells is not None:
            self._own_cells.keep(committed.step)
        self.durable_step = committed.durable_step
        return Committed(**vars(committed))

    def rollback(self, *, timeout: float | None = None) -> None:
        """Drop the trial."""
        rollback = Rollback(**self._address, step=self.step + 1)
        self._courier.deliver(rollback, RolledBack, timeout or self._compute_timeout)
        self._courier.iteration, self._courier.trial = 0, ()

    def forget_correction(self) -> None:
        """Let the next :meth:`points` ask for the correction of the committed state, as after a resume.

        All partitions must then call it. Used when another rank has joined the session again.
        """
        if self._own_cells is not None:
            self._own_cells.forget()

    def points(self, what: Frame = "committed", *, timeout: float | None = None) -> NDArray[np.float64]:
        """(n, d) coordinates of this partition's nodes, committed or of the reference mesh."""
        fetch, own = Fetch(**self._address, what=what), self._own_cells_if_here()
        fetched = self._courier.deliver(fetch, Fetched, timeout or self._timeout)
        return fetched.points if own is None else own.coordinates(fetched, timeout or self._compute_timeout)

    def status(self, *, timeout: float | None = None) -> StatusReport:
        """Ask the server for the session's state, step, iteration and counters."""
        return self._courier.deliver(Status(**self._address), StatusReport, timeout or self._timeout)

    def description(self) -> list[str]:
        """The session's state, its mesh, and its settings."""
        settings = ", ".join(f"{name} {value}" for name, value in self.settings.items() if name in _SHOWN)
        state = "closed" if self._closed else f"iteration {self.iteration}" if self.iteration else "no trial"
        return [
            f"Session {self.credentials.session[:8]}: step {self.step}, {state}",
            f"{self.dimension}D, {len(self.moving_nodes)} moving nodes" + (f": {settings}" if settings else ""),
            *(self._mesh.description() if self._mesh else ["resumed: the mesh is with the server"]),
            *(f"warning: {text}" for text in self.mesh_report.get("warnings", ())),
        ]

    def plot(self) -> Any:
        """Draw the committed mesh. See :func:`.display.draw`.

        Raises
        ------
        InvalidInput
            If the session was resumed, so that its cells are not known here.
        """
        if self._mesh is None:
            raise InvalidInput("a resumed session has no cells to draw", hint="mesh-motion plot FOLDER draws it")
        return draw(self._mesh, self.points(), f"step {self.step}")

    def close(self, outcome: Literal["keep", "discard"] = "keep") -> None:
        """End the use of the session. ``keep`` leaves it resumable, ``discard`` deletes it. Idempotent."""
        if self._closed:
            return
        self._closed = True
        try:
            if self.dimension:
                self._courier.deliver(Close(**self._courier.address, outcome=outcome), Closed, self._timeout)
        except SessionError as error:
            if error.code != "ABORTED.FENCED":  # another holder has the session, so this one must not end it
                raise
        finally:
            self.leave()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, _: TracebackType | None) -> None:
        if kind is None:
            self.close()
            return
        try:
            self.close()
        except MeshMotionError as second:
            if error is not None:
                error.add_note(f"closing the session failed as well: {second}")
