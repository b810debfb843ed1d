"""Quality reports as types (SPEC.md, section 15); a test compares them with a server's."""

from typing import NotRequired, TypedDict

__all__ = ["Distribution", "PredictedQuality", "QualitySummary", "WorstCell"]


class Distribution(TypedDict):
    """A metric over all cells; 1 is ideal, negative is inverted. Only ``min`` is in every report."""

    min: float
    mean: NotRequired[float]
    p1: NotRequired[float]
    p5: NotRequired[float]
    p50: NotRequired[float]


class WorstCell(TypedDict):
    """One of the worst cells; ``cell`` is its row among the cells of its ``type`` in the ``partition``."""

    partition: int
    type: str
    cell: int
    centre: list[float]
    size: float
    skew: float
    size_skew: float
    metric: float


class QualitySummary(TypedDict):
    """Quality of the whole mesh; ``metric`` is the session's ``quality_metric``, ``worst`` has at most ten cells.

    The reply to a second move of a step may lack ``size``, ``skew`` and ``size_skew``.
    """

    size: NotRequired[Distribution]
    skew: NotRequired[Distribution]
    size_skew: NotRequired[Distribution]
    metric: Distribution
    inverted: int
    cells: int
    worst: list[WorstCell]


class PredictedQuality(TypedDict):
    """Quality that a move predicts: of the plain interpolation, ``standard``, and of the answer, ``corrected``."""

    metric: str
    threshold: float
    standard: QualitySummary
    corrected: QualitySummary
