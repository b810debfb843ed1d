"""Sizes and formats, and text that looks the same everywhere."""

from pathlib import Path
from typing import Any
from xml.etree import ElementTree as Xml

import pytest
from mesh_motion_protocol.errors import InvalidInput, ResourceExhausted

pytest.importorskip("matplotlib")

from mesh_motion_server.watch.pictures.page import Page, blank, parse_size, save, styled

SVG = "{http://www.w3.org/2000/svg}"


def picture(page: Page | None = None, title: str = "Wärme ≤ $5 <b>") -> Any:
    figure = blank(page or Page(), 60.0)
    figure.add_subplot().plot([1, 2], [3, 4])
    figure.suptitle(title)
    return figure


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("column", (90.0, None, 8.0)),
        ("slide", (254.0, 143.0, 12.0)),
        ("120", (120.0, None, 8.0)),
        ("120x80", (120.0, 80.0, 8.0)),
        ("85.5×60 mm", (85.5, 60.0, 8.0)),
    ],
)
def test_sizes(text: str, expected: tuple[float, float | None, float]) -> None:
    assert parse_size(text) == expected


@pytest.mark.parametrize("text", ["", "big", "10x10", "120x", "9999", "-5", "120x80x60"])
def test_a_wrong_size_is_refused_with_the_choices(text: str) -> None:
    with pytest.raises(InvalidInput, match="expected column, wide, page, slide, or WIDTH"):
        parse_size(text)


@pytest.mark.parametrize("suffix", ["png", "svg", "pdf"])
def test_the_file_is_the_same_when_it_is_made_again(suffix: str, tmp_path: Path) -> None:
    page = Page(90.0)
    for name in ("a", "b"):
        with styled(page):
            save(picture(), tmp_path / f"{name}.{suffix}", page)
    assert (tmp_path / f"a.{suffix}").read_bytes() == (tmp_path / f"b.{suffix}").read_bytes()
    assert sorted(path.name for path in tmp_path.iterdir()) == [f"a.{suffix}", f"b.{suffix}"]


def test_svg_has_its_size_and_needs_no_font(tmp_path: Path) -> None:
    page = Page(90.0, 60.0)
    with styled(page):
        save(picture(page), tmp_path / "a.svg", page)
    root = Xml.parse(tmp_path / "a.svg").getroot()
    assert float(root.attrib["width"].removesuffix("pt")) == pytest.approx(90 / 25.4 * 72, abs=0.01)
    assert float(root.attrib["height"].removesuffix("pt")) == pytest.approx(60 / 25.4 * 72, abs=0.01)
    assert list(root.iter(f"{SVG}text")) == []
    assert "<!-- Wärme ≤ $5 &lt;b&gt; -->" in (tmp_path / "a.svg").read_text(encoding="utf-8")  # what the outlines say


def test_pdf_has_its_fonts_as_truetype(tmp_path: Path) -> None:
    page = Page(90.0)
    with styled(page):
        save(picture(), tmp_path / "a.pdf", page)
    content = (tmp_path / "a.pdf").read_bytes()
    assert b"/FontFile2" in content
    assert b"/Type3" not in content


def test_another_suffix_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InvalidInput, match=r"expected a file ending in \.png, \.svg, \.pdf, got 'a\.jpg'"):
        save(picture(), tmp_path / "a.jpg", Page())


def test_a_place_that_cannot_be_written_is_reported(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(ResourceExhausted, match="the picture cannot be written"):
        save(picture(), tmp_path / "file" / "a.png", Page())


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("suffix", ["png", "svg", "pdf"])
@pytest.mark.parametrize("name", ["e\x1b[31m", "r\u202ea", "nul\0", "$\\frac", "流体"])
def test_a_name_is_never_more_than_text(name: str, suffix: str, tmp_path: Path) -> None:
    file = tmp_path / f"a.{suffix}"
    with styled(Page()):
        figure = picture(title=f"first\n{name}")
        figure.axes[0].set_xlabel(name)
        save(figure, file, Page())
    if suffix == "svg":
        Xml.parse(file)  # refuses control characters
        assert "\u202e" not in file.read_text(encoding="utf-8")
