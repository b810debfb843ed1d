"""The colours of all pictures, including those of the monitor page.

Quality is coloured by viridis (van der Walt and Smith, SciPy 2015), which is perceptually uniform: its lightness grows
evenly, so that a print without colour and people of every colour vision still order the cells. An inverted cell has a
colour that is not in viridis. Lines have the colours of Okabe and Ito (2008), which people with every kind of colour
vision can distinguish, and also different dashes.
"""

from dataclasses import dataclass
from typing import Any

#: matplotlib's name of the map from the worst to the best value.
QUALITY_MAP = "viridis"
INVERTED_COLOUR = "#e5007d"


@dataclass(frozen=True)
class Theme:
    """The colours of a picture on light or dark paper."""

    #: paper, ink, faint: background; text and outlines; grids and background items
    paper: str
    ink: str
    faint: str
    edge: str  # edges of cells, with an opacity
    #: Lines of runs, in order: Okabe and Ito's blue, vermilion, green, purple, orange and light blue, lighter on dark
    #: paper where their contrast would be below 3 : 1.
    runs: tuple[str, ...]
    #: refused, enriched: marks of refused motions; of enrichment points
    refused: str
    enriched: str
    #: matplotlib's line styles of the same runs.
    dashes: tuple[object, ...] = ("-", (0, (5, 1.5)), (0, (4, 1.2, 1, 1.2)), (0, (2, 1)), (0, (7, 2)), (0, (1, 1)))


LIGHT = Theme(
    paper="#ffffff",
    ink="#202020",
    faint="#8c8c8c",
    edge="#10101060",
    runs=("#0072b2", "#d55e00", "#008a63", "#b4568c", "#a66f00", "#2e8bc0"),
    refused=INVERTED_COLOUR,
    enriched="#d55e00",
)
DARK = Theme(
    paper="#14171c",
    ink="#e8e8e8",
    faint="#8f959e",
    edge="#00000070",
    runs=("#56b4e9", "#f0803c", "#2bc48e", "#e39cc6", "#e9b84b", "#9ad0f5"),
    refused="#ff5cab",
    enriched="#f0803c",
)


def colour_scale(scale: tuple[float, float]) -> Any:
    """matplotlib's ``norm`` and ``cmap`` for values between the (bad, good) ends of a scale."""
    from matplotlib import colormaps  # noqa: PLC0415  (an extra)
    from matplotlib.cm import ScalarMappable  # noqa: PLC0415
    from matplotlib.colors import Normalize  # noqa: PLC0415

    colours = colormaps[QUALITY_MAP]
    return ScalarMappable(Normalize(min(scale), max(scale)), colours if scale[1] > scale[0] else colours.reversed())
