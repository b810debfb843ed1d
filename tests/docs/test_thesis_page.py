"""docs/thesis.md agrees with the repository: names resolve, no equation and no study is missing.

Each check returns the faults of a text, so that it can also be tested on a text with a seeded error.
"""

import re
from collections.abc import Callable, Iterator
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from docs.studies.catalogue import PAGES, names
from docs.studies.page import DOCS

PAGE = (DOCS / "thesis.md").read_text(encoding="utf-8")
ROOT = DOCS.resolve().parent

#: The last number of each chapter of the thesis.
EQUATIONS = [f"{c}.{n}" for c, last in {2: 15, 3: 30, 4: 11, 5: 17, 6: 1}.items() for n in range(1, last + 1)]
FIGURES = {1: 3, 2: 10, 3: 15, 4: 20, 5: 18}
TABLES = {1: 1, 2: 4, 4: 1, 5: 7}

_LINK = re.compile(r"\[(?P<label>[^\[\]]+)\]\((?P<target>[^()\s]+)\)")
_DOTTED = re.compile(r"`((?:numerics|docs|mesh_motion_server|mesh_motion_numerics)(?:\.\w+)+)`")


def resolved(dotted: str) -> tuple[ModuleType, Any]:
    """The module and the object of a dotted name; "numerics" is short for its package.

    Raises AttributeError if the module has no such object.
    """
    parts = (f"mesh_motion_{dotted}" if dotted.startswith("numerics.") else dotted).split(".")
    module, rest = import_module(parts[0]), parts[1:]
    while rest:
        try:
            module = import_module(f"{module.__name__}.{rest[0]}")
        except ModuleNotFoundError:
            break
        rest = rest[1:]
    found: Any = module
    for part in rest:
        found = getattr(found, part)
    return module, found


def file_of(dotted: str) -> Path:
    """File of a dotted name in this repository, for any place of the imported package."""
    parts = resolved(dotted)[0].__name__.split(".")
    place = (ROOT / "numerics" if parts[0] == "mesh_motion_numerics" else ROOT).joinpath(*parts)
    return place / "__init__.py" if place.is_dir() else place.with_suffix(".py")


def section(text: str, heading: str) -> str:
    return text.split(f"\n## {heading}\n")[1].split("\n## ", maxsplit=1)[0]


def rows(text: str) -> Iterator[list[str]]:
    for line in text.splitlines():
        if line.startswith("| ") and not line.startswith("| ---"):
            yield [cell.strip() for cell in line.strip("| ").split(" | ")]


def expanded(cell: str) -> set[str]:
    """The numbers of "2.4–2.8", "(3.10)–(3.12)", "4.1, 4.2", "A.1"."""
    plain = cell.replace("(", "").replace(")", "")
    out = set(re.findall(r"\b[A1-6]\.\d+", plain))
    for chapter, first, last in re.findall(r"(\d)\.(\d+)–\1\.(\d+)", plain):
        out |= {f"{chapter}.{n}" for n in range(int(first), int(last) + 1)}
    return out


def unresolved_names(text: str) -> list[str]:
    wrong = []
    for dotted in sorted(set(_DOTTED.findall(text))):
        try:
            resolved(dotted)
        except AttributeError:
            wrong.append(dotted)
    return wrong


def misplaced_names(text: str) -> list[str]:
    """Names with a link to another file than their own."""
    linked = [(m["label"].strip("`"), m["target"]) for m in _LINK.finditer(text) if _DOTTED.fullmatch(m["label"])]
    return [name for name, target in linked if (DOCS / target).resolve() != file_of(name)]


def missing_files(text: str) -> list[str]:
    """Files named in code spans, from the root, the package or the page's folder."""
    named = set(re.findall(r"`([\w./-]+\.(?:py|md|npz|toml|json))`", text))
    return sorted(f for f in named if not any((d / f).exists() for d in (ROOT, ROOT / "mesh_motion_server", DOCS)))


def unknown_tests(text: str) -> list[str]:
    linked = [(m["label"], DOCS / m["target"]) for m in _LINK.finditer(text) if m["label"].startswith("test_")]
    return [name for name, file in linked if f"\ndef {name}(" not in file.read_text(encoding="utf-8")]


def missing_equations(text: str) -> list[str]:
    """Equations that are not in the index exactly once, with a function and a study."""
    index = section(text, "Where each equation is")
    listed = [row[0].strip("()") for row in rows(index) if len(row) == 4 and "`" in row[2] and "](" in row[3]]
    return [number for number in EQUATIONS if listed.count(number) != 1]


def unnumbered_docstrings(text: str) -> list[str]:
    """Equations whose number, as "(3.9)" or in a range like that, is in no file of their functions."""
    wrong = []
    for number, _, functions, *_ in rows(section(text, "Where each equation is")):
        if not re.fullmatch(r"\(\d\.\d+\)", number):
            continue
        files = {file_of(name) for name in _DOTTED.findall(functions)}
        source = " ".join(file.read_text(encoding="utf-8") for file in files)
        said = set().union(*map(expanded, re.findall(r"\(\d\.\d+\)(?:–\(\d\.\d+\))?", source)))
        if number.strip("()") not in said:
            wrong.append(number)
    return wrong


def missing_figures(text: str) -> list[str]:
    """Figures, tables and algorithms that are missing in the index."""
    index = section(text, "Where each equation is")
    words = " ".join(row[0] for row in rows(index)) + index.rstrip().splitlines()[-1]
    listed = {
        kind: set().union(*map(expanded, re.findall(rf"{kind}s? ((?:[A1-6]\.\d+(?:–|, | and )?)+)", words)))
        for kind in ("Fig", "Table")
    }
    figures = [f"{c}.{n}" for c, last in FIGURES.items() for n in range(1, last + 1)] + ["A.1", "A.2"]
    tables = [f"{c}.{n}" for c, last in TABLES.items() for n in range(1, last + 1)]
    wrong = [f"Fig {n}" for n in figures if n not in listed["Fig"]]
    wrong += [f"Table {n}" for n in tables if n not in listed["Table"]]
    return wrong + ([] if "Algorithm 1" in words else ["Algorithm 1"])


def missing_studies(text: str) -> list[str]:
    """Studies of the thesis without a block, or without a row that links to them by their name or the heading above
    them.
    """
    listed = section(text, "The eight rows") + section(text, "Where each equation is")
    ways = {name: (f"[{name}](", f"](#{heading_of(name, text)})") for name in names("thesis")}
    return [
        name for name in ways if f"<!-- study: {name} -->" not in text or not any(way in listed for way in ways[name])
    ]


def misplaced_studies(text: str) -> list[str]:
    """Studies with a link that leads neither to their module nor to their heading."""
    linked = [(m["label"], m["target"]) for m in _LINK.finditer(text)]
    known = [(name, page) for page in PAGES for name in names(page)]
    return [
        name
        for name, page in known
        for label, target in linked
        if label == name and target not in {f"studies/{page}/{name}.py", f"#{heading_of(name, text)}"}
    ]


def heading_of(study: str, text: str) -> str:
    headings = re.findall(r"^#+ (.+)$", text.partition(f"<!-- study: {study} -->")[0], re.MULTILINE)
    return re.sub(r"[^\w\- ]", "", headings[-1].lower()).replace(" ", "-")


def incomplete_rows(text: str) -> list[str]:
    """Entries of the eight rows and the errors without a function, a study or a test."""
    eight = list(rows(section(text, "The eight rows")))[1:]
    wrong = [row[0] for row in eight if len(row) != 5 or not ("`" in row[2] and "](" in row[3] and "test_" in row[4])]
    wrong += [] if [row[0] for row in eight] == list("12345678") else ["the rows' numbers"]
    errors = [row for row in rows(section(text, "Errors of the print")) if row[0] != "where"]
    return wrong + [row[0] for row in errors if len(row) != 4 or "](" not in row[3]]


CHECKS: tuple[Callable[[str], list[str]], ...] = (
    unresolved_names,
    misplaced_names,
    missing_files,
    unknown_tests,
    missing_equations,
    unnumbered_docstrings,
    missing_figures,
    missing_studies,
    misplaced_studies,
    incomplete_rows,
)


@pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.__name__)
def test_the_page_is_true(check: Callable[[str], list[str]]) -> None:
    assert check(PAGE) == []


@pytest.mark.parametrize(
    ("check", "right", "wrong"),
    [
        (unresolved_names, "`numerics.decomposition.svd`", "`numerics.decomposition.sdv`"),
        (misplaced_names, "/mesh_motion_numerics/decomposition.py", "/mesh_motion_numerics/metrics.py"),
        (missing_files, "`numerics/mesh_motion_numerics/interpolation/kernels.py`", "`numerics/kernel.py`"),
        (unknown_tests, "[test_known_skews]", "[test_unknown_skews]"),
        (missing_equations, "| (3.16) |", "| (3.61) |"),
        (unnumbered_docstrings, "| (2.9) |", "| (3.9) |"),
        (missing_figures, "Figs 4.14–4.19", "Figs 4.14–4.18"),
        (missing_figures, "Table 5.6, Fig 5.13", "Fig 5.13"),
        (missing_studies, "[volume_reduction](", "[volume]("),
        (missing_studies, "<!-- study: fig_2_7_error_peaks -->", ""),
        (misplaced_studies, "[fig_3_8_triangles](#triangles)", "[fig_3_8_triangles](#quadrilaterals)"),
        (incomplete_rows, "| 4 | Volume", "| 5 | Volume"),
    ],
)
def test_a_seeded_error_is_found(check: Callable[[str], list[str]], right: str, wrong: str) -> None:
    assert right in PAGE
    assert check(PAGE.replace(right, wrong)) != []
