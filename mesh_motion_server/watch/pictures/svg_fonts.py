"""Write SVG with real text and embedded glyphs: it looks the same on systems without the font.

matplotlib writes either outlines, which nobody can search or edit, or bare text, which needs the font. Here the text
stays, and a subset of each face in use is embedded as a web font (WOFF), which browsers read; other readers find the
name of the family.
"""

import base64
import io
import re
from collections.abc import Mapping
from html import unescape
from typing import Any, BinaryIO

__all__ = ["embed_fonts", "write_svg"]

_FAMILY = "DejaVu Sans"
_TEXT = re.compile(r"<text\b([^>]*)>(.*?)</text>", re.DOTALL)
_DEFS = re.compile(r"<defs>\s*<style type=\"text/css\">")


def write_svg(figure: Any, file: BinaryIO, *, dpi: int, metadata: Mapping[str, Any]) -> None:
    """Write a matplotlib figure as SVG with embedded fonts; ``dpi`` applies to pixel images in it."""
    text = io.StringIO()
    figure.savefig(text, format="svg", dpi=dpi, metadata=dict(metadata))
    file.write(embed_fonts(text.getvalue()).encode())


def embed_fonts(svg: str) -> str:
    """The same SVG with a subset of each face that its texts use."""
    used: dict[bool, set[str]] = {}
    for attributes, content in _TEXT.findall(svg):
        bold = re.search(r"\b(bold|[6-9]00)\b", attributes) is not None
        used.setdefault(bold, set()).update(unescape(re.sub(r"<[^>]*>", "", content)))
    faces = "\n".join(_face(bold, letters) for bold, letters in sorted(used.items()) if letters)
    return _DEFS.sub(lambda found: f"{found.group()}\n{faces}\n", svg, count=1) if faces else svg


def _face(bold: bool, letters: set[str]) -> str:
    """An @font-face rule with the glyphs of these letters."""
    from fontTools import subset  # noqa: PLC0415  (comes with matplotlib)
    from matplotlib.font_manager import FontProperties, findfont  # noqa: PLC0415  (an extra)

    weight = "bold" if bold else "normal"
    # keep the font's own dates: the same picture gives the same file
    options = subset.Options(flavor="woff", layout_features=[], recalc_timestamp=False, notdef_outline=True)
    options.drop_tables += ["FFTM"]
    data = io.BytesIO()
    with subset.load_font(str(findfont(FontProperties(family=_FAMILY, weight=weight))), options) as font:
        subsetter = subset.Subsetter(options)
        subsetter.populate(unicodes=sorted({ord(letter) for letter in letters}))
        subsetter.subset(font)
        subset.save_font(font, data, options)
    content = base64.b64encode(data.getvalue()).decode()
    return (
        f"@font-face {{ font-family: '{_FAMILY}'; font-weight: {weight}; "
        f"src: url(data:font/woff;base64,{content}) format('woff'); }}"
    )
