"""Words, numbers and lines of a terminal."""

from __future__ import annotations

import numpy as np
import pytest

from mesh_motion_server.watch.terminal.chart import Curve, draw_chart, spark
from mesh_motion_server.watch.terminal.text import age, clip, number, plain


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("flap", "flap"),
        ("a\x1b[2Jb\x07", "a�[2Jb�"),
        ("a\nb\tc\r", "a b c "),
        ("left\u202etfel", "left�tfel"),
        ("\x9b31m\u2028\ud800\u200b", "�31m���"),
        ("e\u0301" + "\u0301" * 40, "e\u0301\u0301"),
        ("Flügel 翼", "Flügel 翼"),
    ],
)
def test_a_terminal_is_given_nothing_that_it_obeys(text: str, expected: str) -> None:
    assert plain(text) == expected


def test_every_character_there_is() -> None:
    shown = plain("".join(map(chr, range(0x110000))))
    assert all(letter.isprintable() for letter in shown)


def test_clipping_counts_columns() -> None:
    assert clip("翼翼翼", 6) == "翼翼翼"
    assert clip("翼翼翼翼", 6) == "翼翼…"
    assert (clip("abc", 0), clip("abc", 1), clip("abc", 3)) == ("", "…", "abc")


def test_numbers_and_ages() -> None:
    assert (number(None), number(float("nan")), number(0.12345)) == ("–", "–", "0.123")
    assert [age(s) for s in (-3, 59.9, 61, 3600, 86400 * 61)] == ["0 s", "59 s", "1 min 1 s", "1 h", "61 d"]
    assert [age(s, short=True) for s in (59.9, 61, 405, 5000)] == ["59 s", "1 min", "6 min", "1 h"]


def dots_of(rows: list[str]) -> list[list[bool]]:
    """What the Braille patterns of rows of text have, row of dots by row of dots."""
    bits = ((0x01, 0x08), (0x02, 0x10), (0x04, 0x20), (0x40, 0x80))
    values = [[ord(letter) - 0x2800 if 0x2800 <= ord(letter) <= 0x28FF else 0 for letter in row] for row in rows]
    return [[bool(v & bits[k][j]) for v in row for j in (0, 1)] for row in values for k in range(4)]


def chart(values: list[float], size: tuple[int, int] = (28, 7), **options: object) -> list[str]:
    steps = np.arange(1.0, len(values) + 1)
    return [row.plain for row in draw_chart(steps, [Curve(np.array(values), "")], size, **options)]  # type: ignore[arg-type]


def test_the_chart_fits_and_shows_one_low_step_of_many() -> None:
    values = [0.8] * 10_000
    values[6789] = -0.4
    rows = chart(values)
    assert len(rows) == 7
    assert all(len(row) <= 28 for row in rows)
    dots = dots_of([row[8:] for row in rows[:-1]])
    lowest = [column for column, dot in enumerate(dots[-2]) if dot] or [c for c, dot in enumerate(dots[-1]) if dot]
    assert lowest == [int(40 * 6789 / 9999)]
    assert rows[-1].strip(" └") == "1──────────────10000"


def test_a_line_has_no_holes() -> None:
    dots = np.array(dots_of([row[8:] for row in chart([0.1, 0.9, 0.2, 0.5])[:-1]]))
    assert dots.any(axis=0).all()
    for before, after in zip(dots.T[:-1], dots.T[1:], strict=True):
        a, b = np.flatnonzero(before), np.flatnonzero(after)
        assert a.min() <= b.max() + 1
        assert b.min() <= a.max() + 1


def test_axis_level_and_marks() -> None:
    rows = chart([0.2, 0.9, 0.5], level=0.4, marks=np.array([2.0]))
    assert rows[0].strip().startswith("0.93 ┤")
    assert any("╌" in row for row in rows)
    assert rows[-1].count("▲") == 1
    assert rows[-1].index("▲") == pytest.approx(8 + 10, abs=1)


@pytest.mark.parametrize("values", [[0.5], [float("nan")] * 3, [0.5, float("nan"), 0.7], [0.3] * 5])
def test_what_is_hardly_anything_is_charted_too(values: list[float]) -> None:
    assert len(chart(values)) == 7


def test_no_room_no_chart() -> None:
    assert chart([0.5, 0.6], size=(12, 7)) == []
    assert chart([0.5, 0.6], size=(40, 2)) == []
    assert chart([]) == []


def test_sparks() -> None:
    assert spark(np.array([0.0, 1.0, 2.0, 4.0]), 4) == "▁▃▅█"
    assert spark(np.array([1.0] * 99 + [8.0]), 10) == "▂▂▂▂▂▂▂▂▂█"
    assert spark(np.zeros(3), 5) == "▁▁▁"
    assert (spark(np.array([]), 5), spark(np.ones(4), 0)) == ("", "")
