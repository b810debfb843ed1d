"""MOVE of a session at a committed step, with displacements that no mesh can follow."""

import math
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np

from tests.faults.inputs.cases import BadInput, Names, Rng, spoilt
from tests.faults.inputs.drafts import Draft, Rows

_VALUE, _SHAPE, _DTYPE = "INVALID_ARGUMENT.VALUE", "INVALID_ARGUMENT.SHAPE", "INVALID_ARGUMENT.DTYPE"
_NONFINITE, _PARTITION = "INVALID_ARGUMENT.NONFINITE", "INVALID_ARGUMENT.PARTITION"
_QUALITY, _STEP = "FAILED_PRECONDITION.QUALITY", "FAILED_PRECONDITION.STEP"


def _finite(value: Any) -> bool:
    return isinstance(value, float) and math.isfinite(value)


def _cells(value: Any) -> bool:
    """At least one cell, each named by partition, type and number."""
    return bool(value) and all({"partition", "type", "cell"} <= set(place) for place in value)


def _fraction(value: Any) -> bool:
    return _finite(value) and 0.0 <= value < 1.0


#: The details of a refusal for quality.
_WORST: Names = {"best": _finite, "fraction": _fraction, "worst": _cells}


def _nonfinite(value: float, dtype: type[Any] = np.float64) -> BadInput:
    """Somewhere in the rows."""

    def spoil(draft: Draft, rng: Rng) -> Names:
        rows = draft.moved.astype(dtype)
        row, axis = int(rng.integers(len(rows))), int(rng.integers(rows.shape[1]))
        rows[row, axis] = value
        draft.displacement[0] = Rows(rows)
        return {"partition": 0, "row": row, "node": 5 * row, "value": str(value)}

    name = f"displacement of {value} ({dtype.__name__})"
    return BadInput(name, "move", spoil, _NONFINITE, ("row", "node", str(value)))


def _rows(name: str, code: str, values: Any, *says: str) -> BadInput:
    """Rows that are not one pair of floats for each of the five moving nodes."""
    names = {"partition": 0, "expected": [5, 2]} if np.ndim(values) == 2 else {"field": "displacement"}
    if np.asarray(values).dtype.kind == "i":
        names = {"field": "displacement"}

    def change(draft: Draft) -> None:
        draft.displacement[0] = Rows(np.asarray(values))

    return spoilt(name, "move", code, change, names, *says)


def _step(step: Any, code: str, names: Names, *says: str) -> BadInput:
    return spoilt(f"MOVE of step {step}", "move", code, lambda draft: setattr(draft, "step", step), names, *says)


def _unmovable(
    name: str,
    change: Callable[[Draft], Any],
    *says: str,
    draft: str = "square",
    settings: Mapping[str, Any] | None = None,
) -> BadInput:
    """A displacement for which there is no acceptable mesh."""

    def spoil(spoiled: Draft, rng: Rng) -> Names:
        spoiled.displacement[0], spoiled.frame = Rows(np.array(change(spoiled), dtype=np.float64)), "reference"
        return _WORST

    return BadInput(name, "move", spoil, _QUALITY, says, draft=draft, settings=settings)


def _body(draft: Draft) -> Any:
    """(k, 2) places of the moving nodes of the hole."""
    return draft.points[draft.rows("patch", "body")[:, 0]]


def _crossed(_: Draft) -> Any:
    rows = np.zeros((5, 2))
    rows[1, 1], rows[2, 1] = 0.25, -0.25
    return rows


def _disagreeing(draft: Draft, rng: Rng) -> Names:
    """The second partition moves a shared node a little further."""
    row = int(rng.integers(len(draft.displacement[1].values)))
    draft.displacement[1].values[row, 1] += 1e-7
    return {"global_id": (5, 10, 15, 20)[row], "partitions": [0, 1]}


def _second_partition(draft: Draft, rng: Rng) -> Names:
    row = int(rng.integers(len(draft.displacement[1].values)))
    draft.displacement[1].values[row, 0] = np.nan
    return {"partition": 1, "row": row, "value": "nan"}


def _overflow(draft: Draft, rng: Rng) -> Names:
    row, axis = int(rng.integers(5)), int(rng.integers(2))
    draft.moved[row, axis] = 1.7976931348623157e308
    return {"partition": 0, "row": row, "node": 5 * row}


def _enormous(factor: float) -> BadInput:
    names = {"partition": 0, "row": 0, "node": 0, "value": lambda value: abs(float(value)) > 1e-3 * factor}
    change = partial(np.multiply, factor)
    return spoilt(f"displacement × {factor:g}", "move", _VALUE, lambda d: change(d.moved, out=d.moved), names, "node 0")


BAD_MOVES = (
    *(_nonfinite(value) for value in (np.nan, np.inf, -np.inf)),
    _nonfinite(np.nan, np.float32),
    _nonfinite(np.inf, np.float32),
    _rows("a row too few", _SHAPE, np.zeros((4, 2)), "(5, 2)", "(4, 2)"),
    _rows("a row too many", _SHAPE, np.zeros((6, 2)), "(5, 2)", "(6, 2)"),
    _rows("no rows", _SHAPE, np.zeros((0, 2)), "(5, 2)", "(0, 2)"),
    _rows("rows for all nodes", _SHAPE, np.zeros((25, 2)), "(5, 2)", "(25, 2)"),
    _rows("rows of three components", _SHAPE, np.zeros((5, 3)), "(5, 2)", "(5, 3)"),
    _rows("rows of one component", _SHAPE, np.zeros((5, 1)), "(5, 2)", "(5, 1)"),
    _rows("a flat array", _SHAPE, np.zeros(10), "(10,)"),
    _rows("integers", _DTYPE, np.zeros((5, 2), int), "<f8", "<i8"),
    *(_step(step, _STEP, {"expected": 2, "got": step}, "expected step 2") for step in (0, 1, 3, 2**63 - 1)),
    _step(-1, _VALUE, {"field": "step"}, "-1"),
    _step(2**63, "INVALID_ARGUMENT.HEADER", {"field": "step"}, str(2**63)),
    _step(2.0, "INVALID_ARGUMENT.HEADER", {"field": "step"}, "integer"),
    spoilt("an unknown frame", "move", _VALUE, lambda draft: setattr(draft, "frame", "absolute"), {"field": "frame"},
           "absolute", "committed", "reference"),
    spoilt("an unknown field", "move", "INVALID_ARGUMENT.HEADER", lambda draft: draft.extra.update(viscosity=1.0),
           {"field": "viscosity"}, "viscosity"),
    BadInput("the largest float", "move", _overflow, _VALUE, ("node",)),
    _enormous(1e300),
    _enormous(1e160),
    _enormous(1e60),
    _unmovable("displacement × 1000", lambda d: 1000 * d.moved, "no valid mesh"),
    _unmovable("the wall through the fixed one", lambda _: np.tile([1.5, 0.0], (5, 1)), "no valid mesh"),
    _unmovable("the wall onto the fixed one", lambda _: np.tile([1.0, 0.0], (5, 1)), "no valid mesh"),
    _unmovable("all moving nodes in one place", lambda d: [0.5, 0.5] - d.points[::5], "no valid mesh"),
    _unmovable("the wall upside down", lambda d: [0.0, 1.0] - d.points[::5] * [0.0, 2.0], "no valid mesh"),
    _unmovable("neighbours changed", _crossed, "no valid mesh"),
    _unmovable("the body outside", lambda d: np.tile([2.0, 0.0], (len(d.moved), 1)), "no valid mesh", draft="hole"),
    _unmovable("the body inside out", lambda d: 2 * (0.5 - _body(d)) * [1, 0], "no valid mesh", draft="hole"),
    _unmovable(
        "the body into its wall", lambda d: np.tile([0.4, 0.0], (len(d.moved), 1)), "no valid mesh", draft="hole"
    ),
    _unmovable("the body through itself", lambda d: 1.5 * (0.5 - _body(d)), "no valid mesh", draft="hole"),
    _unmovable("the bottom above the top", lambda _: np.tile([0.0, 0.0, 1.5], (9, 1)), "no valid mesh", draft="cube"),
    _unmovable("1D, past the other end", lambda _: [[1.5]], "no valid mesh", draft="line"),
    _unmovable("1D, onto the other end", lambda _: [[1.0]], "no valid mesh", draft="line"),
    _unmovable(
        "a large motion, uncorrected",
        lambda _: np.tile([0.9, 0.9], (5, 1)),
        "no valid mesh",
        settings={"correction": "none"},
    ),
    _unmovable(
        "below the threshold",
        lambda _: np.tile([0.5, 0.2], (5, 1)) * [[0], [1], [1], [1], [0]],
        "threshold",
        settings={"quality_threshold": 0.5, "refuse_below_threshold": True},
    ),
    BadInput("partitions that disagree", "move", _disagreeing, _PARTITION, ("global id",), draft="halves"),
    BadInput("NaN in the second partition", "move", _second_partition, _NONFINITE, ("partition 1",), draft="halves"),
    # the ends of the left side are images of each other
    spoilt("periodic images that part", "move", _VALUE, lambda draft: np.add(draft.moved[4], 0.01, out=draft.moved[4]),
           {"node": lambda node: node in {0, 20}}, "node", draft="periodic"),
)  # fmt: skip
