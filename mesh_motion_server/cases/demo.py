"""The demonstration: the thesis' three two-dimensional cases and a flag in a channel, standard against corrected.

*Standard* is plain interpolation with radial basis functions; *corrected* is the default, optimised correction. Both
run on a real server through its protocol, like the requests of any coupling code.
"""

import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from mesh_motion_client import connect
from rich.box import SIMPLE_HEAD

from mesh_motion_server.cases.play import Played, play
from mesh_motion_server.watch.pictures.before_after import MeshPair, draw_before_after
from mesh_motion_server.watch.pictures.page import Page, pictures_are_possible, save, styled
from mesh_motion_server.watch.terminal.console import Table

_DATA = Path(__file__).with_name("demo_data")
#: Title of each case of the demonstration; the case's folder has the files of the example with the same name.
CASES = {
    "thesis_dx": "block moved 0.3 to the left",
    "thesis_dxdy": "block moved 0.25 left and down",
    "thesis_rotation": "slab moved 0.2 left and down, turned by 60°",
    "turek_hron_flag": "Turek-Hron flag, tip ± 80 mm, two periods",
}
#: Settings of the standard method; its mesh is kept even if it is bad, so that users can look at it.
_STANDARD = {
    'correction = "optimised"': 'correction = "none"\nallow_invalid = true',
    'correction = "smooth"': 'correction = "none"\nallow_invalid = true',
}


@dataclass(frozen=True, eq=False)
class Outcome:
    """The results of one case, played with both methods."""

    title: str
    standard: Played
    corrected: Played


def play_demo(folder: Path, say: Callable[[str], None] = lambda _: None) -> list[Outcome]:
    """Play all cases both ways into a folder, and draw them.

    Parameters
    ----------
    folder : path
        Receives a folder for each case, with its case files, and a picture of each, ``NAME.png``: standard and
        corrected.
    say : callable, optional
        Receives progress messages.
    """
    outcomes = []
    with connect() as server:
        for name, title in CASES.items():
            played = {}
            for case in _written(folder / name, name):
                say(f"{title}: {case.stem}")
                results = folder / name / case.stem
                played[case.stem] = play(case, results, endpoint=server.endpoint, every=8)
            outcomes.append(Outcome(title, **played))
            if pictures_are_possible():
                _draw(folder / f"{name}.png", outcomes[-1])
    return outcomes


def _written(folder: Path, name: str) -> list[Path]:
    """Write the case's files to its folder, so that users can play it again; return both case files."""
    shutil.copytree(_DATA / name, folder, dirs_exist_ok=True)
    corrected, standard = (folder / "case.toml").replace(folder / "corrected.toml"), folder / "standard.toml"
    text = corrected.read_text(encoding="utf-8")
    for key, value in _STANDARD.items():
        text = text.replace(key, value)
    standard.write_text(text, encoding="utf-8")
    return [standard, corrected]


def _draw(path: Path, outcome: Outcome) -> None:
    """The worst meshes of both runs of a case, in one colour scale."""
    standard, corrected = outcome.standard.worst, outcome.corrected.worst
    titles = f"standard, step {standard.step}", f"corrected, step {corrected.step}"
    pair, page = MeshPair(outcome.title, "size-skew", standard, corrected, titles), Page(width=300.0, dpi=120)
    with styled(page):
        save(draw_before_after(pair, page), path, page)


def table_of(outcomes: list[Outcome]) -> Table:
    """The results as a table."""
    table = Table(title="lowest size-skew of any step, inverted cells, seconds", box=SIMPLE_HEAD)
    table.add_column("case")
    for heading in ("standard", "inv", "s", "corrected", "inv", "s"):
        table.add_column(heading, justify="right", no_wrap=True, min_width=len(heading) if len(heading) > 3 else 5)
    for outcome in outcomes:
        cells = [outcome.title]
        for played in (outcome.standard, outcome.corrected):
            summary = played.summary
            seconds = sum(step.seconds for step in played.steps)
            cells += [f"{summary['min_size_skew']:.3f}", str(summary["inverted_cells"]), f"{seconds:.2f}"]
        table.add_row(*cells)
    return table
