"""Answers of a session that change nothing: derivatives, headroom, swept volumes of its trial and committed state."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, cast

import numpy as np
from mesh_motion_numerics.arrays import Floats, Integers
from mesh_motion_numerics.distributed.field import Field
from mesh_motion_numerics.mesh.cells import CellBlock
from mesh_motion_numerics.mesh.swept_volumes import swept_by_cells, swept_volumes
from mesh_motion_numerics.motion.time_levels import scheme_velocity
from mesh_motion_protocol.errors import SessionError

from mesh_motion_server.session.corrections import CorrectedRegion
from mesh_motion_server.session.factors import FactorCache
from mesh_motion_server.session.field_slope import FieldCotangent, FieldSlope, FieldTangent
from mesh_motion_server.session.model import Slope
from mesh_motion_server.session.position import Position
from mesh_motion_server.session.spec import StoredSpec
from mesh_motion_server.session.state import Operation, Trial
from mesh_motion_server.session.values import VelocityAsked

if TYPE_CHECKING:
    from mesh_motion_numerics.motion.boundary_motion import BoundaryMotion
    from mesh_motion_numerics.quality.headroom import Headroom


class Answers(Position):
    """The part of a session whose answers change nothing.

    Parameters
    ----------
    factors : FactorCache
        Shared by moves and derivatives.
    """

    def __init__(self, spec: StoredSpec, factors: FactorCache) -> None:
        super().__init__(spec)
        self.factors = factors
        self._latest_slope: tuple[Floats, Slope] | None = None
        self._latest_field_slope: tuple[Floats, FieldSlope] | None = None
        self._corrected: list[tuple[Floats, CorrectedRegion]] = []  # for the trial and the committed state

    def headroom(self, along: str, velocity: Floats | None = None) -> Headroom:
        """The headroom of the mesh if all nodes continue their motion from the trial.

        Parameters
        ----------
        along : {"step", "displacement", "velocity"}
            The unit: multiples of the way from the committed state, or of the way from the reference mesh; or seconds
            of the trial's ``velocity`` (n, d).
        """
        trial = self._open_trial
        if velocity is not None and along == "velocity":
            before = trial.points - velocity  # the nodes a second ago, so the multiples are seconds
        else:
            before = self._committed_state.points if along == "step" else self.mesh.points
        worst = () if trial.quality is None else (cell.number for cell in trial.quality.worst)
        return self.model.headroom(before, trial.points, np.fromiter(worst, dtype=np.int64), step=along == "step")

    def swept(self, partition: int, faces: Integers | None) -> Floats:
        """Volumes that faces of a partition sweep from the committed state to the trial, length unit to the power d.

        Parameters
        ----------
        faces : (f, k) int64 array, optional
            The partition's own nodes of each face, filled up with -1; by default all faces of its cells with outward
            normals, type after type and cell after cell.

        Returns
        -------
        (f,) array
        """
        built, before, after = self._require_built(), self._committed_state.points, self._open_trial.points
        if faces is not None:
            own = np.append(built.mesh.node_maps[partition], -1)  # a −1 that fills a row stays −1
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

        Raises SessionError if the state does not allow it, or there is no trial. Raises InvalidInput if the method, or
        this kind of session, has no derivative.
        """
        self.admit(operation)
        self._points_of(what)  # raises without a trial
        refusal = self.model.why_no_slope()
        if refusal is not None:
            raise refusal

    def tangent(self, what: str, velocities: Sequence[Floats]) -> list[Floats]:
        """Velocities (n_p, c d) of each partition's nodes, for velocities (k_p, c d) of its moving nodes.

        Raises InvalidInput if partitions disagree about a node. Raises QualityRefused if this mesh was corrected, but
        not by the smooth correction.

        Parameters
        ----------
        what : {"trial", "committed"}
        velocities : one (k_p, c d) array per partition
            The components of c vectors, one after the other.
        """
        mesh = self.mesh
        given = self._gather_velocities(velocities)
        found = self._by_vector(given, self._slope(what).tangent)
        return [mesh.scatter(found, partition) for partition in range(len(velocities))]

    def cotangent(self, what: str, weights: Sequence[Floats]) -> list[Floats]:
        """Weights (k_p, c d) of each partition's moving nodes, for weights (n_p, c d) of its nodes.

        Weights that several partitions give to one node are added; each partition gets the sum.
        """
        mesh = self.mesh
        found = self._by_vector(mesh.gather_sums(weights), self._slope(what).cotangent)
        return mesh.scatter_moving(found)

    def field_tangent(self, what: str, velocities: Sequence[Floats]) -> FieldTangent:
        """Like :meth:`tangent` for a session whose client has the volume: for the field, and for the freed nodes."""
        slope = self._field_slope(what)
        found = [slope.tangent(one) for one in self._vectors(self._gather_velocities(velocities))]
        rows = ([getattr(one, name) for one in found] for name in ("velocity", "coefficients", "of_freed"))
        velocity, coefficients, of_freed = (np.concatenate(each, axis=1) for each in rows)
        return FieldTangent(velocity, coefficients, found[0].freed, of_freed)

    def field_cotangent(self, what: str, given: FieldCotangent) -> list[Floats]:
        """Like :meth:`cotangent` for a session whose client has the volume."""
        slope, found = self._field_slope(what), []
        parts = (self._vectors(rows) for rows in (given.weights, given.coefficients, given.of_ids))
        for weights, coefficients, of_ids in zip(*parts, strict=True):
            found.append(slope.cotangent(FieldCotangent(weights, coefficients, given.ids, of_ids)))
        return self.mesh.scatter_moving(np.concatenate(found, axis=1))

    # --- inside ----------------------------------------------------------------------------------------------------

    def _velocities(self, trial: Trial, asked: VelocityAsked) -> Floats:
        """Velocities (n, d) of all nodes."""
        if asked.scheme == "tangent":
            return self._slope_at(trial.points).tangent(self._gather_velocities(asked.boundary))
        before, time = self._committed_state, cast(float, asked.time)
        return scheme_velocity(asked.scheme, trial.points, before.points, before.level, time)

    def _slope(self, what: str) -> Slope:
        """The derivative at the trial or the committed state."""
        return self._slope_at(self._points_of(what))

    def _slope_at(self, points: Floats) -> Slope:
        """The derivative of the motion that has led to ``points`` (n, d); kept for a next call with the same points."""
        # the same array has the same content: the points of a state never change
        if self._latest_slope is None or self._latest_slope[0] is not points:
            self._latest_slope = points, self.model.slope(points, self.factors)
        return self._latest_slope[1]

    def _field_slope(self, what: str) -> FieldSlope:
        """The same for a session whose client has the volume."""
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

    def _by_vector(self, given: Floats, apply: Callable[[Floats], Floats]) -> Floats:
        """(m, c d) results of ``apply`` for each of the c vectors (k, d) that are the columns of ``given`` (k, c d)."""
        return np.concatenate([apply(one) for one in self._vectors(given)], axis=1)

    def _vectors(self, given: Floats) -> list[Floats]:
        """The c vectors (k, d) that are columns of ``given`` (k, c d)."""
        d = self.spec.dimension
        return [np.ascontiguousarray(given[:, i : i + d]) for i in range(0, given.shape[1], d)]
