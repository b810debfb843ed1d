"""Words are for engineers whose second language is English: simple ones in docs, code and messages, and short lines."""

import re
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
#: In names too. ``file.tell()`` is Python's.
FORBIDDEN = re.compile(
    r"(?<![a-z.])(?:tell|tells|told|hear|hears|heard|nobody|whoever|beside|anew|unasked)(?![a-z])", re.IGNORECASE
)
#: Characters of a line of Markdown. Rows of tables, pictures and blocks of code cannot be broken.
LONGEST = 200


def tracked() -> list[str]:
    listed = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=False)
    if listed.returncode:
        pytest.skip("not in a git checkout")
    return [name for name in listed.stdout.splitlines() if (ROOT / name).is_file()]


def forbidden_in(path: Path) -> list[str]:
    data = path.read_bytes()
    if b"\0" in data:  # a picture, a mesh
        return []
    lines = enumerate(data.decode(errors="replace").splitlines(), 1)
    return [f"{number}: {found[0]}" for number, line in lines for found in FORBIDDEN.finditer(line)]


def long_in(path: Path) -> list[int]:
    found, is_code = [], False
    for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1):
        is_code ^= line.lstrip().startswith("```")
        if len(line) > LONGEST and not is_code and not line.lstrip().startswith(("|", "![")):
            found.append(number)
    return found


def test_docs_and_code_use_simple_words() -> None:
    names = [name for name in tracked() if name != "tests/test_words.py"]
    assert {name: found for name in names if (found := forbidden_in(ROOT / name))} == {}


def test_lines_of_markdown_are_short_enough_to_read() -> None:
    pages = [name for name in tracked() if name.endswith(".md")]
    assert {name: found for name in pages if (found := long_in(ROOT / name))} == {}


def test_a_forbidden_word_is_found_wherever_it_stands(tmp_path: Path) -> None:
    text = "It tells.\n\nx = 'nobody-here'  # Beside\ndef is_told(): ...\nfile.tell(); besides, retell, hearing\n"
    (tmp_path / "a.py").write_text(text)
    assert forbidden_in(tmp_path / "a.py") == ["1: tells", "3: nobody", "3: Beside", "4: told"]


def test_a_long_line_is_found(tmp_path: Path) -> None:
    page, words = tmp_path / "a.md", "word " * 50
    page.write_text(f"{words}\n| {words} |\n```\n{words}\n```\n")
    assert long_in(page) == [1]
