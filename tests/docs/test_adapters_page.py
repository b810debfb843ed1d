"""adapters/README.md: its adapter runs unchanged, its matrix names every adapter, its links exist."""

import re
from pathlib import Path

from loaded_scripts import loaded
from python_runs import said_by_python

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "adapters" / "README.md"
TEXT = PAGE.read_text(encoding="utf-8")


def test_the_adapter_in_five_steps_runs(tmp_path: Path) -> None:
    blocks = re.findall(r"```python\n(.*?)```", TEXT, re.DOTALL)
    assert len(blocks) == 6
    output = said_by_python("-c", "\n".join(blocks), cwd=tmp_path, timeout=120)
    lowest = [float(value) for value in re.findall(r"step \d: min size-skew (\S+)", output)]
    assert len(lowest) == 3
    assert lowest == sorted(lowest, reverse=True)
    assert lowest[-1] > 0.2
    assert list(tmp_path.iterdir()) == []


def test_the_matrix_names_every_adapter() -> None:
    folders = {path.parent.name for path in (ROOT / "adapters").glob("*/*")} - {"__pycache__"}
    named = set(re.findall(r"^\| \[[^\]]+\]\((\w+)/", TEXT, re.MULTILINE))
    assert folders - named == set()


def test_the_tests_of_make_adapters_exist() -> None:
    """Each entry's tests, so that a moved folder is noticed."""
    check = loaded(ROOT / "adapters" / "check.py")
    for name, (_, tests, _) in check.ADAPTERS.items():
        assert all((ROOT / path).exists() for path in tests), name
