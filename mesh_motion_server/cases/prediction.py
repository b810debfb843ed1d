"""Compute a case's motion in this process, step by step, as the server would; nothing is stored or sent."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from mesh_motion_numerics.arrays import Floats
from mesh_motion_numerics.mesh.roles import Patch
from mesh_motion_numerics.motion.motion import MotionModel
from mesh_motion_numerics.motion.motion_found import Motion
from mesh_motion_numerics.motion.one_layer_motion import OneLayerMotion, motion_model
from mesh_motion_protocol.errors import QualityRefused

from mesh_motion_server.cases.case import Case
from mesh_motion_server.cases.motion_program import MotionProgram
from mesh_motion_server.files import MeshFile


@dataclass(frozen=True, eq=False)
class Prediction:
    """A case's mesh, method and motion."""

    model: MotionModel | OneLayerMotion
    program: MotionProgram
    reference: Floats

    @classmethod
    def of(cls, case: Case, mesh: MeshFile, program: MotionProgram) -> Prediction:
        """Prepare the data for all steps; errors are the same as when a session is opened."""
        patches = {name: Patch(role, mesh.patches[name]) for name, role in case.roles.items()}
        method = case.content.method.to_method()
        return cls(motion_model(mesh.points, mesh.cell_table, patches, method), program, mesh.points)

    def targets(self, step: int) -> Floats:
        """(k, d) prescribed positions of the moving nodes."""
        return self.reference[self.program.nodes] + self.program.displacement(step)

    def steps(self) -> Iterator[Motion]:
        """Yield the motion of each step, starting from the step before. Raises QualityRefused if a step is refused."""
        committed, model = self.reference, self.model.without_distributions()
        for step in range(1, self.program.count + 1):
            motion = model.move(committed, self.targets(step))
            yield motion
            committed = motion.points

    def trial(self, committed: Floats, step: int) -> Floats:
        """The mesh (n, d) after one step, even if it is invalid; without a correction if none succeeds.

        Raises MeshMotionError if no mesh can be computed.
        """
        kept = self.model.with_method(allow_invalid=True, refuse_below_threshold=False, sub_steps="never")
        targets = self.targets(step)
        try:
            return kept.move(committed, targets).points
        except QualityRefused:
            return kept.with_method(correction="none").move(committed, targets).points

    def worst(self, points: Floats) -> list[dict[str, Any]]:
        """The worst cells of the mesh at ``points`` (n, d), the worst first.

        Keys: type, cell (its number in the type), number (in the mesh), centre (mesh length unit) and size_skew.
        """
        found = []
        for cell in self.model.summary(points).worst:
            block, row = self.model.cells.locate(cell.number)
            place = {"type": block.type.name, "cell": row, "number": cell.number, "centre": list(cell.centre)}
            found.append(place | {"size_skew": cell.size_skew})
        return found


def named(cell: dict[str, Any]) -> str:
    """A text that describes one of the worst cells."""
    return f"the worst cell is {cell['type']} {cell['cell']} near ({', '.join(f'{x:.4g}' for x in cell['centre'])})"
