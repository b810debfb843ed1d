"""A session: move, commit, rollback, and where its nodes are."""

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

#: Settings that a description names.
_SHOWN = ("support_radius", "correction", "quality_threshold", "displacement")

#: Of computing, in seconds: about 30 years.
_LONGEST_LIMIT = 1e9

_Found = TypeVar("_Found")

Frame = Literal["committed", "reference"]
Report = Literal["", "faces", "swept"]
HeadroomAlong = Literal["step", "displacement", "velocity"]
Scheme = Literal["", "tangent", "bdf1", "bdf2", "bossak"]


class Session(OpenedSession):
    """One partition's view of a session; used by one thread. Made by :class:`.server.Server`.

    Attributes
    ----------
    credentials : Credentials
        What resumes the session from elsewhere: save it.
    partition : int
    step : int
        The last committed step.
    durable_step : int
        The step that no crash and no power loss takes the session back behind, as the last commit reported it: with
        durability "relaxed" it follows :attr:`step` at a distance. :meth:`status` has the newest.
    iteration : int
        Moves of the step under way, 0 = none.
    moving_nodes : (k,) int array
        The nodes whose displacement every move gives, ascending.
    settings : Settings
        The settings in force, as BUILT reported them; empty in a session that was resumed.
    mesh_report : dict
        What BUILT said of the mesh; empty in a session that was resumed.
    quality : QualitySummary or None
        Of the mesh as it was uploaded; None in a session that was resumed.
    derivatives : bool or None
        Whether :meth:`tangent` and :meth:`cotangent` are answered; None in a session that was resumed.
    time : float or None
        Of the last committed step, seconds; None if it is not known.
    """

    @property
    def step(self) -> int:
        """The last committed step."""
        return self._courier.step

    @property
    def iteration(self) -> int:
        """Moves of the step under way, 0 = none."""
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
            What the displacements count from: the reference mesh for totals, which structural codes have, or the
            committed state for increments.
        report : {"", "faces", "headroom", "swept"}
            "faces": add what a finite-volume code sees, ``faces["before"]`` and ``faces["after"]`` of the reply;
            it takes time, ask once a step. "headroom", and with "faces" too: how many more such steps the mesh admits,
            until a cell inverts and until the threshold, ``headroom`` of the reply. "swept": the volume that each face
            sweeps in this step, ``swept`` of the reply and :meth:`.moved.Moved.swept_of_cells`.
        headroom_along : {"step", "displacement", "velocity"}
            What the headroom counts, every node going on so: such steps; multiples of the whole displacement since the
            reference mesh; or seconds of ``velocity``.
        time : float, optional
            Of the step: at its end, seconds. Later than :attr:`time`.
        velocity : {"", "tangent", "bdf1", "bdf2", "bossak"}
            Scheme of the nodes' velocities in ``velocity`` of the reply; "bdf2" and "bossak" in a session that was
            opened with this as its ``time_levels``.
        boundary_velocity : (k, d) array or dict, optional
            With "tangent", and only with it: the velocities of the moving nodes, given as the displacements are.
        swept_faces : (f, k) integer array, optional
            With "swept": the nodes of each face, in space anticlockwise as seen from where its normal points to, filled
            up with -1; of an edge in a plane the normal is on its right. By default all faces of the cells, outwards.
        compute_limit : float
            Seconds after which the server gives up computing; 0: never. Without it the server goes on where ``timeout``
            ends this call, and repeating the call gets the answer.
        timeout : float, optional
            Seconds for this call.

        Returns
        -------
        Moved
            ``displacement`` (n, d) in ``frame``, ``quality``, ``correction``, ``warnings``, ``seconds``, …; where asked
            for, ``velocity`` (n, d) and ``swept`` (f,).

        Raises
        ------
        QualityRefused
            If no acceptable mesh was found; the session is as before, except that an earlier trial is lost where the
            client evaluates the volume.
        InvalidInput, SessionError, Unavailable, Timeout
            Timeout too if the server gave up. SessionError too if a time level or a derivative is missing.
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
            Of the moving nodes (:attr:`moving_nodes`), in any unit of length per anything; c vectors at once.
        what : {"trial", "committed"}, optional
            The state at which the motion is differentiated; by default the open trial if there is one.
        timeout : float, optional
            Seconds for this call.

        Returns
        -------
        (n, d) or (c, n, d) array
            Of this partition's nodes.

        Raises
        ------
        InvalidInput
            If a shape is wrong, or the method has no derivative (:attr:`derivatives`): the message names the key.
        SessionError
            If this mesh was corrected by another correction than the smooth one.
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

        Collective over partitions. What several of them give to one node is added, and each gets the whole derivative.

        Parameters
        ----------
        weights : (n, d) or (c, n, d) array
            Of this partition's nodes: the derivative of an objective by their positions; c of them at once.
        what, timeout
            As for :meth:`tangent`.

        Returns
        -------
        (k, d) or (c, k, d) array
            Of the moving nodes (:attr:`moving_nodes`).

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
        """What is found at a state; where the volume is here, its correction is known on both sides first."""
        state = what or self._latest_state
        if own is not None and state == "committed" and not own.knows(self.step):
            self.points(timeout=seconds)
        try:
            return ask(state)
        except SessionError as error:
            if own is None or state == "trial" or error.details.get("missing") != "region":
                raise
        own.forget()  # the server was started again, and all partitions get this answer
        self.points(timeout=seconds)
        return ask(state)

    def state_of(self, step: int, iteration: int) -> Literal["trial", "committed"]:
        """Where the trial of a step's iteration is now.

        Raises
        ------
        SessionError
            If it was replaced or dropped, or a later step is committed.
        """
        if (self.step + 1, self.iteration) == (step, iteration):
            return "trial"
        if self.iteration == 0 and self._committed == (step, iteration):
            return "committed"
        raise SessionError(
            f"the trial of step {step}, iteration {iteration}, is not where the session is",
            hint="differentiate a trial before the next move, or before the next step is committed",
        )

    @property
    def _latest_state(self) -> Literal["trial", "committed"]:
        return "trial" if self.iteration else "committed"

    def _columns(self, values: ArrayLike, count: int | None, name: str) -> tuple[NDArray[np.float64], bool]:
        """(m, c d) rows of a vector (m, d) or of c of them (c, m, d), and whether it is the latter."""
        given = real_numbers(values, name)
        many, d = given.ndim == 3, self.dimension
        if given.ndim not in (2, 3) or given.shape[-1] != d or (count is not None and given.shape[-2] != count):
            rows = "n" if count is None else count
            raise InvalidInput(f"{name}: expected shape ({rows}, {d}) or (c, {rows}, {d}), got {given.shape}")
        stacked = given if many else given[None]
        return np.ascontiguousarray(np.moveaxis(stacked, 0, 1).reshape(given.shape[-2], len(stacked) * d)), many

    def _vectors(self, rows: NDArray[np.float64], *, many: bool) -> NDArray[np.float64]:
        found = np.moveaxis(rows.reshape(len(rows), rows.shape[1] // self.dimension, self.dimension), 1, 0)
        return np.ascontiguousarray(found) if many else found[0]

    def commit(self, *, time: float | None = None, final_step: int = 0, timeout: float | None = None) -> Committed:
        """Make the trial the committed state; it is durable up to :attr:`durable_step` when this returns.

        Parameters
        ----------
        time : float, optional
            Of the step, seconds; by default that of its last move, if that had one.
        final_step : int
            The step that the run ends with, as far as it is known now: who watches the session then sees when it ends.
        timeout : float, optional
            Seconds for this call.

        Raises
        ------
        StepsLost
            With durability "relaxed", as any call: the server crashed, and committed steps with it.
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
        """Have the next :meth:`points` ask for the correction of the committed state, as after a resume.

        It is a call of all partitions then. For a rank next to one that has joined the session again.
        """
        if self._own_cells is not None:
            self._own_cells.forget()

    def points(self, what: Frame = "committed", *, timeout: float | None = None) -> NDArray[np.float64]:
        """(n, d) coordinates of this partition's nodes, committed or of the reference mesh."""
        fetch, own = Fetch(**self._address, what=what), self._own_cells_if_here()
        fetched = self._courier.deliver(fetch, Fetched, timeout or self._timeout)
        return fetched.points if own is None else own.coordinates(fetched, timeout or self._compute_timeout)

    def status(self, *, timeout: float | None = None) -> StatusReport:
        """Where the session stands: state, step, iteration, counters."""
        return self._courier.deliver(Status(**self._address), StatusReport, timeout or self._timeout)

    def description(self) -> list[str]:
        """Where it stands, its mesh, and its settings."""
        settings = ", ".join(f"{name} {value}" for name, value in self.settings.items() if name in _SHOWN)
        state = "closed" if self._closed else f"iteration {self.iteration}" if self.iteration else "no trial"
        return [
            f"Session {self.credentials.session[:8]}: step {self.step}, {state}",
            f"{self.dimension}D, {len(self.moving_nodes)} moving nodes" + (f": {settings}" if settings else ""),
            *(self._mesh.description() if self._mesh else ["resumed: the mesh is with the server"]),
            *(f"warning: {text}" for text in self.mesh_report.get("warnings", ())),
        ]

    def plot(self) -> Any:
        """A picture of the committed mesh. See :func:`.display.draw`.

        Raises
        ------
        InvalidInput
            If the session was resumed, so that its cells are not known here.
        """
        if self._mesh is None:
            raise InvalidInput("a resumed session has no cells to draw", hint="mesh-motion plot FOLDER draws it")
        return draw(self._mesh, self.points(), f"step {self.step}")

    def close(self, outcome: Literal["keep", "discard"] = "keep") -> None:
        """End this use. ``keep`` leaves the session resumable, ``discard`` deletes it. Idempotent."""
        if self._closed:
            return
        self._closed = True
        try:
            if self.dimension:
                self._courier.deliver(Close(**self._courier.address, outcome=outcome), Closed, self._timeout)
        except SessionError as error:
            if error.code != "ABORTED.FENCED":  # another holder has it, nothing of it is ours to end
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
