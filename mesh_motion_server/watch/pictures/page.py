"""The page of a figure: its size in millimetres, its font size, and its file.

A figure is made at its printed size, so that its font has 7 to 8 points there. Text stays text in PDF, with the glyphs
that it needs embedded; in SVG it is outlines, which look the same on systems without the font. The file depends on the
content alone: it has no date, and a new run gives the same bytes.
"""

import re
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from mesh_motion_protocol.errors import InvalidInput, ResourceExhausted

from mesh_motion_server.files.replace import replacing
from mesh_motion_server.watch.pictures.palette import LIGHT, Theme
from mesh_motion_server.watch.terminal.text import plain

FORMATS = ("png", "svg", "pdf")
#: Elsevier's widths of figures, mm (other publishers' are near them), and a slide of 16 : 9.
PRESETS: dict[str, tuple[float, float | None]] = {
    "column": (90.0, None),
    "wide": (140.0, None),
    "page": (190.0, None),
    "slide": (254.0, 143.0),
}
_LIMITS_MM = (30.0, 1500.0)
_MM_PER_INCH = 25.4
_POINTS = 8.0
#: Slides need a larger font because people read them from a distance.
_SLIDE_POINTS = 12.0


@dataclass(frozen=True)
class Page:
    """The paper that a figure is drawn on."""

    width: float = 140.0  # mm
    height: float | None = None  # mm; None: the height of the content
    theme: Theme = LIGHT
    points: float = _POINTS  # size of the type
    dpi: int = 300  # resolution of PNG, and of pixel images inside SVG and PDF

    def inches(self, natural_height: float) -> tuple[float, float]:
        """Width and height, inches; ``natural_height`` (mm) is the height of the content."""
        return self.width / _MM_PER_INCH, (self.height or natural_height) / _MM_PER_INCH


def parse_size(text: str) -> tuple[float, float | None, float]:
    """Width and height, mm, and the size of the type, points, of a preset's name, ``120`` or ``120x80``.

    Raises InvalidInput for other texts.
    """
    if text in PRESETS:
        return *PRESETS[text], _SLIDE_POINTS if text == "slide" else _POINTS
    found = re.fullmatch(r"(\d+(?:\.\d*)?)(?:\s*[x×]\s*(\d+(?:\.\d*)?))?\s*(?:mm)?", text.strip())
    sizes = [float(part) for part in found.groups() if part] if found else []
    low, high = _LIMITS_MM
    if not sizes or not all(low <= size <= high for size in sizes):
        raise InvalidInput(
            f"--size: expected {', '.join(PRESETS)}, or WIDTH or WIDTHxHEIGHT in mm from {low:g} to {high:g}, "
            f"got {text!r}",
            hint="a column of most journals is 90 mm wide: --size column, or --size 90x60",
        )
    return sizes[0], sizes[1] if len(sizes) > 1 else None, _POINTS


def pictures_are_possible() -> bool:
    """Whether matplotlib is installed."""
    return find_spec("matplotlib") is not None


@contextmanager
def styled(page: Page) -> Iterator[None]:
    """Set matplotlib for a figure on this page, while it is made and saved."""
    import matplotlib  # noqa: PLC0415  (an extra)

    theme, points = page.theme, page.points
    settings: Any = {
        "font.family": "DejaVu Sans",  # this font comes with matplotlib: the same picture on every system
        "font.size": points,
        "axes.titlesize": points,
        "axes.labelsize": points,
        "xtick.labelsize": points - 1.0,
        "ytick.labelsize": points - 1.0,
        "legend.fontsize": points - 1.0,
        "figure.titlesize": points + 1.0,
        "figure.titleweight": "bold",
        "axes.titleweight": "normal",
        "axes.linewidth": 0.6,
        "axes.spines.top": False,
        "axes.spines.right": False,
        "xtick.major.width": 0.6,
        "ytick.major.width": 0.6,
        "xtick.major.size": 2.5,
        "ytick.major.size": 2.5,
        "lines.linewidth": 1.1,
        "grid.linewidth": 0.4,
        "legend.frameon": False,
        "legend.handlelength": 2.2,
        "figure.facecolor": theme.paper,
        "axes.facecolor": theme.paper,
        "savefig.facecolor": theme.paper,
        "text.color": theme.ink,
        "axes.labelcolor": theme.ink,
        "axes.edgecolor": theme.ink,
        "axes.titlecolor": theme.ink,
        "xtick.color": theme.ink,
        "ytick.color": theme.ink,
        "grid.color": theme.faint,
        "grid.alpha": 0.35,
        "pdf.fonttype": 42,
        "svg.hashsalt": "mesh-motion",
        "text.parse_math": False,  # a name may contain dollar signs
    }
    with matplotlib.rc_context(settings):
        yield


def blank(page: Page, height: float, *, fixed_aspect: bool = False) -> Any:
    """An empty matplotlib figure; ``height`` (mm) is the content's own, which may have panels of a fixed aspect."""
    from matplotlib.figure import Figure  # noqa: PLC0415  (an extra)

    figure: Any = Figure(figsize=page.inches(height), layout="compressed" if fixed_aspect else "constrained")
    figure.get_layout_engine().set(h_pad=0.03, w_pad=0.05, hspace=0.03, wspace=0.04)
    return figure


def save(figure: Any, path: Path, page: Page) -> None:
    """Write a matplotlib figure; the suffix chooses the format, and the file is replaced in one step.

    Raises InvalidInput for a suffix that is not in :data:`FORMATS`. Raises ResourceExhausted if the file cannot be
    written.
    """
    kind = format_of(path)
    nothing: dict[str, Any] = {"png": {"Software": None}, "svg": {"Date": None}, "pdf": {"CreationDate": None}}[kind]
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with replacing(path) as file, warnings.catch_warnings():
            warnings.filterwarnings("ignore", "Glyph")  # characters missing in a font become boxes in the picture
            _make_inert(figure)
            for _ in range(2):  # in one pass, panels of a fixed aspect would leave titles over each other
                figure.get_layout_engine().execute(figure)
            figure.savefig(file, format=kind, dpi=page.dpi, metadata=nothing)
    except OSError as error:
        raise ResourceExhausted(f"{path}: the picture cannot be written: {error.strerror or error}") from None


def _make_inert(figure: Any) -> None:
    """Make text safe, because names come from files and clients: an SVG with control characters is no XML, and
    matplotlib's warnings would print them.
    """
    for text in figure.findobj(lambda artist: hasattr(artist, "set_text")):
        text.set_text("\n".join(map(plain, text.get_text().split("\n"))))


def format_of(path: Path) -> str:
    """Return one of :data:`FORMATS`, by the suffix. Raises InvalidInput."""
    kind = path.suffix.lower().removeprefix(".")
    if kind not in FORMATS:
        raise InvalidInput(
            f"--out: expected a file ending in {', '.join('.' + name for name in FORMATS)}, got {path.name!r}",
            hint="the suffix chooses the format: PDF or SVG for a paper, PNG for a page",
        )
    return kind
