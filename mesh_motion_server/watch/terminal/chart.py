"""Lines over steps in a few rows of characters: Braille patterns, two by four dots in each.

Of many steps that share a column of dots the line goes from the lowest to the highest, so that no minimum is lost.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from rich.text import Text

from mesh_motion_server.watch.terminal.text import number

__all__ = ["Curve", "draw_chart", "spark"]

FloatArray = NDArray[np.float64]

_BLANK = 0x2800
#: The bit of each dot: rows from the top, columns from the left.
_BITS = ((0x01, 0x08), (0x02, 0x10), (0x04, 0x20), (0x40, 0x80))
_BLOCKS = "▁▂▃▄▅▆▇█"
_LABEL = 6


@dataclass(frozen=True, eq=False)
class Curve:
    """A line of the chart.

    Attributes
    ----------
    values : (s,) array
        NaN where nothing is known.
    style : str
        rich's.
    every : int
        Only every so many columns of dots are drawn: 1 a line, 2 a dotted one, which is told apart without colour.
    """

    values: FloatArray
    style: str
    every: int = 1


def draw_chart(
    steps: FloatArray,
    curves: Sequence[Curve],
    size: tuple[int, int],
    *,
    level: float | None = None,
    marks: FloatArray | None = None,
) -> list[Text]:
    """Rows of a chart with its axes.

    Parameters
    ----------
    steps : (s,) array
        Ascending.
    curves : sequence of Curve
        Later ones lie on top.
    size : (int, int)
        Columns and rows, axes included.
    level : float, optional
        A horizontal line.
    marks : (k,) array, optional
        Steps that get a mark below the axis.
    """
    width, height = size[0] - _LABEL - 2, size[1] - 1
    if width < 8 or height < 2 or not len(steps):
        return []
    low, high = _range([curve.values for curve in curves], level)
    dots = np.zeros((height, width), dtype=np.int64)
    styles = np.full((height, width), "", dtype=object)
    columns = _columns(steps, 2 * width)
    for curve in curves:
        _draw(dots, styles, curve, columns, (low, high))
    rows = _characters(dots, styles)
    if level is not None and low <= level <= high:
        _draw_level(rows[_row_of(level, low, high, height)])
    return [*_labelled(rows, low, high), _axis(steps, width, columns, marks)]


def spark(values: FloatArray, width: int) -> str:
    """One row of bars from 0 to the largest value; each bar the largest of its steps."""
    known = np.nan_to_num(values)
    if not len(known) or width < 1:
        return ""
    edges = np.linspace(0, len(known), min(width, len(known)) + 1).astype(int)
    tops = np.maximum.reduceat(known, edges[:-1])
    top = float(tops.max())
    return "".join(_BLOCKS[min(int(8 * v / top), 7)] if top > 0 else _BLOCKS[0] for v in tops)


def _range(values: Sequence[FloatArray], level: float | None) -> tuple[float, float]:
    """Lowest and highest value of the axis."""
    known = np.concatenate([v[np.isfinite(v)] for v in values] + [np.array([] if level is None else [level])])
    if not len(known):
        return 0.0, 1.0
    low, high = float(known.min()), float(known.max())
    margin = max(0.04 * (high - low), 0.005)
    return low - margin, high + margin


def _columns(steps: FloatArray, width: int) -> NDArray[np.int64]:
    """(s,) column of dots of each step."""
    span = float(steps[-1] - steps[0])
    if span == 0:
        return np.zeros(len(steps), dtype=np.int64)
    return np.asarray(np.minimum(width * (steps - steps[0]) / span, width - 1), dtype=np.int64)


def _draw(
    dots: NDArray[np.int64],
    styles: NDArray[np.object_],
    curve: Curve,
    columns: NDArray[np.int64],
    limits: tuple[float, float],
) -> None:
    """Set the dots of a curve: in each column from its lowest to its highest, joined to the column before."""
    low, high = limits
    tall = 4 * dots.shape[0]
    known = np.isfinite(curve.values)
    if not known.any():
        return
    levels = np.clip(((high - curve.values[known]) / (high - low) * tall).astype(np.int64), 0, tall - 1)
    before: tuple[int, int] | None = None
    places = columns[known]
    starts = np.flatnonzero(np.diff(places, prepend=-1))
    for a, b in zip(starts, [*starts[1:], len(places)], strict=True):
        column, here = int(places[a]), levels[a:b]
        top, bottom = int(here.min()), int(here.max())
        if before is not None:
            last = _bridge(dots, styles, curve, before, (column, int(here[0])))
            top, bottom = _joined(last, (top, bottom), int(here[0]))
        before = column, int(here[-1])
        if column % curve.every == 0:
            _set(dots, styles, column, range(top, bottom + 1), curve.style)


def _joined(last: int, reach: tuple[int, int], first: int) -> tuple[int, int]:
    """The reach of dots in a column so that it meets the ``last`` one of the column before."""
    middle = last + (1 if first > last else -1 if first < last else 0)
    return min(reach[0], middle), max(reach[1], middle)


def _bridge(
    dots: NDArray[np.int64],
    styles: NDArray[np.object_],
    curve: Curve,
    start: tuple[int, int],
    end: tuple[int, int],
) -> int:
    """Dots of the straight line between two columns, both left out; returns the last one's row."""
    gap = end[0] - start[0]
    last = start[1]
    for column in range(start[0] + 1, end[0]):
        here = round(start[1] + (end[1] - start[1]) * (column - start[0]) / gap)
        if column % curve.every == 0:
            lower, upper = sorted((last + (here > last) - (here < last), here))
            _set(dots, styles, column, range(lower, upper + 1), curve.style)
        last = here
    return last


def _set(dots: NDArray[np.int64], styles: NDArray[np.object_], column: int, rows: range, style: str) -> None:
    for row in rows:
        dots[row // 4, column // 2] |= _BITS[row % 4][column % 2]
        styles[row // 4, column // 2] = style


def _characters(dots: NDArray[np.int64], styles: NDArray[np.object_]) -> list[Text]:
    rows = []
    for bits, looks in zip(dots, styles, strict=True):
        row = Text()
        for bit, look in zip(bits, looks, strict=True):
            row.append(chr(_BLANK + int(bit)) if bit else " ", style=look or "")
        rows.append(row)
    return rows


def _row_of(value: float, low: float, high: float, height: int) -> int:
    return min(int((high - value) / (high - low) * height), height - 1)


def _draw_level(row: Text) -> None:
    """Dashes where the row is empty."""
    dashed = "".join("╌" if letter == " " else letter for letter in row.plain)
    for place, letter in enumerate(dashed):
        if letter == "╌":
            row.stylize("dim", place, place + 1)
    row.plain = dashed


def _labelled(rows: list[Text], low: float, high: float) -> list[Text]:
    """The rows behind the axis, with a number at the top, in the middle and at the bottom."""
    height = len(rows)
    middle = height // 2
    shown = {0: high, height - 1: low}
    if height > 4:
        shown[middle] = high - (high - low) * (middle + 0.5) / height
    labelled = []
    for place, row in enumerate(rows):
        digits = 2 if high - low >= 0.05 else 3
        label = number(shown[place], digits) if place in shown else ""
        labelled.append(Text(f"{label:>{_LABEL}} {'┤' if label else '│'}", style="").append_text(row))
    return labelled


def _axis(steps: FloatArray, width: int, columns: NDArray[np.int64], marks: FloatArray | None) -> Text:
    """The first and the last step, and a mark wherever one was refused."""
    first, last = f"{steps[0]:.0f}", f"{steps[-1]:.0f}"
    line = Text(" " * (_LABEL + 1) + "└")
    letters = list(first + "─" * max(width - len(first) - len(last), 0) + (last if len(steps) > 1 else ""))[:width]
    styles = [""] * len(letters)
    for mark in marks if marks is not None else ():
        place = int(columns[min(int(np.searchsorted(steps, mark)), len(steps) - 1)]) // 2
        place = min(max(place, len(first)), width - len(last) - 1)  # beside the numbers
        if math.isfinite(mark):
            letters[place], styles[place] = "▲", "refused"
    for letter, style in zip(letters, styles, strict=True):
        line.append(letter, style="bold red" if style else "dim")
    return line
