"""Types of fields that several messages share, with the conditions on their values."""

from __future__ import annotations

from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from mesh_motion_protocol.declarations import ArrayField, Choice, Length, Range
from mesh_motion_protocol.limits import NAME_BYTES

__all__ = [
    "CornerNodes",
    "Count",
    "Digest",
    "Evaluation",
    "FieldBoxes",
    "FieldCentres",
    "FieldCoefficients",
    "FieldColumns",
    "FloatEnrichment",
    "FloatMoving",
    "FloatMovingIfGiven",
    "FloatNodes",
    "FloatNodesIfAsked",
    "Frame",
    "FreedIds",
    "FreedVectors",
    "HeadroomAlong",
    "JudgedBins",
    "JudgedCells",
    "JudgedValues",
    "KnownMovingIndices",
    "KnownPatchIndices",
    "MovingIndices",
    "MovingVectors",
    "Name",
    "NodeVectors",
    "Outcome",
    "Partition",
    "Reach",
    "RegionCorners",
    "RegionDisplacement",
    "RegionIds",
    "RegionNodes",
    "RegionPlaces",
    "RegionTold",
    "RegionVectors",
    "Report",
    "Role",
    "SessionId",
    "SweptVolumes",
    "Time",
    "TimeLevels",
    "TimeScheme",
    "Token",
    "UploadRows",
    "Uuid",
    "WallFacets",
    "Which",
]

Uuid = Annotated[bytes, Length(exactly=16)]
Token = Annotated[bytes, Length(exactly=32)]
Digest = Annotated[bytes, Length(exactly=32)]
SessionId = Annotated[str, Length(at_most=32)]
Name = Annotated[str, Length(at_most=NAME_BYTES)]
Count = Annotated[int, Range(0, 2**63 - 1)]
Partition = Annotated[int, Range(0, 255)]
Frame = Annotated[str, Choice(("committed", "reference"))]
Report = Annotated[str, Choice(("", "faces", "headroom", "swept"))]
HeadroomAlong = Annotated[str, Choice(("step", "displacement", "velocity"))]
Time = float | None
Reach = float | None
TimeLevels = Annotated[str, Choice(("", "bdf2", "bossak"))]
TimeScheme = Annotated[str, Choice(("", "tangent", "bdf1", "bdf2", "bossak"))]
Which = Annotated[str, Choice(("trial", "committed"))]
Evaluation = Annotated[str, Choice(("server", "client"))]
Outcome = Annotated[str, Choice(("keep", "discard"))]
Role = Annotated[str, Choice(("", "moving", "fixed", "slip", "symmetry", "periodic"))]

FloatNodes = Annotated[NDArray[np.float64], ArrayField("<f8", ("node", "dimension"))]
FloatMoving = Annotated[NDArray[np.float64], ArrayField("<f8", ("moving node", "dimension"))]
FloatNodesIfAsked = Annotated[NDArray[np.float64] | None, ArrayField("<f8", ("node", "dimension"), required=False)]
FloatMovingIfGiven = Annotated[
    NDArray[np.float64] | None, ArrayField("<f8", ("moving node", "dimension"), required=False)
]
CornerNodes = Annotated[NDArray[np.int64] | None, ArrayField("<i8", ("swept face", "corner"), required=False)]
SweptVolumes = Annotated[NDArray[np.float64] | None, ArrayField("<f8", ("swept face",), required=False)]
FloatEnrichment = Annotated[NDArray[np.float64], ArrayField("<f8", ("enrichment point", "dimension"))]
MovingVectors = Annotated[NDArray[np.float64], ArrayField("<f8", ("moving node", "column"))]
NodeVectors = Annotated[NDArray[np.float64], ArrayField("<f8", ("node", "column"))]
MovingIndices = Annotated[NDArray[np.int64], ArrayField("<i8", ("moving node",))]
KnownMovingIndices = Annotated[NDArray[np.int64] | None, ArrayField("<i8", ("moving node",), required=False)]
KnownPatchIndices = Annotated[NDArray[np.int64] | None, ArrayField("<i8", ("patch node",), required=False)]
FieldCentres = Annotated[NDArray[np.float64] | None, ArrayField("<f8", ("centre", "dimension"), required=False)]
FieldBoxes = Annotated[NDArray[np.float64] | None, ArrayField("<f8", ("box", "column"), required=False)]
FieldCoefficients = Annotated[
    NDArray[np.float64] | None, ArrayField("<f8", ("coefficient", "dimension"), required=False)
]
FieldColumns = Annotated[NDArray[np.float64] | None, ArrayField("<f8", ("coefficient", "column"), required=False)]
FreedIds = Annotated[NDArray[np.int64] | None, ArrayField("<i8", ("freed node",), required=False)]
FreedVectors = Annotated[NDArray[np.float64] | None, ArrayField("<f8", ("freed node", "column"), required=False)]
RegionIds = Annotated[NDArray[np.int64] | None, ArrayField("<i8", ("region node",), required=False)]
RegionVectors = Annotated[NDArray[np.float64] | None, ArrayField("<f8", ("region node", "column"), required=False)]
JudgedBins = Annotated[NDArray[np.int64], ArrayField("<i8", ("bin", "column"))]
JudgedValues = Annotated[NDArray[np.float64], ArrayField("<f8", ("value", "column"))]
JudgedCells = Annotated[NDArray[np.float64], ArrayField("<f8", ("cell", "column"))]
RegionNodes = Annotated[NDArray[np.int64], ArrayField("<i8", ("region node",))]
RegionTold = Annotated[NDArray[np.int64], ArrayField("<i8", ("region node", "column"))]
RegionPlaces = Annotated[NDArray[np.float64], ArrayField("<f8", ("region node", "dimension"))]
RegionDisplacement = Annotated[NDArray[np.float64], ArrayField("<f8", ("freed node", "dimension"))]
RegionCorners = Annotated[NDArray[np.int64], ArrayField("<i8", ("corner", "column"))]
WallFacets = Annotated[NDArray[np.float64] | None, ArrayField("<f8", ("facet", "column"), required=False)]
UploadRows = Annotated[NDArray[Any] | None, ArrayField("<f8|<i8", ("row", "column"), required=False, narrow=True)]
