"""The demonstration: the thesis' three two-dimensional cases and a flag in a channel, standard against corrected.

*Standard* is plain interpolation with radial basis functions; *corrected* is the default, optimised correction. Both
run on a real server over the real wire, as the requests of any coupling code do.
"""

import shutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from mesh_motion_client import connect
from rich.box import SIMPLE_HEAD
from rich.table import Table

from mesh_motion_server.cases.play import Played, play
from mesh_motion_server.watch.pictures.before_after import MeshPair, draw_before_after
from mesh_motion_server.watch.pictures.page import Page, pictures_are_possible, save, styled

__all__ = ["DEMO_CASES", "DemoCase", "Outcome", "play_demo", "table_of"]

_DATA = Path(__file__).with_name("demo_data")
_CORRECTIONS = {"standard": "none", "corrected": "optimised"}

_TEXT = """# {title}
[mesh]
file = "mesh.npz"

[patches]
{patches}

[[motion]]
{motion}

[steps]
count = {steps}

[method]
support_radius = {radius}
displacement = "{displacement}"
quality_metric = "size-skew"
quality_threshold = {threshold}
allow_invalid = true   # keep what plain interpolation makes of it, to be looked at
correction = "{correction}"
"""


@dataclass(frozen=True)
class DemoCase:
    """One case of the demonstration; ``files`` are copied beside the case file under their new names."""

    name: str
    title: str
    roles: Mapping[str, str]
    motion: str
    files: Mapping[str, str]
    steps: int = 1
    radius: float = 0.5
    displacement: str = "relative"
    threshold: float = 0.2

    def text(self, correction: str) -> str:
        """The case file."""
        patches = "\n".join(f'{patch} = "{role}"' for patch, role in self.roles.items())
        return _TEXT.format(**{**self.__dict__, "patches": patches, "correction": correction})


def _thesis(name: str, body: str, how: str, rigid: str) -> DemoCase:
    """A case of the thesis: a body moves in a square."""
    motion = f'patch = "block"\nrigid = {{ {rigid} }}'
    roles, files = {"block": "moving", "outer": "fixed"}, {f"square_with_{body}.npz": "mesh.npz"}
    return DemoCase(name, f"{body} {how}", roles, motion, files)


DEMO_CASES = (
    _thesis("thesis_dx", "block", "moved 0.3 to the left", "translation = [-0.3, 0.0]"),
    _thesis("thesis_dxdy", "block", "moved 0.25 left and down", "translation = [-0.25, -0.25]"),
    _thesis(
        "thesis_rotation",
        "slab",
        "moved 0.2 left and down, turned by 60°",
        "translation = [-0.2, -0.2], rotation = 60.0, centre = [0.5, 0.5]",
    ),
    DemoCase(
        "turek_hron_flag",
        "Turek-Hron flag, tip ± 80 mm, one period",
        {"flag": "moving", "cylinder": "fixed", "walls": "fixed", "inlet": "fixed", "outlet": "fixed"},
        'patch = "flag"\ntable = "motion.npz"',
        {"flag.npz": "mesh.npz", "flag_motion.npz": "motion.npz"},
        steps=32,
        radius=0.4,
        displacement="absolute",
        threshold=0.5,
    ),
)


@dataclass(frozen=True, eq=False)
class Outcome:
    """One case played both ways."""

    case: DemoCase
    standard: Played
    corrected: Played


def play_demo(folder: Path, say: Callable[[str], None] = lambda _: None) -> list[Outcome]:
    """Play all cases both ways into a folder, and draw them.

    Parameters
    ----------
    folder : path
        Receives a folder for each case, with its case files, and a picture of each, ``NAME.png``: standard beside
        corrected.
    say : callable, optional
        Receives progress messages.
    """
    outcomes = []
    with connect() as server:
        for case in DEMO_CASES:
            played = {}
            for label, correction in _CORRECTIONS.items():
                say(f"{case.title}: {label}")
                case_file = _write_case(folder / case.name, case, label, correction)
                played[label] = play(case_file, folder / case.name / label, endpoint=server.endpoint, every=8)
            outcomes.append(Outcome(case, **played))
    if pictures_are_possible():
        say("drawing")
        for outcome in outcomes:
            _draw(folder / f"{outcome.case.name}.png", outcome)
    return outcomes


def _draw(path: Path, outcome: Outcome) -> None:
    """The worst meshes of both runs of a case, in one colour scale."""
    standard, corrected = outcome.standard.worst, outcome.corrected.worst
    titles = f"standard, step {standard.step}", f"corrected, step {corrected.step}"
    pair, page = MeshPair(outcome.case.title, "size-skew", standard, corrected, titles), Page(width=300.0, dpi=120)
    with styled(page):
        save(draw_before_after(pair, page), path, page)


def table_of(outcomes: list[Outcome]) -> Table:
    """The results as a table."""
    table = Table(title="lowest size-skew of any step, inverted cells, seconds", title_justify="left", box=SIMPLE_HEAD)
    table.add_column("case")
    for heading in ("standard", "inv", "s", "corrected", "inv", "s"):
        table.add_column(heading, justify="right", no_wrap=True, min_width=len(heading) if len(heading) > 3 else 5)
    for outcome in outcomes:
        cells = [outcome.case.title]
        for played in (outcome.standard, outcome.corrected):
            summary = played.summary
            seconds = sum(step.seconds for step in played.steps)
            cells += [f"{summary['min_size_skew']:.3f}", str(summary["inverted_cells"]), f"{seconds:.2f}"]
        table.add_row(*cells)
    return table


def _write_case(folder: Path, case: DemoCase, label: str, correction: str) -> Path:
    """Write the case's files to its folder, so that users can play it again; return the case file."""
    folder.mkdir(parents=True, exist_ok=True)
    for source, name in case.files.items():
        shutil.copyfile(_DATA / source, folder / name)
    path = folder / f"{label}.toml"
    path.write_text(case.text(correction), encoding="utf-8")
    return path
