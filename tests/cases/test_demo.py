"""The demonstration that is installed with the package, as docs/start.md shows it."""

import re
from pathlib import Path

import pytest
from PIL import Image

from docs.studies.gallery import draw_front_picture
from mesh_motion_server.cases.case import read_case
from mesh_motion_server.cases.demo import _DATA, CASES, Outcome, _written, play_demo, table_of
from mesh_motion_server.cases.motion_program import MotionProgram

ROOT = Path(__file__).parents[2]
#: The demonstration's motions as docs/beyond.md names them.
ROWS = ("dx −0.3", "dx, dy −0.25", "dx, dy −0.2, +60°")


def lowest_in(picture: Path) -> str:
    """The numbers that a picture shows, from its description."""
    with Image.open(picture) as image:
        return str(image.info["Description"])


@pytest.mark.parametrize("name", CASES)
def test_the_demo_shows_the_examples(name: str) -> None:
    """The installed demonstration has copies of the examples' files."""
    for file in (_DATA / name).iterdir():
        assert file.read_bytes() == (ROOT / "examples" / name / file.name).read_bytes()


@pytest.mark.parametrize("name", CASES)
def test_the_standard_case_differs_in_its_correction_alone(name: str, tmp_path: Path) -> None:
    standard, corrected = (read_case(path) for path in _written(tmp_path / name, name))
    assert (standard.name, corrected.name) == ("standard", "corrected")
    assert standard.content.method.correction == "none"
    contents = [case.content.model_dump(exclude={"method"}) for case in (standard, corrected)]
    assert contents[0] == contents[1]
    MotionProgram.of(standard, standard.read_mesh())


def test_the_front_picture_and_the_table_show_the_same_numbers() -> None:
    table = (ROOT / "docs" / "beyond.md").read_text(encoding="utf-8")
    reached = [re.findall(rf"^\| {re.escape(row)} \|(?: [^|]+ \|){{2}} ([^|]+) \|", table, re.M)[0] for row in ROWS]
    assert lowest_in(ROOT / "docs" / "images" / "demo.png").split() == reached


@pytest.mark.nightly
def test_the_demo_corrects_what_plain_interpolation_inverts(tmp_path: Path) -> None:
    outcomes: list[Outcome] = play_demo(tmp_path)
    assert {p.name for p in tmp_path.glob("*.png")} == {f"{name}.png" for name in CASES}
    draw_front_picture(tmp_path / "front.png", outcomes[:3])
    assert lowest_in(tmp_path / "front.png") == lowest_in(ROOT / "docs" / "images" / "demo.png")
    for outcome in outcomes[:3]:
        assert outcome.standard.summary["inverted_cells"] > 0
        assert outcome.corrected.summary["inverted_cells"] == 0
        assert outcome.corrected.summary["min_size_skew"] > 0.2
    flag = outcomes[3]
    assert flag.corrected.summary["min_size_skew"] > flag.standard.summary["min_size_skew"] + 0.05
    assert table_of(outcomes).row_count == 4
