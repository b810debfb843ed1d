"""One motion of one mesh, from end to end: the data flow of every Move.

An *attempt* interpolates the boundary's displacement, judges the mesh, corrects it, judges it again, and accepts or
refuses it. If the attempt is refused, a second one follows: the mesh is led to its targets in sub-steps, which are
attempts themselves, and corrected there.

The computation is pure: the result depends only on the model, the committed points and the targets; the factor cache
only saves time. No node moves before a motion is accepted: an unacceptable motion raises an error with the best result
found.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
from mesh_motion_protocol.errors import QualityRefused, Timeout

from mesh_motion_numerics.arrays import Floats, Integers
from mesh_motion_numerics.blas import one_blas_thread
from mesh_motion_numerics.correction.correction import Correction, correct
from mesh_motion_numerics.correction.correction_problem import CorrectionProblem
from mesh_motion_numerics.correction.smooth_motion import SmoothMotion
from mesh_motion_numerics.correction.trial_nodes import TrialMesh
from mesh_motion_numerics.interpolation.factor_source import FactorSource, MakeEachTime, Recorded
from mesh_motion_numerics.motion.acceptance import largest_accepted, other_unit, refuse_unacceptable, way_out
from mesh_motion_numerics.motion.body_paths import Way, ways
from mesh_motion_numerics.motion.boundary_layer import BoundaryLayer
from mesh_motion_numerics.motion.crossing import NoMeshExists
from mesh_motion_numerics.motion.motion_found import BoundaryDisplacement, Motion
from mesh_motion_numerics.motion.motion_slope import DifferentiableMesh
from mesh_motion_numerics.motion.smooth_step import NOT_SMOOTH, PlainWay, smooth_step, unconverged
from mesh_motion_numerics.motion.standard_motion import StandardMotion, StandardTrial
from mesh_motion_numerics.motion.sub_steps import Leg, Walk, furthest_walk
from mesh_motion_numerics.motion.winding import UNWOUND, Turns
from mesh_motion_numerics.quality.metrics import CellQuality, CellsAtRest, cell_quality, sizes_of, subset_quality
from mesh_motion_numerics.quality.quality_summary import Judgement
from mesh_motion_numerics.stopwatch import Stopwatch, check_time

#: Smallest share of the minimum quality without a boundary layer that a motion with the layer must have.
_AS_GOOD = 0.9
#: Share of the threshold below which a mesh is nearly inverted, so that the layer is not worth keeping.
_NEARLY_INVERTED = 0.2
#: Nodes that slide improve nearly every mesh. If the mesh has a lower quality than this …
_GOOD = 0.9
#: … and is worse by more than this when they slide, they are held. If it is about equally good they slide: a wall whose
#: nodes slide in one coupling iteration and are held in the next one disturbs the flow.
_WORSE = 0.02
#: A lower quality, which is the root of a size, is that of a cell whose size is only rounding, or close to it.
_COLLAPSED = 1e-7
#: Corrections that look for a fraction of a refused motion go up to this quality: then the mesh is surely valid.
_VALID = 0.003


@dataclass(frozen=True, eq=False)
class _Step:
    """The input of an attempt.

    committed : (n, d) committed positions, mesh length unit
    targets : (k, d) targets of the moving nodes
    factors : source of the factorizations
    valid : (n, d) a valid mesh from which the correction begins, if one is known
    plain : [(n, d)] the plain motion to these targets, once an attempt has made it
    """

    committed: Floats
    targets: Floats
    factors: FactorSource
    valid: Floats | None = None
    plain: list[Floats] = field(default_factory=list, init=False)


@dataclass(frozen=True, eq=False)
class _Predicted:
    """An interpolated motion and its quality.

    distorted : the cells that a smooth correction must consider; None if they are not known
    factors : the factorizations found in the cache for it
    """

    motion: StandardMotion
    trial: StandardTrial
    quality: Judgement
    distorted: Integers | None
    factors: Recorded


@dataclass(frozen=True, eq=False)
class MotionModel(DifferentiableMesh):
    """A mesh that can be moved: :class:`~.prepared_mesh.PreparedMesh` and its motions."""

    def move(
        self,
        committed: Floats,
        targets: Floats,
        factors: FactorSource | None = None,
        *,
        boundary_displacement: BoundaryDisplacement | None = None,
    ) -> Motion:
        """The motion that takes the moving nodes to ``targets``.

        Raises InvalidInput if moving nodes leave a symmetry plane. Raises QualityRefused if no valid mesh (or, if
        required, none at the threshold) was found; carries the best minimum quality, the worst cells and the largest
        accepted fraction found of the ``boundary_displacement``, None if :func:`.time_limit` ended the search. Raises
        Timeout if that limit ended the motion itself.

        Parameters
        ----------
        committed : (n, d) array
            Committed positions, mesh length unit.
        targets : (k, d) array
            Targets of ``roles.moving``.
        boundary_displacement : BoundaryDisplacement, optional
            The two terms of the targets; by default the committed positions of the moving nodes and the difference.
        """
        leaving = [] if self.rims is None else self.rims.check(targets)
        step = _Step(committed, targets, MakeEachTime() if factors is None else factors)  # an empty cache is falsy
        try:
            motion = self._accept_or_lead(step)
            return replace(motion, warnings=[*motion.warnings, *leaving])
        except QualityRefused as refusal:
            if not _of_the_mesh(refusal):
                raise
            if self.method.correction == "none":  # all other methods have tested the boundary before they corrected
                refusal = self._impossible(step, refusal) or refusal
            origin = committed[self.roles.moving]
            unit = other_unit(self.points, targets - self.points[self.roles.moving])
            whole = boundary_displacement or BoundaryDisplacement(origin, targets - origin)
            try:
                fraction = self._acceptable_fraction(step, whole, refusal)
            except Timeout:
                fraction = None
            raise QualityRefused(
                refusal.message + ("" if self.rims is None else self.rims.passed(targets)),
                best=refusal.best,
                cells=refusal.cells,
                fraction=fraction,
                hint="; ".join(filter(None, (way_out(fraction), unit))),
                details=refusal.details,
            ) from refusal

    # --- the sequence ------------------------------------------------------------------------------------------------

    def _accept_or_lead(self, step: _Step) -> Motion:
        """Attempt the step at once; if it is refused, lead the mesh to its targets and correct it there."""
        if self.smooth is not None:
            return self._smooth_or_optimised(step, self.smooth)
        try:
            return self._attempt(step)
        except QualityRefused as refusal:
            if self.method.sub_steps == "never" or self.method.correction == "none" or not _may_be_avoided(refusal):
                raise
            return self._led(step, refusal)

    def _led(self, step: _Step, refusal: QualityRefused | None = None) -> Motion:
        """Lead the mesh to the targets of a refused step, and correct it there."""
        watch = Stopwatch()
        with watch.phase("correct"):
            walk = self._lead(step, refusal)
        motion = self._attempt(replace(step, valid=walk.points))
        correction = replace(motion.correction, iterations=walk.iterations + motion.correction.iterations)
        led = watch.seconds()
        seconds = {**motion.seconds, "correct": led["correct"] + motion.seconds["correct"], "total": led["total"]}
        return replace(motion, sub_steps=walk.legs, correction=correction, seconds=seconds)

    def _attempt(self, step: _Step) -> Motion:
        """One step: interpolate, judge, correct, judge, accept.

        Layers of thin cells move with their wall only if interpolation or a correction may spoil them, and only if the
        mesh then has about the same quality.
        """
        watch = Stopwatch()
        check_time()
        plain = self._interpolate(step, self.standard_motion, watch)
        with watch.phase("predict"):
            layer = self._fitting_layer(step, plain)
        carried = None if layer is None else self._carrying(step, layer, watch)
        least = max(_AS_GOOD * plain.quality.metric.min, _NEARLY_INVERTED * self.method.quality_threshold)
        if carried is not None and carried.corrected.metric.min >= min(self.method.quality_threshold, least):
            return carried
        try:
            alone = self._finish(step, plain, watch)
        except QualityRefused:
            if carried is None:
                raise
            return carried
        return alone if carried is None else max(carried, alone, key=lambda motion: motion.corrected.metric.min)

    def _carrying(self, step: _Step, layer: BoundaryLayer, watch: Stopwatch) -> Motion | None:
        """The motion whose walls carry a layer; None if it is refused but one without the layer may be accepted."""
        try:
            return self._finish(step, self._interpolate(step, self.motion_with(layer), watch), watch)
        except NoMeshExists:
            raise
        except QualityRefused:
            return None

    def _finish(self, step: _Step, predicted: _Predicted, watch: Stopwatch) -> Motion:
        """Correct an interpolated mesh, judge it again and accept it."""
        motion = self._accept(predicted, self._correct(step, predicted, watch), watch)
        sliding = predicted.motion.sliding
        if motion.reached or sliding is None or sliding.is_held or self.method.correction != "optimised":
            return motion
        # nodes that have slid on a round wall can be where no iterations lead to the threshold
        held = self._predict(replace(predicted.motion, sliding=sliding.held()), step, watch)
        try:
            other = self._accept(held, self._correct(step, held, watch), watch)
        except QualityRefused:
            return motion
        return max(motion, other, key=lambda one: one.corrected.metric.min)

    def _smooth_or_optimised(self, step: _Step, smooth: SmoothMotion) -> Motion:
        """The smooth motion; if it finds no mesh, the motion with the correction that reaches most, with a warning.

        A mesh that cannot be wound further is unwound first.
        """
        turns = None if self.winding is None else self.winding.turns(step.committed, step.targets)
        meant: list[tuple[Turns | None, tuple[str, ...]]] = [(turns, ())] if turns is None or turns.certain else []
        if turns is not None and turns.unwound is not None:
            meant.append((turns.unwound, (UNWOUND,)))
        for turns, warnings in meant:
            try:
                motion = self._smooth_attempt(step, smooth, turns)
            except QualityRefused as refusal:
                if not _may_be_avoided(refusal):
                    raise
            else:
                return replace(motion, warnings=[*motion.warnings, *warnings])
        motion = self.with_method(correction="optimised")._accept_or_lead(step)
        return replace(motion, warnings=[*motion.warnings, NOT_SMOOTH])

    def _smooth_attempt(self, step: _Step, smooth: SmoothMotion, turns: Turns | None) -> Motion:
        """One step of the motion that is a smooth function of the boundary; layers always move with their walls."""
        watch = Stopwatch()
        check_time()
        predicted = self._interpolate(step, self.carrying_layers, watch, turns)
        plain, moving = predicted.trial.points, step.committed[self.roles.moving]
        if turns is None:
            self._latest.keep(step.targets, plain)
        if predicted.distorted is not None and not len(predicted.distorted):  # no cell resists
            return self._accept(predicted, Correction(plain, plain[:0]), watch)

        def plain_at(targets: Floats, fraction: float) -> Floats:
            return self._plain(predicted.motion, replace(step, targets=targets), turns, fraction).points

        def before() -> Floats:
            return plain_at(moving, 0.0) if turns else self._latest.at(moving, lambda: plain_at(moving, 0.0))

        def ways() -> Iterator[PlainWay]:
            for path in self._ways(moving, step.targets) if self.method.sub_steps != "never" else ():
                yield lambda t, path=path: plain_at(path.at(t), t)  # type: ignore[misc]

        with watch.phase("correct"), one_blas_thread():
            carried, correction, along = None, smooth, None
            if turns is not None and (winding := self.winding) is not None:
                carried, correction = partial(winding.carried, turns), smooth.later(winding.sheared(turns))

                def along(fraction: float) -> SmoothMotion:
                    return smooth.later(winding.sheared(turns.until(fraction)))

            followed = smooth_step(correction, step.committed, before, plain, ways, carried, predicted.distorted, along)
        found, corrected = followed.found, followed.correction()
        motion = self._accept(predicted, corrected, watch)
        if not (found.converged or motion.reached):
            raise QualityRefused(unconverged(found))
        return replace(motion, sub_steps=followed.legs, warnings=[*motion.warnings, *corrected.warnings])

    # --- its parts ---------------------------------------------------------------------------------------------------

    def _interpolate(
        self, step: _Step, motion: StandardMotion, watch: Stopwatch, turns: Turns | None = None
    ) -> _Predicted:
        """Interpolate the motion and judge the mesh."""
        if len(self.coincident) and not self.method.allow_invalid:
            self.boundary.refuse_passing(step.committed, step.targets)
        predicted = self._predict(motion, step, watch, turns)
        if self.smooth is None and motion.sliding is not None and predicted.quality.metric.min < _GOOD:
            held = self._predict(replace(motion, sliding=motion.sliding.held()), step, watch)
            gained = held.quality.metric.min - predicted.quality.metric.min
            if gained > (0.0 if predicted.quality.inverted else _WORSE):
                predicted = held
        self._refuse_impossible(predicted.trial.points, step.targets, predicted.quality)
        return predicted

    def _refuse_impossible(self, plain: Floats, targets: Floats, quality: Judgement) -> None:
        """Refuse the plain motion (n, d), which has this quality, if the boundary alone shows that no mesh exists."""
        collapsed = quality.inverted > 0 or quality.metric.min < _COLLAPSED
        corrected = self.method.correction != "none" or not quality.inverted
        if not self.method.allow_invalid and (corrected if collapsed else self.boundary.outer is not None):
            # a correction would find no mesh, or one whose cells are all positive but overlap or have no size
            refusal = QualityRefused("", best=quality.metric.min, cells=[cell.number for cell in quality.worst])
            refuse = self.boundary.refuse if collapsed else self.boundary.refuse_overlap
            refuse(plain, targets, refusal)

    def _predict(self, motion: StandardMotion, step: _Step, watch: Stopwatch, turns: Turns | None = None) -> _Predicted:
        factors = Recorded(step.factors)
        trial = self._plain(motion, replace(step, factors=factors), turns, 1.0, watch)
        if motion is self.standard_motion and turns is None:
            step.plain.append(trial.points)
        with watch.phase("predict"):
            if self.smooth is None or not isinstance(self.reference_sizes, CellsAtRest):
                return _Predicted(motion, trial, self.summary(trial.points), None, factors)
            return _Predicted(motion, trial, *self.judged(trial.points, self.smooth.law.limit), factors)

    def _plain(
        self, motion: StandardMotion, step: _Step, turns: Turns | None, fraction: float, watch: Stopwatch | None = None
    ) -> StandardTrial:
        """The plain motion after a fraction of the bodies' turns; interpolation alone if no body winds the mesh."""
        watch = watch or Stopwatch()
        if turns is None or self.winding is None:
            return motion.trial(step.committed, step.targets, step.factors, watch)
        unwound, wind = self.winding.winds(step.targets, turns, fraction)
        trial = motion.trial(step.committed, unwound, step.factors, watch)
        return replace(trial, points=wind(trial.points))

    def _fitting_layer(self, step: _Step, plain: _Predicted) -> BoundaryLayer | None:
        """The part of the boundary layer that can be carried to the targets, if a motion without it may spoil it.

        The plain motion itself may spoil it, and so may a correction.
        """
        if self.layered is None or not self.layered.thin:
            return None
        corrected = plain.quality.metric.min < self.method.quality_threshold and self.method.correction != "none"
        layer = self.layered.layer if corrected or self.layered.spoiled_by(plain.trial.points) else None
        if layer is None:
            return None
        moved = self.points.copy()
        moved[self.roles.moving] = step.targets
        mesh = TrialMesh(self.points, self.cells, self.reference_sizes, self.held, self.method.quality_metric)
        return layer.fitting(moved, mesh.quality_of, step.valid)

    def _correct(self, step: _Step, predicted: _Predicted, watch: Stopwatch) -> Correction:
        """The correction of an interpolated mesh, from a valid one if one is known."""
        layer, standard, quality = predicted.motion.layer, predicted.trial, predicted.quality
        problem = CorrectionProblem(
            start=standard.start,
            standard=standard.points,
            held=self.held_with(layer),
            cells=self.cells,
            reference_sizes=self.reference_sizes,
            factorization=standard.factorization,
            reference=self.points,
            constraint=self.constraint_with(layer),
            valid=step.valid,
            known=None if quality.inverted else quality.metric.min,
        )
        with watch.phase("correct"):
            return correct(problem, self.method)

    def _accept(self, predicted: _Predicted, correction: Correction, watch: Stopwatch) -> Motion:
        """The motion, if its mesh is acceptable; a corrected mesh is judged again."""
        standard, method, quality = predicted.trial, self.method, predicted.quality
        if correction.points is not standard.points:
            with watch.phase("predict"):
                quality = self.summary(correction.points, correction.quality)
        reached = quality.metric.min >= method.quality_threshold
        warnings = refuse_unacceptable(method, quality, reached)
        if correction.points is standard.points and (self.smooth is not None or method.correction == "none"):
            self._latest.led_to(standard.points, predicted.motion)
        return Motion(
            points=correction.points,
            standard=predicted.quality,
            corrected=quality,
            correction=replace(correction, quality=None),
            reached=reached,
            seconds=watch.seconds(),
            caches=dict(predicted.factors.found),
            control_points=standard.control_points,
            support_radius=float(predicted.motion.method.support_radius or 0.0),
            warnings=warnings,
        )

    def _lead(self, step: _Step, refusal: QualityRefused | None) -> Walk:
        """Lead the mesh to its targets along the first of the bodies' ways on which it stays valid.

        Each leg (:mod:`.sub_steps`) is an attempt from the mesh of the leg before, corrected up to the threshold. The
        first leg starts from the mesh to which the method's displacement refers: the committed mesh or the reference
        mesh. So the result depends only on that mesh and on the targets. Raises QualityRefused if the boundary crosses
        itself at the targets, or no way leads there; the message says how far the mesh stayed valid. Includes the
        details of the ``refusal`` of a single step, if there was one.
        """
        start = step.committed if self.method.displacement == "relative" else self.points
        self.boundary.refuse(start, step.targets, refusal)
        alike = self.with_method(displacement="relative", correction_target="threshold", refuse_below_threshold=False)

        def move(points: Floats, waypoint: Floats) -> Leg:
            self.boundary.refuse(points, waypoint)
            factors = step.factors if points is start else MakeEachTime()  # shared by coupling iterations
            found = alike._attempt(_Step(points, waypoint, factors))
            return Leg(found.points, found.standard.inverted == 0, found.correction.iterations)

        paths = self._ways(start[self.roles.moving], step.targets)
        walk = furthest_walk(start, (path.at for path in paths), move)
        refusal = refusal or walk.refusal
        if walk.fraction < 1.0 and refusal is not None:
            raise QualityRefused(
                f"{refusal.message}; in {walk.legs} sub-steps the mesh was kept valid for "
                f"{walk.fraction:.3g} of the way",
                best=refusal.best,
                cells=refusal.cells,
                details=refusal.details,
            )
        return walk

    def _ways(self, origin: Floats, targets: Floats) -> Iterator[Way]:
        """Ways for the moving nodes (k, d); periodic nodes must move together, so their displacement is only scaled."""
        return ways(origin, targets, self.bodies if self.standard_motion.periodic is None else ())

    def _impossible(self, step: _Step, refusal: QualityRefused | None = None) -> NoMeshExists | None:
        """The refusal if the boundary forbids every mesh, with the details of an earlier refusal; else None."""
        try:
            self.boundary.refuse(step.committed, step.targets, refusal)
        except NoMeshExists as certain:
            return certain
        return None

    def _acceptable_fraction(self, step: _Step, whole: BoundaryDisplacement, refusal: QualityRefused) -> float:
        """An accepted fraction of the ``whole`` displacement, which was refused with this error."""

        def accepts(model: MotionModel, fraction: float) -> bool:
            try:
                model._accept_or_lead(replace(step, targets=whole.at(fraction)))
            except QualityRefused:
                return False
            return True

        method = self.method
        enough = self.with_method(correction_target="threshold")  # more costs much and gives the same
        if self.smooth is not None and method.sub_steps == "auto" and not method.refuse_below_threshold:
            # a fraction that no smooth motion reaches is corrected up to the threshold, or led there if that fails
            least = min(method.quality_threshold, _VALID)
            enough = enough.with_method(correction="optimised", quality_threshold=least)
        direct = enough.with_method(sub_steps="never")
        plain = self.with_method(sub_steps="never", correction="none")
        plain = replace(plain.without_distributions(), layered=None)
        exists, kinds = not isinstance(refusal, NoMeshExists), getattr(refusal, "looked_for", 0)

        def possible(fraction: float) -> bool:
            targets = whole.at(fraction)
            if kinds:  # mostly the same kind of fault; all kinds are tested when a motion is tried
                return not self.boundary.has_fault(step.committed, targets, kinds)
            return self._impossible(replace(step, targets=targets)) is None

        between, exact = self._between(step, whole)

        def valid(fraction: float) -> bool:
            if not exact:
                return accepts(plain, fraction)
            targets, points = whole.at(fraction), between(fraction)
            try:
                if len(self.coincident) and not method.allow_invalid:
                    self.boundary.refuse_passing(step.committed, targets)
                quality = plain.summary(points)
                plain._refuse_impossible(points, targets, quality)
                refuse_unacceptable(plain.method, quality, quality.metric.min >= method.quality_threshold)
            except QualityRefused:
                return False
            return True

        return largest_accepted(
            lambda fraction: accepts(direct, fraction),
            valid,
            possible,
            whole=exists,
            settled=lambda: plain.summary(between(0.0)).metric.min >= method.quality_threshold,
            corrected=method.correction != "none",
            expected=self._expected(between),
        )

    def _between(self, step: _Step, whole: BoundaryDisplacement) -> tuple[Callable[[float], Floats], bool]:
        """Return the plain motion (n, d) to a fraction of the ``whole`` displacement, linear in it, and if it is exact.

        An exact one is equal to the interpolated one up to rounding, and takes a tenth of the time.
        """
        plain, method = self.standard_motion, self.method

        def interpolated(targets: Floats) -> Floats:
            start = self.points if method.displacement == "absolute" else step.committed
            if np.array_equal(targets, start[self.roles.moving]):
                return start
            return plain.trial(step.committed, targets, step.factors, Stopwatch()).points

        known = step.plain if np.array_equal(whole.at(1.0), step.targets) else []
        begin, end = interpolated(whole.at(0.0)), known[0] if known else interpolated(whole.at(1.0))
        linear = method.displacement != "reanchored" and method.reduction == "none" and len(self.roles.fixed) > 0
        return lambda fraction: begin + fraction * (end - begin), linear and plain.sliding is None

    def _expected(self, between: Callable[[float], Floats]) -> Callable[[float], bool] | None:
        """Estimate whether a plain motion is accepted at a fraction of it, below the last one that was not.

        The estimate uses the cells that are not acceptable there; None if there are none at the motion's end.
        """
        sizes, metric = self.reference_sizes, self.method.quality_metric
        threshold = self.method.quality_threshold if self.method.refuse_below_threshold else -np.inf
        if not np.isfinite(threshold):
            sizes = sizes_of(sizes)

        def refused(quality: CellQuality) -> Integers:
            low = quality.metric(metric) < threshold if np.isfinite(threshold) else False
            return np.flatnonzero(quality.inverted | low)

        bad = refused(cell_quality(between(1.0), self.cells, sizes))

        def accepted(fraction: float) -> bool:
            nonlocal bad
            still = bad[refused(subset_quality(between(fraction), self.cells, sizes, bad))]
            bad = still if len(still) else bad
            return not len(still)

        return accepted if len(bad) else None


def _may_be_avoided(refusal: QualityRefused) -> bool:
    """Whether another correction or way may find a mesh."""
    return _of_the_mesh(refusal) and not isinstance(refusal, NoMeshExists)


def _of_the_mesh(refusal: QualityRefused) -> bool:
    """Whether a mesh was refused; otherwise a system could not be solved, and smaller steps do not help."""
    return refusal.code == QualityRefused.default_code
