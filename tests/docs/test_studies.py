"""Every study runs and confirms its page; every page shows every study."""

import re
from importlib import import_module
from pathlib import Path

import pytest

from docs.studies.catalogue import PAGES, names
from docs.studies.catalogue import study as study_named
from docs.studies.page import DOCS, fill, marked, render
from docs.studies.study import Table

ALL = [(page, name) for page in PAGES for name in names(page)]


#: Those that take a second of processor time and more.
LONG = {
    *("ceiling_2d", "ceiling_3d", "boundary_layers", "slip_and_periodic", "smooth_in_time", "ten_periods"),
    "valid_wherever",
    *("fig_2_3_displacement_drift", "fig_4_11_boundary_nodes", "fig_4_14_worst_quality", "table_2_3_reduction_cost"),
    *("section_2_2_reductions_compared", "section_3_4_three_dimensions", "question_4_reduction_with_enrichment"),
    *("table_5_3_parametric_study", "table_5_5_explicit_iterations"),
    *("any_boundary", "table_2_1_basis_functions", "explicit_decompositions", "fast_enrichment", "default_radii"),
    *("enrichment_freed_nodes_substeps", "volume_reduction"),
}


def test_the_long_studies_are_there() -> None:
    assert {name for _, name in ALL} >= LONG


@pytest.mark.parametrize(
    ("page", "name"), [pytest.param(*row, marks=[pytest.mark.nightly] * (row[1] in LONG)) for row in ALL]
)
def test_a_study_shows_what_is_claimed(page: str, name: str, tmp_path: Path) -> None:
    found = study_named(page, name)
    outcome = found.run(True)
    assert outcome.tables or outcome.pictures
    found.claims(outcome)
    assert render(name, found, outcome, tmp_path).startswith("*")


@pytest.mark.parametrize(("page", "name"), ALL)
def test_a_study_names_functions_that_exist(page: str, name: str) -> None:
    for dotted in study_named(page, name).functions:
        module, _, attribute = dotted.rpartition(".")
        assert hasattr(import_module(module), attribute), dotted


@pytest.mark.parametrize("page", PAGES)
def test_a_page_shows_its_studies_once_each(page: str) -> None:
    assert sorted(marked(page)) == names(page)


@pytest.mark.parametrize("page", PAGES)
def test_a_page_is_filled_and_its_pictures_are_there(page: str) -> None:
    text = (DOCS / f"{page}.md").read_text(encoding="utf-8")
    assert not re.search(r"-->\n<!-- end -->", text), "run make studies"
    for picture in re.findall(r"\]\((studies/pictures/[^)]+)\)", text):
        assert (DOCS / picture).is_file(), picture


def test_a_table_is_markdown_with_significant_digits() -> None:
    table = Table(("a", "b"), [("x", -0.33594), (3, None)], caption="C")
    assert table.markdown() == "C\n\n| a | b |\n| --- | --- |\n| x | −0.3359 |\n| 3 | – |"
    assert table.column("a") == ["x", 3]


def test_a_study_without_a_marker_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("docs.studies.page.DOCS", tmp_path)
    (tmp_path / "thesis.md").write_text("before\n<!-- study: one -->\nold\n<!-- end -->\nafter\n")
    fill("thesis", "one", "new\n")
    assert (tmp_path / "thesis.md").read_text() == "before\n<!-- study: one -->\nnew\n<!-- end -->\nafter\n"
    with pytest.raises(ValueError, match="<!-- study: two -->"):
        fill("thesis", "two", "new\n")
