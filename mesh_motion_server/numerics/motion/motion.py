"""One motion of one mesh, end to end: interpolate, predict, correct, displace (the data flow of every Move).

Pure: the result depends on the model, the committed points and the targets; the factor cache only saves time. No node
moves before a motion is accepted: an unacceptable one raises with the best that was found.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mesh_motion_server.errors import NumericalError
from mesh_motion_server.numerics.correction.boundary_constraint import BoundaryConstraint
from mesh_motion_server.numerics.correction.correction import CorrectionProblem, correct
from mesh_motion_server.numerics.correction.smooth_in_time import SmoothInTime
from mesh_motion_server.numerics.correction.trial_nodes import TrialMesh
from mesh_motion_server.numerics.interpolation.evaluation import Evaluator, LocalEvaluator
from mesh_motion_server.numerics.interpolation.factor_source import FactorSource, MakeEachTime, Recorded
from mesh_motion_server.numerics.mesh.boundary_facets import boundary_nodes
from mesh_motion_server.numerics.mesh.cells import CellTable
from mesh_motion_server.numerics.mesh.roles import BoundaryRoles, Patch
from mesh_motion_server.numerics.method import Method
from mesh_motion_server.numerics.motion.acceptance import (
    correction_settings,
    largest_accepted,
    quality_warnings,
    reduction_warnings,
    refuse_unacceptable,
)
from mesh_motion_server.numerics.motion.boundary_layer import BoundaryLayer, held_with
from mesh_motion_server.numerics.motion.boundary_layer_fallback import fitting_layer, given_way, move_with_layer
from mesh_motion_server.numerics.motion.layered_walls import LayeredWalls
from mesh_motion_server.numerics.motion.led_motion import boundary_of, led_motion, refuse_crossing
from mesh_motion_server.numerics.motion.method_check import check_method
from mesh_motion_server.numerics.motion.motion_found import Motion
from mesh_motion_server.numerics.motion.radius_choice import (
    PredictedMotion,
    best_predicted,
    with_other_radii,
    with_radii,
)
from mesh_motion_server.numerics.motion.sampling import ExpandableField, predict_sampled
from mesh_motion_server.numerics.motion.standard_motion import StandardMotion, StandardTrial
from mesh_motion_server.numerics.quality.lowest_quality import LowestJudge
from mesh_motion_server.numerics.quality.mesh_check import checked_mesh
from mesh_motion_server.numerics.quality.mesh_summary import mesh_summary
from mesh_motion_server.numerics.quality.metrics import AtRest, QualitySummary, cells_at_rest, summarize
from mesh_motion_server.numerics.quality.prediction import predict
from mesh_motion_server.numerics.quality.quality_summary import Judge, Judgement
from mesh_motion_server.numerics.stopwatch import Stopwatch

__all__ = ["MotionModel"]

#: Of the minimum quality without a boundary layer, what a motion that keeps the layer must have.
_AS_GOOD = 0.9


@dataclass(frozen=True, eq=False)
class MotionModel:
    """What stays the same over a session: the reference mesh, its roles and the method.

    Attributes
    ----------
    points : (n, d) array
        Reference coordinates, mesh length unit.
    cells : CellTable
    roles : BoundaryRoles
    method : Method
        With both radii filled in.
    reference_sizes : (m,) array or CellsAtRest
        Summed corner determinants of the reference cells: the w of thesis (3.21); with their skews where these count.
    held : (n,) bool array
        Nodes on the boundary or on a patch, which no correction may move; nor may it move those of a boundary layer.
    standard_motion : StandardMotion
    other_radii : tuple of StandardMotion
        The same with other support radii, where the radius is chosen from each motion.
    constraint : BoundaryConstraint or None
        Which of the held nodes the optimised correction may move nevertheless, and how.
    warnings : tuple of str
        What :func:`checked_mesh` noticed.
    evaluator : Evaluator
    smooth : SmoothInTime or None
        What ``correction_in_time`` "smooth" prepares.
    judge : Judge or None
        What judges whole meshes; None: this machine.
    layered : LayeredWalls or None
        Walls whose layers move with them where interpolation would spoil these; None where the method says which do.
    """

    points: NDArray[np.float64]
    cells: CellTable
    roles: BoundaryRoles
    method: Method
    reference_sizes: AtRest
    held: NDArray[np.bool_]
    standard_motion: StandardMotion
    constraint: BoundaryConstraint | None
    warnings: tuple[str, ...]
    evaluator: Evaluator
    smooth: SmoothInTime | None = None
    other_radii: tuple[StandardMotion, ...] = ()
    judge: Judge | None = None
    layered: LayeredWalls | None = None

    @classmethod
    def build(
        cls,
        points: NDArray[np.float64],
        cells: CellTable,
        patches: Mapping[str, Patch],
        method: Method,
        *,
        evaluator: Evaluator | None = None,
        judge: Judge | None = None,
    ) -> MotionModel:
        """Check the mesh and prepare what every motion needs.

        Raises
        ------
        InvalidInput
            When the mesh or a patch is unusable (see :func:`checked_mesh`), or the method does not fit the mesh.
        """
        cells, sizes, warnings = checked_mesh(points, cells, patches)
        at_rest = cells_at_rest(points, cells, sizes) if method.quality_metric == "relative-size-skew" else sizes
        roles = BoundaryRoles.from_patches(patches)
        periodic = any(patch.role == "periodic" for patch in patches.values())
        check_method(method, points, roles, periodic=periodic)
        given, method = method, with_radii(method, points, roles)
        evaluator = evaluator or LocalEvaluator()
        held = np.zeros(len(points), dtype=bool)
        held[boundary_nodes(cells)] = True
        held[roles.all] = True
        standard_motion = StandardMotion.build(points, cells, patches, method, evaluator)
        if standard_motion.layer is None and method.boundary_layer_thickness is not None:
            warnings = [*warnings, f"boundary_layer_thickness = {method.boundary_layer_thickness:.4g} holds no node"]
        smooth, told = None, held_with(held, standard_motion.layer)
        if method.correction_in_time == "smooth" and not told.all():
            smooth = SmoothInTime.build(TrialMesh(points, cells, at_rest, told, method.quality_metric))
        return cls(
            points,
            cells,
            roles,
            method,
            at_rest,
            held,
            standard_motion,
            BoundaryConstraint.build(points, cells, patches, standard_motion.sliding, standard_motion.periodic),
            tuple(warnings),
            evaluator,
            smooth,
            with_other_radii(standard_motion, given.enrichment_radius)
            if method.support_radius_choice == "motion"
            else (),
            judge,
            None
            if method.boundary_layer_thickness is not None or standard_motion.periodic is not None
            else LayeredWalls.build(points, cells, patches, standard_motion.sliding),
        )

    def without_distributions(self) -> MotionModel:
        """The same model, which judges a mesh by its worst cells, exactly, and leaves its distributions out.

        Where the method judges otherwise (another predictor, partitions elsewhere) it is this one.
        """
        if self.judge is not None or self.method.predictor != "trial-nodes":
            return self
        return replace(self, judge=LowestJudge(self.cells, self.reference_sizes))

    def summary(self, points: NDArray[np.float64]) -> Judgement:
        """Quality of the mesh with its nodes at ``points`` (n, d), size relative to the reference mesh."""
        if self.judge is not None:
            return self.judge.summary(points, self.method.quality_metric)
        return mesh_summary(points, self.cells, self.reference_sizes, metric=self.method.quality_metric)

    def move(
        self,
        committed: NDArray[np.float64],
        targets: NDArray[np.float64],
        factors: FactorSource | None = None,
        *,
        sent: tuple[NDArray[np.float64], NDArray[np.float64]] | None = None,
    ) -> Motion:
        """The motion that takes the moving nodes to ``targets``.

        Parameters
        ----------
        committed : (n, d) array
            Committed positions, mesh length unit.
        targets : (k, d) array
            Where ``roles.moving`` shall be.
        factors : FactorSource, optional
        sent : (origin, displacement), a pair of (k, d) arrays, optional
            What the targets are the sum of, as it was asked for; by default the committed positions of the moving nodes
            and what is left.

        Raises
        ------
        NumericalError
            When no valid mesh (or, where asked, none at the threshold) was found; carries the best minimum quality, the
            worst cells and the largest fraction found of the displacement ``sent`` that is accepted instead of it.
        """
        factors = MakeEachTime() if factors is None else factors  # an empty cache is falsy
        try:
            return self._directly_or_in_sub_steps(committed, targets, factors)
        except NumericalError as refusal:
            if refusal.code != NumericalError.default_code:  # of the system and not of a mesh: no smaller step helps
                raise
            if sent is None:
                sent = committed[self.roles.moving], targets - committed[self.roles.moving]
            fraction = self._acceptable_fraction(committed, *sent, factors)
            raise NumericalError(
                refusal.message,
                best=refusal.best,
                cells=refusal.cells,
                fraction=fraction,
                hint=f"a fraction of {fraction:.3g} of this displacement is acceptable; take a smaller step"
                if fraction > 0
                else "no tested fraction of this displacement is acceptable; the domain may have to be remeshed",
                details=refusal.details,
            ) from refusal

    def _directly_or_in_sub_steps(
        self, committed: NDArray[np.float64], targets: NDArray[np.float64], factors: FactorSource
    ) -> Motion:
        """One motion, led through valid meshes where the method says so and one step does not do."""
        if self.method.sub_steps == "always":
            return led_motion(self, committed, targets, factors)
        try:
            return self.attempt(committed, targets, factors)
        except NumericalError as refusal:
            unsolvable = refusal.code != NumericalError.default_code
            if unsolvable or self.method.sub_steps == "never" or self.method.correction == "none":
                raise
            return led_motion(self, committed, targets, factors, direct=refusal)

    def attempt(
        self,
        committed: NDArray[np.float64],
        targets: NDArray[np.float64],
        factors: FactorSource,
        valid: NDArray[np.float64] | None = None,
    ) -> Motion:
        """One motion in one step, accepted or refused; parameters and errors as those of :meth:`move`.

        Its correction begins from a ``valid`` mesh (n, d) where one is known. A boundary layer gives way rather than
        have it refused.
        """
        watch, asked = Stopwatch(), self.standard_motion.layer
        if asked is None:
            return self._attempt_once(committed, targets, factors, watch, valid)
        motion, left = self._attempt_with(asked, committed, targets, factors, watch, valid)
        return replace(motion, warnings=[*given_way(asked, left), *motion.warnings])

    def _attempt_with(
        self,
        asked: BoundaryLayer,
        committed: NDArray[np.float64],
        targets: NDArray[np.float64],
        factors: FactorSource,
        watch: Stopwatch,
        valid: NDArray[np.float64] | None,
    ) -> tuple[Motion, BoundaryLayer | None]:
        """One motion with a boundary layer, and what is left of it."""
        moved = self.points.copy()
        moved[self.roles.moving] = targets
        with watch.phase("predict"):
            mesh = TrialMesh(self.points, self.cells, self.reference_sizes, self.held, self.method.quality_metric)
            fitting = fitting_layer(asked, moved, mesh, valid)

        def move(layer: BoundaryLayer | None) -> Motion:
            return self._with_layer(layer)._attempt_once(committed, targets, factors, watch, valid)

        return move_with_layer(fitting, move, self.method.quality_threshold)

    def _with_layer(self, layer: BoundaryLayer | None) -> MotionModel:
        """The model with another boundary layer; a correction that is smooth in time is then prepared when needed."""
        if layer is self.standard_motion.layer:
            return self
        motion = self.standard_motion.with_layer(layer)
        others = (
            replace(m, layer=layer, plans=motion.plans.with_support_radius(float(m.method.support_radius or 0.0)))
            for m in self.other_radii
        )
        return replace(self, standard_motion=motion, other_radii=tuple(others), smooth=None)

    def _attempt_once(
        self,
        committed: NDArray[np.float64],
        targets: NDArray[np.float64],
        factors: FactorSource,
        watch: Stopwatch,
        valid: NDArray[np.float64] | None,
    ) -> Motion:
        """One motion with the boundary layer as it is."""
        factors = Recorded(factors)

        def predicted_with(motion: StandardMotion) -> PredictedMotion:
            trial = motion.trial(committed, targets, factors, watch)
            with watch.phase("predict"):
                return PredictedMotion(motion, trial, self._predict(trial))

        chosen = best_predicted([predicted_with(motion) for motion in (self.standard_motion, *self.other_radii)])
        standard = chosen.trial
        self._refuse_crossing(chosen, targets)
        bad = chosen.quality.metric.min < self.method.quality_threshold and self.method.correction != "none"
        layer = None if self.layered is None else self.layered.needed_for(standard.points, corrected=bad)
        if layer is not None:
            unasked = replace(self, layered=None)
            with_layer, _ = unasked._attempt_with(layer, committed, targets, factors, watch, valid)
            least = min(self.method.quality_threshold, _AS_GOOD * chosen.quality.metric.min)
            if with_layer.corrected.metric.min >= least:
                return with_layer
        near = self._near(standard, committed, factors, watch) if valid is None else None
        exact = self.method.predictor == "trial-nodes"  # what judges the corrected mesh too
        with watch.phase("correct"):
            correction = correct(
                CorrectionProblem(
                    start=standard.start,
                    standard=standard.points,
                    held=held_with(self.held, self.standard_motion.layer),
                    cells=self.cells,
                    reference_sizes=self.reference_sizes,
                    factorization=standard.factorization,
                    evaluator=self.evaluator,
                    reference=self.points,
                    constraint=self._constraint(),
                    smooth=self.smooth,
                    near=near,
                    valid=valid,
                    known=chosen.quality.metric.min if exact and not chosen.quality.inverted else None,
                ),
                correction_settings(self.method, float(chosen.motion.method.enrichment_radius or 0.0)),
            )
        with watch.phase("predict"):
            unchanged = exact and correction.points is standard.points
            corrected = chosen.quality if unchanged else self.summary(correction.points)
        reached = corrected.metric.min >= self.method.quality_threshold
        refuse_unacceptable(self.method, corrected, reached)
        return Motion(
            points=correction.points,
            standard=chosen.quality,
            corrected=corrected,
            correction=correction,
            reached=reached,
            seconds=watch.seconds(),
            caches=factors.report(),
            control_points=standard.control_points,
            support_radius=float(chosen.motion.method.support_radius or 0.0),
            warnings=[
                *reduction_warnings(self.method, standard.reduction_error, len(standard.control_points)),
                *quality_warnings(self.method, corrected, reached),
            ],
        )

    def _refuse_crossing(self, found: PredictedMotion, targets: NDArray[np.float64]) -> None:
        """Where a motion inverts cells, its boundary must not cross itself: no correction would find a mesh.

        Or it would find cells that are all positive, and overlap.
        """
        if found.quality.inverted and self.method.correction != "none" and not self.method.allow_invalid:
            worst = [cell.number for cell in found.quality.worst]
            plain = NumericalError("", best=found.quality.metric.min, cells=worst)
            refuse_crossing(self, boundary_of(self), found.trial.points, targets, plain)

    def _constraint(self) -> BoundaryConstraint | None:
        """The constraint of the boundary nodes that are not in a boundary layer."""
        layer = self.standard_motion.layer
        if self.constraint is None or layer is None:
            return self.constraint
        return replace(self.constraint, released=self.constraint.released & ~layer.known)

    def _near(
        self, standard: StandardTrial, committed: NDArray[np.float64], factors: FactorSource, watch: Stopwatch
    ) -> NDArray[np.float64] | None:
        """The standard motion with the committed mesh's correction (n, d), where that is cheap and one is smooth."""
        if self.smooth is None or self.method.displacement != "absolute" or np.array_equal(committed, self.points):
            return None
        before = self.standard_motion.trial(committed, committed[self.roles.moving], factors, watch)
        return standard.points + (committed - before.points)

    def _predict(self, trial: StandardTrial) -> Judgement:
        """Quality of the standard motion by the method's predictor."""
        if self.method.predictor == "trial-nodes":
            return self.summary(trial.points)
        if self.method.predictor == "sampled":
            return self._predict_sampled(trial)
        quality = predict(self.method.predictor, trial.start, self.cells, self.reference_sizes, trial.field)
        return summarize(quality, trial.points, self.cells, metric=self.method.quality_metric)

    def _predict_sampled(self, trial: StandardTrial) -> QualitySummary:
        """Exact below the threshold and at the minimum, expanded elsewhere; in full where something snaps nodes."""
        reduced = self.method.reduction != "none" or self.method.volume_reduction != "none"
        single = None if reduced or self.standard_motion.layer is not None else trial.field.single
        found = predict_sampled(
            trial.start,
            self.cells,
            self.reference_sizes,
            None if single is None else ExpandableField(*single),
            lambda nodes: trial.points[nodes] - trial.start[nodes],
            metric=self.method.quality_metric,
            threshold=self.method.quality_threshold,
            settle="minimum",
        )
        return summarize(found.quality, trial.points, self.cells, metric=self.method.quality_metric)

    def _acceptable_fraction(
        self,
        committed: NDArray[np.float64],
        origin: NDArray[np.float64],
        displacement: NDArray[np.float64],
        factors: FactorSource,
    ) -> float:
        """A fraction of a ``displacement`` (k, d) from an ``origin`` (k, d) that is accepted from ``committed``."""

        def accepts(model: MotionModel, fraction: float) -> bool:
            try:
                model._directly_or_in_sub_steps(committed, origin + fraction * displacement, factors)
            except NumericalError:
                return False
            return True

        direct = self if self.method.sub_steps == "always" else self.with_method(sub_steps="never")
        plain = self.with_method(sub_steps="never", correction="none", correction_in_time="independent")
        plain = replace(plain.without_distributions(), smooth=None, layered=None)
        return largest_accepted(lambda fraction: accepts(direct, fraction), lambda fraction: accepts(plain, fraction))

    def with_method(self, **choices: Any) -> MotionModel:
        """The model with other choices of its method that need no other preparation."""
        method = replace(self.method, **choices)
        return replace(self, method=method, standard_motion=replace(self.standard_motion, method=method))
