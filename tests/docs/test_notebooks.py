"""The notebooks of docs/tutorials: each runs from its first cell to its last, and the site shows their output."""

import json
import shutil
from pathlib import Path

import pytest
from python_runs import said_by_python

from docs.site.notebooks import markdown_of

ROOT = Path(__file__).parents[2]
NOTEBOOKS = sorted((ROOT / "docs" / "tutorials").glob("*.ipynb"))


def test_there_are_two() -> None:
    assert [path.stem for path in NOTEBOOKS] == ["notebook_flag", "notebook_wing"]


@pytest.mark.nightly
@pytest.mark.parametrize("notebook", NOTEBOOKS, ids=lambda path: path.stem)
def test_it_runs(notebook: Path, tmp_path: Path) -> None:
    pytest.importorskip("nbclient", reason="the extra dev is not installed")
    (tmp_path / "docs" / "tutorials").mkdir(parents=True)
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    copy = shutil.copy(notebook, tmp_path / "docs" / "tutorials")
    said_by_python("-m", "jupyter", "execute", "--inplace", copy, timeout=280)
    kept, ran = (json.loads(Path(path).read_text(encoding="utf-8")) for path in (notebook, copy))
    kinds = [  # a line that is written again comes in as many pieces as it likes
        [{output["output_type"] for output in cell.get("outputs", [])} for cell in each["cells"]]
        for each in (kept, ran)
    ]
    assert kinds[0] == kinds[1], "jupyter execute --inplace writes what is shown"


@pytest.mark.parametrize("notebook", NOTEBOOKS, ids=lambda path: path.stem)
def test_the_site_shows_code_text_and_pictures(notebook: Path) -> None:
    shown = markdown_of(json.loads(notebook.read_text(encoding="utf-8")))
    assert shown.startswith("# ")
    assert "from mesh_motion_client import Mesh, Patch" in shown
    assert shown.count('src="data:image/png;base64,') == 1
    assert "<strong>Moved: step " in shown
    assert "\r" not in shown
