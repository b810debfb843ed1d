"""Docs and comments are for engineers whose second language is English: simple words, and lines of a length to read."""

import re
import subprocess
from pathlib import Path

import pytest
from prose import prose

ROOT = Path(__file__).resolve().parents[1]
FORBIDDEN = re.compile(r"\b(?:tell|tells|told|hear|hears|nobody|whoever|beside|anew|unasked)\b", re.IGNORECASE)
#: Characters of a line of Markdown. Rows of tables, pictures and blocks of code cannot be broken.
LONGEST = 200
#: Pages with longer lines.
WIDE = ("docs/run.md",)


def tracked() -> list[str]:
    """The files of the checkout."""
    listed = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=False)
    if listed.returncode:
        pytest.skip("not in a git checkout")
    return [name for name in listed.stdout.splitlines() if (ROOT / name).is_file()]


def forbidden_in(path: Path) -> list[str]:
    if not FORBIDDEN.search(path.read_bytes().decode(errors="replace")):  # most files: not worth a parser
        return []
    return [f"{number}: {found[0]}" for number, line in prose(path) for found in FORBIDDEN.finditer(line)]


def long_in(path: Path) -> list[int]:
    long = [
        number for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1) if len(line) > LONGEST
    ]
    prosaic = {number for number, line in prose(path) if not line.lstrip().startswith(("|", "!["))}
    return [number for number in long if number in prosaic]


def test_docs_and_comments_use_simple_words() -> None:
    assert {name: found for name in tracked() if (found := forbidden_in(ROOT / name))} == {}


def test_lines_of_markdown_are_short_enough_to_read() -> None:
    pages = [name for name in tracked() if name.endswith(".md") and name not in WIDE]
    assert {name: found for name in pages if (found := long_in(ROOT / name))} == {}


@pytest.mark.parametrize(
    ("name", "text", "expected"),
    [
        ("a.md", "It tells.\n```\ntold\n```\n`told` [x](told.md)\n\nBeside it.", ["1: tells", "7: Beside"]),
        ("a.py", '"""Told."""\n\nx = "nobody"  # beside\n\n\ndef f():\n    """A.\n\n    Anew.\n    """\n',
         ["3: beside", "1: Told", "9: Anew"]),
        ("a.c", 'int told; /* It\n * hears. */\nchar *s = "// tell"; // unasked\n', ["2: hears", "3: unasked"]),
        ("a.f90", 'x = "told! " ! tells\n', ["1: tells"]),
        ("a.sh", "echo told '# tell' # whoever\n", ["1: whoever"]),
        ("a.txt", "told\n", []),
    ],
)  # fmt: skip
def test_prose_is_found_and_code_is_not(tmp_path: Path, name: str, text: str, expected: list[str]) -> None:
    (tmp_path / name).write_text(text)
    assert forbidden_in(tmp_path / name) == expected


def test_a_long_line_is_found(tmp_path: Path) -> None:
    page, words = tmp_path / "a.md", "word " * 50
    page.write_text(f"{words}\n| {words} |\n```\n{words}\n```\n")
    assert long_in(page) == [1]
