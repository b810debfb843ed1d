"""One session: the only mutable state of the server.

Every operation computes on values and then swaps one reference, so that a failure in between changes nothing. What was
computed but not committed is the *trial*; a Move always starts from the committed state, so its answer is a pure
function of mesh, committed state, displacement and settings (and of how much of the quality it reports, and whether it
is the step's first).

The displacement that a Move answers with, added to the coordinates of its frame, gives the trial's coordinates bitwise:
a client that adds up the answers holds the server's coordinates.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache, partial
from typing import TYPE_CHECKING, cast

import numpy as np
from mesh_motion_numerics.arrays import Floats, Integers
from mesh_motion_numerics.distributed.field import Field
from mesh_motion_numerics.distributed.region import Region
from mesh_motion_numerics.mesh.cells import CellBlock
from mesh_motion_numerics.mesh.swept_volumes import swept_by_cells, swept_volumes
from mesh_motion_numerics.motion.acceptance import quality_warnings, refuse_unacceptable
from mesh_motion_numerics.motion.time_levels import STORED_ARRAYS, TimeLevel, scheme_velocity
from mesh_motion_numerics.quality.quality_summary import QualitySummary
from mesh_motion_protocol.digests import state_digest
from mesh_motion_protocol.errors import DataLoss, SessionError

from mesh_motion_server.failpoints import failpoint
from mesh_motion_server.session.corrections import CorrectedRegion, CorrectOutcome, correct, first_extent, is_good
from mesh_motion_server.session.factors import FactorCache
from mesh_motion_server.session.field_slope import FieldCotangent, FieldSlope, FieldTangent
from mesh_motion_server.session.history import History
from mesh_motion_server.session.journal.durability import keeper_of, logged_failure
from mesh_motion_server.session.journal.ledger import Commit
from mesh_motion_server.session.journal.replies import RequestId
from mesh_motion_server.session.model import Model, ModelBuilder, Slope, checked_model, model_of
from mesh_motion_server.session.motions import compute
from mesh_motion_server.session.partitions.merging import check_boundary, merge
from mesh_motion_server.session.partitions.meshes import MergedMesh
from mesh_motion_server.session.partitions.uploads import MeshUpload, Part
from mesh_motion_server.session.position import WRITING, Position
from mesh_motion_server.session.replay import Progress, boundary_input, restore, silent
from mesh_motion_server.session.state import (
    CommittedState,
    MoveInput,
    Operation,
    State,
    Trial,
    durable_rows,
    state_after,
)
from mesh_motion_server.session.store import SessionFolder
from mesh_motion_server.session.values import Built, CommitOutcome, CurrentState, MoveOutcome, VelocityAsked, Verdict
from mesh_motion_server.settings import ServerSettings

if TYPE_CHECKING:
    from mesh_motion_numerics.motion.boundary_motion import BoundaryMotion
    from mesh_motion_numerics.quality.headroom import Headroom

__all__ = ["Session"]


class Session(Position):
    """A session and its folder.

    Parameters
    ----------
    folder : SessionFolder
        Held by this process.

    Attributes
    ----------
    history : History
        For people to read; nothing depends on it.
    """

    def __init__(self, folder: SessionFolder, limits: ServerSettings, build_model: ModelBuilder) -> None:
        super().__init__(folder.spec)
        self._folder = folder
        self._limits = limits
        self._build_model = build_model if self.spec.evaluation == "server" else None
        self.upload = MeshUpload(
            self.spec.dimension, self.spec.partitions, limits.max_session_bytes, self.spec.evaluation
        )
        self.factors = FactorCache(limits.factor_cache_bytes)
        self._latest_slope: tuple[Floats, Slope] | None = None
        self._latest_field_slope: tuple[Floats, FieldSlope] | None = None
        self._corrected: list[tuple[Floats, CorrectedRegion]] = []  # of the trial and the committed state
        self.history = History(folder.path, limits.history_bytes, limits.reserve_disk_bytes)

    @classmethod
    def reopen(
        cls, folder: SessionFolder, limits: ServerSettings, build_model: ModelBuilder, progress: Progress = silent
    ) -> Session:
        """A stored session at its last durable step, under a new epoch; calls ``progress`` for steps computed again.

        Raises
        ------
        DataLoss
            If what is stored does not verify, or the disk fails; DATA_LOSS.RECOVERY_DIVERGED if the states behind the
            last stored one cannot be computed again.
        """
        session = cls(folder, limits, build_model)
        journal, partitions = folder.load()
        try:
            failpoint("session.reopen.start")
            mesh = merge(partitions)
            method = session.spec.settings.to_method()
            model = model_of(session._build_model, mesh, method)
            field = session._field_at_rest(mesh, model)
            rest = session._at_rest(mesh, field)
            committed = restore(journal, model, mesh, session.factors, rest, progress, spec=session.spec)
            failpoint("session.reopen.restored")
            session._epoch = journal.raise_epoch()
        except BaseException:
            journal.close()
            raise
        session._built = Built(mesh, model, keeper_of(journal), field)
        session._reopened = True
        session._now = CurrentState(State.READY, committed, trial_lost=True)
        return session

    # --- operations ------------------------------------------------------------------------------------------------

    def add_part(self, partition: int, part: Part) -> int:
        """Append a part of the mesh; returns the rows of its item and name so far."""
        state = self.admit(Operation.UPLOAD)
        rows = self.upload.add(partition, part)
        failpoint("session.upload.taken")
        self._swap(state=state)
        return rows

    def needed_for_layers(self, reach: float) -> tuple[float, Floats]:
        """About which nodes the cells are needed before the mesh is built; 0: they are here, up to the ``reach``.

        Returns
        -------
        float, (f, d, d) array; mesh length unit
            Nodes within this distance of these facets of the moving walls.
        """
        # imported here: no other session needs it, and it loads much
        from mesh_motion_numerics.motion.boundary_motion import reach_of_layers  # noqa: PLC0415

        self.admit(Operation.BUILD)
        mesh = merge(self.upload.meshes())
        method = self.spec.settings.to_method()
        needed, wall = reach_of_layers(mesh.points, mesh.facets, mesh.near, mesh.patches, method)
        return (needed, wall) if needed > reach else (0.0, wall)

    def build(self) -> None:
        """The mesh is complete: check it, make it durable.

        Raises
        ------
        InvalidInput
            If it is unusable; in the numbering of the upload.
        ResourceExhausted
            If the disk does not take it.
        """
        state = self.admit(Operation.BUILD)
        partitions = self.upload.meshes()
        with self._folder.writing_mesh(partitions):
            mesh = merge(partitions)
            model = checked_model(self._build_model, mesh, self.spec.settings.to_method())
            field = self._field_at_rest(mesh, model)
            committed = self._at_rest(mesh, field)
            failpoint("session.build.checked")
        rows = len(mesh.points) * (1 + STORED_ARRAYS[self.spec.time_levels])
        rows += 0 if field is None else len(field.coefficients)
        journal = self._folder.build(partitions, rows, self._limits.snapshot_steps, epoch=self._epoch)
        failpoint("session.build.stored")
        self._built = Built(mesh, model, keeper_of(journal), field)
        self._now = CurrentState(state, committed)
        self.upload.clear()

    def move(
        self,
        frame: str,
        boundary_displacements: Sequence[Floats],
        *,
        report: str = "",
        time: float | None = None,
        velocity: VelocityAsked | None = None,
    ) -> MoveOutcome:
        """Compute a trial.

        Parameters
        ----------
        frame : {"committed", "reference"}
        boundary_displacements : one (k_p, d) array per partition, mesh length unit
            Of the moving nodes, since the frame's coordinates.
        report : {"", "faces"}
            What the outcome reports in addition to the quality.
        time : float, optional
            Of the step, seconds.
        velocity : VelocityAsked, optional
            Velocities that are wanted too; :meth:`require_velocity` admits them.

        Raises
        ------
        InvalidInput
            If partitions disagree about a node, or a target is not finite.
        QualityRefused
            If no acceptable motion was found, or this one has no derivative where a tangent is wanted; an earlier trial
            stays.
        """
        state = self.admit(Operation.MOVE)
        failpoint("session.move.start")
        built = self._require_built()
        move_input = MoveInput(frame, built.mesh.gather_moving(boundary_displacements))
        in_full = not self.iteration  # the distributions take half of a later iteration
        model = built.model if in_full else built.model.without_distributions()
        computed = compute(model, built.mesh, self.coordinates("committed"), move_input, self.factors)
        field = computed.field
        judged = computed.motion.corrected if computed.exact and in_full and field is None else None
        coefficients = None if field is None else field.coefficients
        trial = Trial(self.step + 1, self.iteration + 1, computed.points, judged, move_input, coefficients, time=time)
        velocities = None if velocity is None else self._velocities(trial, velocity)
        measured = (built.faces, built.faces_at(trial.points)) if report == "faces" else ()
        faces = tuple(filter(None, measured))
        failpoint("session.move.computed")
        self._swap(state=state, trial=trial)
        return MoveOutcome(
            trial.step, trial.iteration, computed.motion, computed.displacements, faces, field, velocities
        )

    def _velocities(self, trial: Trial, asked: VelocityAsked) -> Floats:
        """Velocities (n, d) of all nodes."""
        if asked.scheme == "tangent":
            return self._slope_at(trial.points).tangent(self._gather_velocities(asked.boundary))
        before, time = self._committed_state, cast(float, asked.time)
        return scheme_velocity(asked.scheme, trial.points, before.points, before.level, time)

    def headroom(self, along: str, velocity: Floats | None = None) -> Headroom:
        """How far the mesh admits that all nodes go on from the trial.

        Parameters
        ----------
        along : {"step", "displacement", "velocity"}
            In multiples of the way from the committed state, or of that from the reference mesh; or in seconds of the
            trial's ``velocity`` (n, d).
        """
        points = self._open_trial.points
        if velocity is not None and along == "velocity":
            return self.model.headroom(velocity, points)
        before = self._committed_state.points if along == "step" else self.mesh.points
        return self.model.headroom(points - before, points)

    def swept(self, partition: int, faces: Integers | None) -> Floats:
        """Volumes that faces of a partition sweep from the committed state to the trial, length unit to the power d.

        Parameters
        ----------
        faces : (f, k) int64 array, optional
            The partition's own nodes of each face, filled up with -1; by default all faces of its cells, type after
            type, each cell's one after the other, outwards.

        Returns
        -------
        (f,) array
        """
        built, before, after = self._require_built(), self._committed_state.points, self._open_trial.points
        if faces is not None:
            own = np.append(built.mesh.node_maps[partition], -1)
            return swept_volumes(before, after, own[faces])
        found = []
        cells, signs = built.listed_cells
        for block, sign, origin in zip(cells, signs, built.mesh.cell_origins, strict=True):
            rows = origin.rows_of(partition)
            listed = CellBlock(block.type, block.nodes[rows])
            found.append((sign[rows, None] * swept_by_cells(before, after, listed)).reshape(-1))
        return np.concatenate(found)

    def require_slope(self, operation: Operation, what: str) -> None:
        """Raise unless the motion can be differentiated at the trial or the committed state.

        Raises
        ------
        SessionError
            If the state does not allow it, or there is no trial.
        InvalidInput
            If the method, or this kind of session, has no derivative.
        """
        self.admit(operation)
        self._points_of(what)
        refusal = self.model.why_no_slope()
        if refusal is not None:
            raise refusal

    def tangent(self, what: str, velocities: Sequence[Floats]) -> list[Floats]:
        """Velocities (n_p, c d) of each partition's nodes for those (k_p, c d) of its moving nodes.

        Parameters
        ----------
        what : {"trial", "committed"}
        velocities : one (k_p, c d) array per partition
            The components of c vectors, one after the other.

        Raises
        ------
        InvalidInput
            If partitions disagree about a node.
        QualityRefused
            If this mesh was corrected by another correction than the smooth one.
        """
        mesh = self.mesh
        given = self._gather_velocities(velocities)
        found = self._by_vector(given, self._slope(what).tangent)
        return [mesh.scatter(found, partition) for partition in range(len(velocities))]

    def cotangent(self, what: str, weights: Sequence[Floats]) -> list[Floats]:
        """Weights (k_p, c d) of each partition's moving nodes for those (n_p, c d) of its nodes.

        Those that several partitions give to one node are added; each of them gets the sum.
        """
        mesh = self.mesh
        found = self._by_vector(mesh.gather_sums(weights), self._slope(what).cotangent)
        return mesh.scatter_moving(found)

    def field_tangent(self, what: str, velocities: Sequence[Floats]) -> FieldTangent:
        """As :meth:`tangent`, of a session whose volume is with the client: of the field, and of the freed nodes."""
        slope = self._field_slope(what)
        found = [slope.tangent(one) for one in self._vectors(self._gather_velocities(velocities))]
        rows = ([getattr(one, name) for one in found] for name in ("velocity", "coefficients", "of_freed"))
        velocity, coefficients, of_freed = (np.concatenate(each, axis=1) for each in rows)
        return FieldTangent(velocity, coefficients, found[0].freed, of_freed)

    def field_cotangent(self, what: str, given: FieldCotangent) -> list[Floats]:
        """As :meth:`cotangent`, of a session whose volume is with the client."""
        slope, found = self._field_slope(what), []
        parts = (self._vectors(rows) for rows in (given.weights, given.coefficients, given.of_ids))
        for weights, coefficients, of_ids in zip(*parts, strict=True):
            found.append(slope.cotangent(FieldCotangent(weights, coefficients, given.ids, of_ids)))
        return self.mesh.scatter_moving(np.concatenate(found, axis=1))

    def judge(self, quality: QualitySummary) -> Verdict:
        """Take the quality of the trial's cells, which are with the client.

        Raises
        ------
        QualityRefused
            If the quality is not acceptable; the trial stays, and cannot be committed.
        """
        self.require_client_evaluation()
        state, method, trial = self.admit(Operation.JUDGE), self.model.method, self._open_trial
        if trial.correction is None and not is_good(method, quality):
            self._swap(state=state, trial=replace(trial, standard=quality))
            return Verdict(quality, first_extent(method, self.spec.dimension))
        reached = quality.metric.min >= method.quality_threshold
        refuse_unacceptable(method, quality, reached)
        self._swap(state=state, trial=replace(trial, quality=quality))
        further = () if trial.correction is None else trial.correction.warnings
        warnings = [*quality_warnings(method, quality, reached), *further]
        return Verdict(trial.standard or quality, None, warnings, trial.correction)

    def correct(self, what: str, regions: Sequence[Region]) -> CorrectOutcome:
        """Correct the region that the ranks send.

        Parameters
        ----------
        what : {"trial", "committed"}
            Committed coordinates that were corrected are so again, and bitwise the same.
        regions : sequence of Region
            One of each partition; ids are global.

        Raises
        ------
        QualityRefused
            If no valid mesh was found; the trial stays, and cannot be committed.
        """
        self.require_client_evaluation()
        state, built = self.admit(Operation.CORRECT if what == "trial" else Operation.FETCH), self._require_built()
        of: Trial | CommittedState | None = self._open_trial if what == "trial" else self._now.committed
        if built.field is None or of is None or of.coefficients is None:
            raise SessionError("nothing is committed yet", hint="send MOVE first")
        field = replace(built.field, coefficients=of.coefficients)
        found = correct(built.mesh, built.model, of.points, field, regions, self.factors)
        if found.extent is None and found.region is not None:
            held = [each.points for each in (self._now.trial, self._now.committed) if each is not None]
            kept = [one for one in self._corrected if one[0] is not of.points and any(one[0] is at for at in held)]
            self._corrected = [*kept, (of.points, found.region)]
        if isinstance(of, Trial) and found.extent is None:
            self._swap(state=state, trial=replace(of, correction=found.correction, quality=None))
        return found

    def commit(
        self, requests: Sequence[RequestId], receipt: Callable[[CommitOutcome], bytes], *, time: float | None = None
    ) -> CommitOutcome:
        """Make the trial the committed state, durably as the session's level says.

        Parameters
        ----------
        requests : sequence of RequestId
            The COMMIT of each partition.
        receipt : callable
            What the replies say, packed: journaled with the commit.
        time : float, optional
            Of the step, seconds; by default that of the trial.

        Raises
        ------
        DataLoss
            If the disk failed; the session is then FROZEN at its last committed step.
        """
        state = self.admit(Operation.COMMIT)
        built, trial = self._require_built(), self._open_trial
        failpoint("session.commit.start")
        time = trial.time if time is None else time
        next_state = state_after(self._committed_state, trial, self.spec.time_levels, time)
        durable = durable_rows(built.mesh, next_state)
        self._write(lambda: built.keeper.prepare(durable), self._now)  # the disk works while the state is judged
        digest = state_digest(trial.step, durable)
        quality = built.model.summary(trial.points) if trial.quality is None else trial.quality
        outcome = CommitOutcome(
            trial.step, built.keeper.durable_after(trial.step), digest, quality, next_state.corrected, next_state.level
        )
        entry = Commit(trial.step, digest, tuple(requests), receipt(outcome))
        after = CurrentState(state, next_state)
        boundary = cache(partial(boundary_input, built.mesh, trial.input))  # for history and journal
        # first: no answered step may lack it
        self.history.tell_input(trial.step, boundary, self.spec.dimension, next_state.level.time)

        def store() -> None:
            built.keeper.commit(entry, durable, boundary)
            failpoint("session.commit.durable")

        self._write(store, after)
        self.factors.next_step()
        return outcome

    def rollback(self) -> None:
        """Drop the trial, if any."""
        failpoint("session.rollback.start")
        self._swap(state=self.admit(Operation.ROLLBACK), trial=None, trial_lost=False)

    def resume(self) -> int:
        """A new holder: make all commits durable, raise the epoch durably, drop the trial; returns the epoch.

        Raises
        ------
        SessionError
            If the state does not allow it: the session must be opened again, in another process.
        DataLoss
            If the disk failed; the session is then FROZEN.
        """
        state = self.admit(Operation.RESUME)
        if self._built is None:
            self._epoch += 1
            return self._epoch
        self.catch_up()
        self._epoch = self._built.keeper.journal.raise_epoch()
        failpoint("session.resume.raised")
        self._swap(state=state, trial=None, trial_lost=True)
        return self._epoch

    def catch_up(self) -> None:
        """Return when all commits are durable, or the failure was already reported.

        Raises
        ------
        DataLoss
            If the disk failed, and no request has been refused for it yet; the session is FROZEN, or FAILED as it was.
        """
        if self._built is None or self._now.disk_failure_reported or self._now.state in (State.FROZEN, State.CLOSED):
            return
        try:
            self._built.keeper.catch_up()
        except DataLoss:
            self._swap(
                state=State.FAILED if self._now.state is State.FAILED else State.FROZEN, disk_failure_reported=True
            )
            raise

    def suspend(self) -> None:
        """The lease ended: all commits become durable, or the session FROZEN."""
        with logged_failure(self.spec.session):
            self.catch_up()
        state = self.admit(Operation.LEASE_END)
        failpoint("session.suspend")
        lost = self._now.trial is not None or self._now.trial_lost
        keep = self._now.trial if state is not State.SUSPENDED else None
        self._swap(state=state, trial=keep, trial_lost=lost and keep is None)

    def join(self) -> None:
        """A holder has joined (again)."""
        self._swap(state=self.admit(Operation.JOIN))

    def fail(self) -> None:
        """An unexpected failure happened that may affect the state."""
        self._swap(state=State.FAILED, trial=None)

    def close(self, *, keep: bool = True) -> None:
        """Give files and lock back; idempotent. What is to be kept becomes durable before, unless the disk failed."""
        if keep and self._built is not None:
            with logged_failure(self.spec.session):
                if self.state in WRITING:
                    self._built.keeper.rest(self._durable_rows)
                elif self.state is State.FAILED:
                    self.catch_up()  # no state is made of coordinates that are not trusted
        self._swap(state=State.CLOSED, trial=None)
        failpoint("session.close")
        self.history.close()
        self.factors.clear()
        if self._built is not None:
            self._built.keeper.close()
        self._folder.release()

    # --- inside ----------------------------------------------------------------------------------------------------

    def _slope(self, what: str) -> Slope:
        """The derivative at the trial or the committed state."""
        return self._slope_at(self._points_of(what))

    def _slope_at(self, points: Floats) -> Slope:
        """The derivative of the motion that has led to ``points`` (n, d); that of the last time, if it was there."""
        if self._latest_slope is None or self._latest_slope[0] is not points:
            self._latest_slope = points, self.model.slope(points, self.factors)
        return self._latest_slope[1]

    def _field_slope(self, what: str) -> FieldSlope:
        """The same of a session whose volume is with the client."""
        points, built = self._points_of(what), self._require_built()
        of = self._open_trial if what == "trial" else self._committed_state
        corrected = None
        if built.model.method.correction != "none" and of.step:
            corrected = next((region for at, region in self._corrected if at is points), None)
            if corrected is None:
                raise SessionError(
                    f"the region in which the {what} mesh was corrected is not known here",
                    code="FAILED_PRECONDITION",
                    hint="send JUDGE and CORRECT of the trial first; of the committed mesh CORRECT, as after a resume",
                    details={"missing": "region"},
                )
        if self._latest_field_slope is None or self._latest_field_slope[0] is not points:
            model, field = cast("BoundaryMotion", built.model), cast(Field, built.field)
            slope = FieldSlope(built.mesh, model, field, points, corrected, self.factors)
            self._latest_field_slope = points, slope
        return self._latest_field_slope[1]

    def _points_of(self, what: str) -> Floats:
        """(n, d) coordinates of the "trial" or the "committed" state."""
        if what == "trial":
            self.refuse_lost_trial()
        return self._open_trial.points if what == "trial" else self.coordinates("committed")

    def _gather_velocities(self, velocities: Sequence[Floats]) -> Floats:
        """(k, c) velocities of the moving nodes from each partition's rows (k_p, c)."""
        return self.mesh.gather_moving(velocities, max(float(np.abs(rows).max(initial=0.0)) for rows in velocities))

    def _at_rest(self, mesh: MergedMesh, field: Field | None) -> CommittedState:
        """The mesh as it was uploaded."""
        coefficients = None if field is None else field.coefficients
        return CommittedState(0, mesh.points, coefficients, level=TimeLevel(self.spec.time))

    def _by_vector(self, given: Floats, apply: Callable[[Floats], Floats]) -> Floats:
        """(m, c d) what ``apply`` makes of each of the c vectors (k, d) that are columns of ``given`` (k, c d)."""
        return np.concatenate([apply(one) for one in self._vectors(given)], axis=1)

    def _vectors(self, given: Floats) -> list[Floats]:
        """The c vectors (k, d) that are columns of ``given`` (k, c d)."""
        d = self.spec.dimension
        return [np.ascontiguousarray(given[:, i : i + d]) for i in range(0, given.shape[1], d)]

    def _field_at_rest(self, mesh: MergedMesh, model: Model) -> Field | None:
        """The field of a mesh that does not move, if the client evaluates it."""
        if self.spec.evaluation == "server":
            return None
        check_boundary(mesh)
        rest = MoveInput("reference", np.zeros((len(mesh.moving), mesh.points.shape[1])))
        return compute(model, mesh, mesh.points, rest, self.factors).field

    def _durable_rows(self) -> Floats:
        """The committed state as a commit stores it."""
        return durable_rows(self.mesh, self._committed_state)

    def _write(self, write: Callable[[], None], after: CurrentState) -> None:
        """Swap to COMMITTING, write, then swap to the state after success or failure."""
        before = self._now
        self._swap(state=State.COMMITTING)
        try:
            write()
        except DataLoss:
            self._now = replace(before, state=State.FROZEN) if self._require_built().keeper.frozen else before
            raise
        except BaseException:
            self.fail()
            raise
        self._now = after
