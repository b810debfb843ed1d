"""A study: a question, and a function that answers it with tables and pictures.

A study is a module with a ``STUDY``; see ``thesis/`` and ``beyond/``. It computes everything again each time, so the
documentation shows the results of the current code. ``run(quick=True)`` does the same with fewer samples, in seconds:
the tests run every study in this way and check the results with its ``claims``.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

__all__ = ["Outcome", "Picture", "Study", "Table"]

Cell = Any  # str, int, float or None: claims compute with a column's cells, and know which kind it has


@dataclass(frozen=True)
class Table:
    """A table; numbers are shown with ``digits`` significant digits, integers in full, None as a dash."""

    columns: Sequence[str]
    rows: Sequence[Sequence[Cell]]
    caption: str = ""
    digits: int = 4

    def __post_init__(self) -> None:
        for row in self.rows:
            if len(row) != len(self.columns):
                raise ValueError(f"expected {len(self.columns)} cells, as {list(self.columns)}, got {list(row)}")

    def markdown(self) -> str:
        """The table in GitHub's Markdown."""
        lines = ["| " + " | ".join(self.columns) + " |", "|" + " --- |" * len(self.columns)]
        lines += ["| " + " | ".join(_shown(cell, self.digits) for cell in row) + " |" for row in self.rows]
        return "\n".join(([self.caption, ""] if self.caption else []) + lines)

    def column(self, name: str) -> list[Any]:
        """The cells under a heading."""
        place = list(self.columns).index(name)
        return [row[place] for row in self.rows]


@dataclass(frozen=True)
class Picture:
    """A picture: ``draw`` gets an empty matplotlib figure of ``size`` inches."""

    draw: Callable[[Any], None]
    caption: str = ""
    size: tuple[float, float] = (9.0, 4.0)


@dataclass(frozen=True)
class Outcome:
    """Results of a study, in the order on the page: text (with computed values), tables, pictures."""

    tables: Sequence[Table] = ()
    pictures: Sequence[Picture] = ()
    text: str = ""


@dataclass(frozen=True)
class Study:
    """One study.

    Attributes
    ----------
    title : str
        What is asked, in a line.
    source : str
        The tables, figures and equations of the thesis it reproduces ("Fig 2.3"), or the open question.
    run : callable
        ``run(quick)`` → Outcome.
    claims : callable
        Raises AssertionError where an outcome, quick or full, does not show what the documentation says of it.
    functions : tuple of str
        Dotted names of the functions that do the work: where to read on.
    """

    title: str
    source: str
    run: Callable[[bool], Outcome]
    claims: Callable[[Outcome], None]
    functions: tuple[str, ...] = field(default=())


def _shown(cell: Cell, digits: int) -> str:
    """A cell's text."""
    if cell is None:
        return "–"
    if isinstance(cell, float):
        return f"{cell:.{digits}g}".replace("-", "−")
    return str(cell)


_LARGE, _COLOURS = 150_000, 64  # bytes of a picture; what fine line drawings get by with


def save_picture(picture: Picture, path: Path) -> None:
    """Draw a picture into a PNG file; a large one with few colours."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg  # noqa: PLC0415 matplotlib only where something is drawn
    from matplotlib.figure import Figure  # noqa: PLC0415

    figure = Figure(figsize=picture.size, dpi=90, layout="constrained")
    FigureCanvasAgg(figure)
    picture.draw(figure)
    figure.savefig(path, metadata={"Software": None})
    if path.stat().st_size > _LARGE:
        from PIL import Image  # noqa: PLC0415 comes with matplotlib

        with Image.open(path) as drawn:
            few = drawn.convert("RGB").quantize(_COLOURS)
        few.save(path, optimize=True)
