"""One session: the only mutable state of the server.

Every operation computes on values and then swaps one reference, so that a failure in between changes nothing. The
computed but uncommitted state is the *trial*. A Move always starts from the committed state, so its answer is a pure
function of mesh, committed state, displacement and settings (and of the requested quality report, and whether it is the
step's first Move).

The displacement that a Move answers with, added to the coordinates of its frame, gives the trial's coordinates bitwise:
a client that adds up the answers has the server's coordinates.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache, partial

import numpy as np
from mesh_motion_numerics.arrays import Floats
from mesh_motion_numerics.distributed.field import Field
from mesh_motion_numerics.distributed.region import Region
from mesh_motion_numerics.motion.acceptance import refuse_unacceptable
from mesh_motion_numerics.motion.time_levels import STORED_ARRAYS, TimeLevel
from mesh_motion_numerics.quality.quality_summary import QualitySummary
from mesh_motion_protocol.digests import state_digest
from mesh_motion_protocol.errors import DataLoss, SessionError

from mesh_motion_server.failpoints import failpoint
from mesh_motion_server.session.answers import Answers
from mesh_motion_server.session.corrections import CorrectOutcome, correct, first_extent, is_good
from mesh_motion_server.session.factors import FactorCache
from mesh_motion_server.session.history import History
from mesh_motion_server.session.journal.durability import keeper_of, logged_failure
from mesh_motion_server.session.journal.ledger import Commit
from mesh_motion_server.session.journal.replies import RequestId
from mesh_motion_server.session.model import Model, ModelBuilder, checked_model, model_of
from mesh_motion_server.session.motions import compute
from mesh_motion_server.session.partitions.merging import check_boundary, check_near, merge
from mesh_motion_server.session.partitions.meshes import MergedMesh
from mesh_motion_server.session.partitions.uploads import MeshUpload, Part
from mesh_motion_server.session.position import WRITING
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


class Session(Answers):
    """A session and its folder.

    Parameters
    ----------
    folder : SessionFolder
        Held by this process.

    Attributes
    ----------
    history : History
        The history for people; nothing depends on it.
    """

    def __init__(self, folder: SessionFolder, limits: ServerSettings, build_model: ModelBuilder) -> None:
        super().__init__(folder.spec, FactorCache(limits.factor_cache_bytes))
        self._folder = folder
        self._limits = limits
        self._build_model = build_model if self.spec.evaluation == "server" else None
        self.upload = MeshUpload(
            self.spec.dimension, self.spec.partitions, limits.max_session_bytes, self.spec.evaluation
        )
        self.history = History(folder.path, limits.history_bytes, limits.reserve_disk_bytes)

    @classmethod
    def reopen(
        cls, folder: SessionFolder, limits: ServerSettings, build_model: ModelBuilder, progress: Progress = silent
    ) -> Session:
        """Open a stored session at its last durable step, under a new epoch; call ``progress`` for recomputed steps.

        Raises DataLoss if the stored data do not verify, or the disk fails; DATA_LOSS.RECOVERY_DIVERGED if the states
        after the last stored one cannot be recomputed.
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
        """Append a part of the mesh; return the number of rows of its item and name so far."""
        state = self.admit(Operation.UPLOAD)
        rows = self.upload.add(partition, part)
        failpoint("session.upload.taken")
        self._swap(state=state)
        return rows

    def needed_for_layers(self, reaches: Sequence[float]) -> tuple[float, Floats]:
        """The distance from moving walls within which cells are needed before the build.

        The distance is 0 if the needed cells are here, within all ``reaches``. Raises InvalidInput if a reach was not
        requested, or if a node on a moving wall has none of the cells.

        Parameters
        ----------
        reaches : sequence of float, mesh length unit
            For each partition the distance from the moving walls within which it has sent the cells.

        Returns
        -------
        float, (f, d, d) array; mesh length unit
            The cells at nodes within this distance of these facets of the moving walls are needed.
        """
        # imported here: other sessions do not need it, and it is large
        from mesh_motion_numerics.motion.boundary_motion import reach_of_layers  # noqa: PLC0415

        self.admit(Operation.BUILD)
        self.upload.check_reaches(reaches)
        mesh = merge(self.upload.meshes())
        method = self.spec.settings.to_method()
        needed, wall = reach_of_layers(mesh.points, mesh.facets, mesh.near, mesh.patches, method)
        if wall is None:
            return 0.0, np.empty((0, mesh.points.shape[1], mesh.points.shape[1]))
        if min(reaches) > 0.0:
            check_near(mesh, wall.nodes)
        self.upload.reach = needed if needed > min(reaches) else 0.0
        return self.upload.reach, wall.reference[wall.simplices]

    def build(self) -> None:
        """Check the uploaded mesh, and make it durable.

        Raises InvalidInput if the mesh is unusable; in the numbering of the upload. Raises ResourceExhausted if the
        disk cannot store it.
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

        Raises InvalidInput if partitions disagree about a node, or a target is not finite. Raises QualityRefused if no
        acceptable motion was found, or if a tangent is requested but the motion has no derivative; an earlier trial is
        kept.

        Parameters
        ----------
        frame : {"committed", "reference"}
        boundary_displacements : one (k_p, d) array per partition, mesh length unit
            Displacements of the moving nodes since the frame's coordinates.
        report : {"", "faces"}
            Report in addition to the quality.
        time : float, optional
            Time of the step, seconds.
        velocity : VelocityAsked, optional
            Velocities that are also requested; checked by :meth:`require_velocity`.
        """
        state = self.admit(Operation.MOVE)
        failpoint("session.move.start")
        built = self._require_built()
        move_input = MoveInput(frame, built.mesh.gather_moving(boundary_displacements))
        in_full = not self.iteration  # the distributions take half the time of a later iteration
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

    def judge(self, quality: QualitySummary) -> Verdict:
        """Take the quality of the trial's cells, which the client has.

        Raises QualityRefused if the quality is not acceptable; the trial is kept, but cannot be committed.
        """
        self.require_client_evaluation()
        state, method, trial = self.admit(Operation.JUDGE), self.model.method, self._open_trial
        if trial.correction is None and not is_good(method, quality):
            self._swap(state=state, trial=replace(trial, standard=quality))
            return Verdict(quality, first_extent(method, self.spec.dimension))
        reached = quality.metric.min >= method.quality_threshold
        warnings = refuse_unacceptable(method, quality, reached)
        self._swap(state=state, trial=replace(trial, quality=quality))
        further = () if trial.correction is None else trial.correction.warnings
        return Verdict(trial.standard or quality, None, [*warnings, *further], trial.correction)

    def correct(self, what: str, regions: Sequence[Region]) -> CorrectOutcome:
        """Correct the region that the ranks send.

        Raises QualityRefused if no valid mesh was found; the trial is kept, but cannot be committed.

        Parameters
        ----------
        what : {"trial", "committed"}
            Committed coordinates that were corrected are corrected again, with bitwise the same result.
        regions : sequence of Region
            One region from each partition; ids are global.
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
        """Make the trial the committed state, durable according to the session's level.

        Raises DataLoss if the disk failed; the session is then FROZEN at its last committed step.

        Parameters
        ----------
        requests : sequence of RequestId
            The COMMIT of each partition.
        receipt : callable
            Makes the packed content of the replies, which is journaled with the commit.
        time : float, optional
            Time of the step, seconds; by default that of the trial.
        """
        state = self.admit(Operation.COMMIT)
        built, trial = self._require_built(), self._open_trial
        failpoint("session.commit.start")
        time = trial.time if time is None else time
        next_state = state_after(self._committed_state, trial, self.spec.time_levels, time)
        durable = durable_rows(built.mesh, next_state)
        self._write(lambda: built.keeper.prepare(durable), self._now)  # the disk writes while the state is judged
        digest = state_digest(trial.step, durable)
        quality = built.model.summary(trial.points) if trial.quality is None else trial.quality
        outcome = CommitOutcome(
            trial.step, built.keeper.durable_after(trial.step), digest, quality, next_state.corrected, next_state.level
        )
        entry = Commit(trial.step, digest, tuple(requests), receipt(outcome))
        after = CurrentState(state, next_state)
        boundary = cache(partial(boundary_input, built.mesh, trial.input))  # for the history and the journal
        # first, because every answered step must be in the history
        self.history.record_input(trial.step, boundary, self.spec.dimension, next_state.level.time)

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
        """Take a new holder: make all commits durable, raise the epoch durably, drop the trial; return the epoch.

        Raises SessionError if the state does not allow it: the session must be opened again, in another process. Raises
        DataLoss if the disk failed; the session is then FROZEN.
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
        """Return when all commits are durable, or when the failure was already reported.

        Raises DataLoss if the disk failed, and no request has been refused for this reason yet; the session is FROZEN,
        or stays FAILED.
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
        """Suspend the session, whose lease has ended: make all commits durable, or the session FROZEN."""
        with logged_failure(self.spec.session):
            self.catch_up()
        state = self.admit(Operation.LEASE_END)
        failpoint("session.suspend")
        lost = self._now.trial is not None or self._now.trial_lost
        keep = self._now.trial if state is not State.SUSPENDED else None
        self._swap(state=state, trial=keep, trial_lost=lost and keep is None)

    def join(self) -> None:
        """Note that a holder has joined (again)."""
        self._swap(state=self.admit(Operation.JOIN))

    def fail(self) -> None:
        """Note an unexpected failure that may affect the state."""
        self._swap(state=State.FAILED, trial=None)

    def close(self, *, keep: bool = True) -> None:
        """Release files and lock; idempotent. State to be kept is made durable first, unless the disk failed."""
        if keep and self._built is not None:
            with logged_failure(self.spec.session):
                if self.state in WRITING:
                    self._built.keeper.rest(lambda: durable_rows(self.mesh, self._committed_state))
                elif self.state is State.FAILED:
                    self.catch_up()  # no state is made from coordinates that are not trusted
        self._swap(state=State.CLOSED, trial=None)
        failpoint("session.close")
        self.history.close()
        self.factors.clear()
        if self._built is not None:
            self._built.keeper.close()
        self._folder.release()

    # --- inside ----------------------------------------------------------------------------------------------------

    def _at_rest(self, mesh: MergedMesh, field: Field | None) -> CommittedState:
        """The state of the mesh as it was uploaded."""
        coefficients = None if field is None else field.coefficients
        return CommittedState(0, mesh.points, coefficients, level=TimeLevel(self.spec.time))

    def _field_at_rest(self, mesh: MergedMesh, model: Model) -> Field | None:
        """The field of a mesh that does not move, if the client evaluates it."""
        if self.spec.evaluation == "server":
            return None
        check_boundary(mesh)
        rest = MoveInput("reference", np.zeros((len(mesh.moving), mesh.points.shape[1])))
        return compute(model, mesh, mesh.points, rest, self.factors).field

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
