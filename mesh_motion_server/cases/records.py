"""The results of each step of a played case: computed from coordinates, or reported by the server."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from typing import TYPE_CHECKING, Any

from mesh_motion_numerics.quality.metrics import CellQuality
from mesh_motion_protocol.headroom import headroom_in_words

from mesh_motion_server.cases.faces import FACES, faces_numbers
from mesh_motion_server.watch.observation.series import PHASES

if TYPE_CHECKING:
    from mesh_motion_client.moved import Moved

VTU_METRICS = ("size", "skew", "size-skew", "relative-size-skew")
"""Data of every cell in the mesh series."""
_NEAR = 3.0  # largest number of steps until the end that is reported


@dataclass(frozen=True, kw_only=True)
class StepRecord:
    """One committed step; the fields are the keys of summary.json's ``steps``, the plain ones columns of steps.csv."""

    step: int
    #: min_size, min_skew, min_size_skew, mean_size_skew, min_relative_size_skew, mean_relative_size_skew: quality of
    #: the mesh after the step, from its coordinates; size and relative skew refer to the mesh at opening
    min_size: float
    min_skew: float
    min_size_skew: float
    mean_size_skew: float
    min_relative_size_skew: float
    mean_relative_size_skew: float
    inverted_cells: int
    predicted_min: float  # the server's prediction of the case's quality metric for its motion, before any node moved
    predicted_standard: float  # its prediction for the plain motion, without correction
    #: enrichment_points, freed_nodes: numbers that the correction used
    enrichment_points: int
    freed_nodes: int
    iterations: int  # coupling iterations
    #: Largest distance between a moving or fixed node and its prescribed position, mesh length unit.
    boundary_error: float
    seconds: float  # wall time of the step in the driver: all iterations, the wire and the commit
    #: seconds_solve, seconds_predict, seconds_correct, seconds_displace: time of the server's phases, summed over all
    #: iterations
    seconds_solve: float
    seconds_predict: float
    seconds_correct: float
    seconds_displace: float
    sub_steps: int = 1  # number of sub-steps that the server used in the last iteration; 1 for a single step
    #: headroom_threshold, headroom_inversion: number of such steps after this one until the threshold, and until a cell
    #: inverts; None: more than 100
    headroom_threshold: float | None = None
    headroom_inversion: float | None = None
    #: Face quality for finite-volume codes, ``before`` (the mesh at opening) and ``after`` the step:
    #: :data:`~.faces.FACES` and the worst face. The last columns of steps.csv are the values after the step. Empty in
    #: one dimension.
    faces: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)

    @classmethod
    def of(
        cls, step: int, quality: CellQuality, moved: Moved, phases: Mapping[str, float], **driven: Any
    ) -> StepRecord:
        """The record of a step.

        Parameters
        ----------
        quality : CellQuality
            Quality of the coordinates after the step.
        moved : Moved
            The reply to the step's last Move.
        phases : dict
            Seconds of the server's phases, all iterations together.
        driven
            Values from the driver: ``iterations``, ``boundary_error`` and ``seconds``.
        """
        size_skew, relative = quality.metric("size-skew"), quality.metric("relative-size-skew")
        seconds: dict[str, Any] = {f"seconds_{phase}": phases[phase] for phase in PHASES}
        return cls(
            step=step,
            min_size=float(quality.size.min()),
            min_skew=float(quality.skew.min()),
            min_size_skew=float(size_skew.min()),
            mean_size_skew=float(size_skew.mean()),
            min_relative_size_skew=float(relative.min()),
            mean_relative_size_skew=float(relative.mean()),
            inverted_cells=int(quality.inverted.sum()),
            predicted_min=float(moved.quality["corrected"]["metric"]["min"]),
            predicted_standard=float(moved.quality["standard"]["metric"]["min"]),
            enrichment_points=len(moved.enrichment_points),
            freed_nodes=int(moved.correction.get("freed_nodes", 0)),
            sub_steps=int(moved.correction.get("sub_steps", 1)),
            headroom_threshold=moved.headroom.get("threshold"),
            headroom_inversion=moved.headroom.get("inversion"),
            faces=faces_numbers(moved.faces),
            **seconds,
            **driven,
        )

    @property
    def ahead(self) -> str:
        """When the mesh ends if the motion continues as in this step, in one line; empty if that is far away."""
        ends = {"threshold": self.headroom_threshold, "inversion": self.headroom_inversion}
        return headroom_in_words({end: steps for end, steps in ends.items() if steps is not None and steps <= _NEAR})

    def shown(self, metric: str) -> tuple[float, float]:
        """Minimum and mean of the quality that :func:`drawn` selects for a metric."""
        if drawn(metric) == "size-skew":
            return self.min_size_skew, self.mean_size_skew
        return self.min_relative_size_skew, self.mean_relative_size_skew

    @classmethod
    def columns(cls) -> tuple[str, ...]:
        """Names of the plain fields, in order."""
        return tuple(f.name for f in fields(cls) if f.name != "faces")

    def as_dict(self) -> dict[str, Any]:
        """Plain values by name."""
        return asdict(self)

    def as_row(self) -> dict[str, Any]:
        """The columns of steps.csv; NaN for unknown values."""
        after = self.faces.get("after", {})
        found = {name: getattr(self, name) for name in self.columns()} | {name: after.get(name) for name in FACES}
        return {name: math.nan if value is None else value for name, value in found.items()}


def drawn(metric: str) -> str:
    """The quality that pictures show for a case with this metric."""
    return metric if metric == "relative-size-skew" else "size-skew"


def add_seconds(total: Mapping[str, float], more: Mapping[str, float]) -> dict[str, float]:
    """The sum of two motions' seconds for each phase."""
    return {phase: float(total.get(phase, 0.0)) + float(more.get(phase, 0.0)) for phase in PHASES}
