"""A case's motion in this process, step by step, as the server would make it: nothing is stored, nothing is sent."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mesh_motion_server.cases.case import Case
from mesh_motion_server.cases.motion_program import MotionProgram
from mesh_motion_server.errors import NumericalError
from mesh_motion_server.files import MeshFile
from mesh_motion_server.numerics.mesh.roles import Patch
from mesh_motion_server.numerics.motion.motion import MotionModel
from mesh_motion_server.numerics.motion.motion_found import Motion

__all__ = ["Prediction", "named"]

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Prediction:
    """A case's mesh, method and motion."""

    model: MotionModel
    program: MotionProgram
    reference: Floats

    @classmethod
    def of(cls, case: Case, mesh: MeshFile, program: MotionProgram) -> Prediction:
        """Prepare what every step needs; errors are those of opening a session."""
        patches = {name: Patch(role, mesh.patches[name]) for name, role in case.content.patches.items()}
        method = case.content.method.to_method()
        return cls(MotionModel.build(mesh.points, mesh.cell_table, patches, method), program, mesh.points)

    def targets(self, step: int) -> Floats:
        """(k, d) where the moving nodes shall be."""
        return self.reference[self.program.nodes] + self.program.displacement(step)

    def steps(self) -> Iterator[Motion]:
        """The motion of one step after the other, each from the one before.

        Raises
        ------
        NumericalError
            Where one is refused.
        """
        committed, model = self.reference, self.model.without_distributions()
        for step in range(1, self.program.count + 1):
            motion = model.move(committed, self.targets(step))
            yield motion
            committed = motion.points

    def trial(self, committed: Floats, step: int) -> Floats:
        """The mesh (n, d) that one step makes, be it invalid: uncorrected where no correction comes to an end.

        Raises
        ------
        MeshMotionError
            Where there is none at all.
        """
        kept = self.model.with_method(allow_invalid=True, refuse_below_threshold=False, sub_steps="never")
        targets = self.targets(step)
        try:
            return kept.move(committed, targets).points
        except NumericalError:
            return kept.with_method(correction="none").move(committed, targets).points

    def worst(self, points: Floats) -> list[dict[str, Any]]:
        """The worst cells of the mesh at ``points`` (n, d), the worst first.

        Each with type, cell (its number in the type), number (in the mesh), centre (mesh length unit) and size_skew.
        """
        found = []
        for cell in self.model.summary(points).worst:
            block, row = self.model.cells.locate(cell.number)
            place = {"type": block.type.name, "cell": row, "number": cell.number, "centre": list(cell.centre)}
            found.append(place | {"size_skew": cell.size_skew})
        return found


def named(cell: dict[str, Any]) -> str:
    """One of the worst cells, in words."""
    return f"the worst cell is {cell['type']} {cell['cell']} near ({', '.join(f'{x:.4g}' for x in cell['centre'])})"
