"""``python -m docs.studies.gallery``: play three examples and draw the films of ``docs/gallery.md``.

It also draws the front picture, ``docs/images/demo.png``, from the cases of ``mesh-motion demo``.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

from mesh_motion_server.cases.demo import Outcome, play_demo
from mesh_motion_server.cases.play import play
from mesh_motion_server.watch.pictures.before_after import MeshPair
from mesh_motion_server.watch.pictures.mesh_axes import draw_mesh
from mesh_motion_server.watch.pictures.meshes import read_pair
from mesh_motion_server.watch.pictures.page import Page, styled
from mesh_motion_server.watch.pictures.snapshot import Plane, choose_window

__all__ = ["FILMS", "changed_case", "draw", "draw_front_picture"]

ROOT = Path(__file__).resolve().parents[2]
_PAGE = Page(points=12.0)
#: How long a frame is shown, and the last one of a film that does not come back.
_MILLISECONDS, _HELD = 120, 1200
_PLAIN = {'correction = "optimised"': 'correction = "none"\nallow_invalid = true'}
_PLAIN_FLAG = {'correction = "smooth"': 'correction = "none"\nallow_invalid = true'}
_ONE_WAY = {"count = 1": "count = 20", 'displacement = "relative"': 'displacement = "absolute"'}

#: Film → its example, how many steps are shown, whether they are shown backwards too, and what each panel changes.
FILMS: dict[str, tuple[str, int, bool, dict[str, dict[str, str]]]] = {
    "rotation": ("thesis_rotation", 20, False, {"plain interpolation": _ONE_WAY | _PLAIN, "corrected": _ONE_WAY}),
    "flag": ("turek_hron_flag", 32, False, {"plain interpolation": _PLAIN_FLAG, "corrected": {}}),
    "wing": ("tapered_wing", 10, True, {"corrected": {}}),
}


def draw(name: str, path: Path) -> None:
    """Play the film's example once for each panel and draw its steps."""
    example, steps, returns, panels = FILMS[name]
    with tempfile.TemporaryDirectory() as folder:
        played = {title: _played(example, Path(folder) / title, changes, steps) for title, changes in panels.items()}
        frames = list(_frames(played, steps))
    frames += frames[-2:0:-1] if returns else []
    shown = [_MILLISECONDS] * (len(frames) - 1) + [_MILLISECONDS if returns else _HELD]
    frames[0].save(path, save_all=True, append_images=frames[1:], duration=shown, loop=0, quality=40, method=4)


def _played(example: str, folder: Path, changes: dict[str, str], steps: int) -> Path:
    """Play an example with some words of its case file replaced; return the folder of results."""
    folder.mkdir(parents=True)
    source = ROOT / "examples" / example
    for file in source.glob("*.npz"):
        (folder / file.name).symlink_to(file)
    (folder / "case.toml").write_text(changed_case(example, changes, steps), encoding="utf-8")
    play(folder / "case.toml", folder / "out")
    return folder / "out"


def changed_case(example: str, changes: dict[str, str], steps: int) -> str:
    """The text of an example's case file with some words replaced; raises ValueError if it does not have them."""
    case = ROOT / "examples" / example / "case.toml"
    text = case.read_text(encoding="utf-8").replace("count = 64", f"count = {steps}")
    for old, new in changes.items():
        if old not in text:
            raise ValueError(f"{case} has no {old!r}")
        text = text.replace(old, new)
    return text


def _frames(played: dict[str, Path], steps: int) -> Iterator[Any]:
    """One picture for each step, or every second step of a long film; the largest motion decides the visible part."""
    series = {name: [read_pair(out, first=0, last=step) for step in range(steps + 1)] for name, out in played.items()}
    widest = max(next(iter(series.values())), key=_motion)
    plane = _across_chord(widest)
    window = choose_window(widest.before, widest.after, plane)
    width, height = window[1] - window[0]
    rows, columns = (len(series), 1) if width > 1.3 * height else (1, len(series))
    for step in range(0, steps + 1, 1 + steps // 30):
        figure = Figure(
            figsize=(4.6 * rows if rows > 1 else 4.6 * columns, 3.2 * rows + 1.0), dpi=80, layout="constrained"
        )
        for axes, (name, pairs) in zip(figure.subplots(rows, columns, squeeze=False).flat, series.items(), strict=True):
            _draw_step(axes, name, pairs[step], plane, window)
        canvas = FigureCanvasAgg(figure)
        canvas.draw()  # type: ignore[no-untyped-call]
        yield Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB")  # type: ignore[no-untyped-call]


def _motion(pair: MeshPair) -> float:
    return float(np.abs(pair.after.points - pair.before.points).max())


def _across_chord(pair: MeshPair) -> Plane | None:
    """In 3D the plane x = const through the middle of the body, which shows the bending."""
    return (
        Plane(0, float(pair.before.points[pair.after.moving, 0].mean())) if pair.before.points.shape[1] == 3 else None
    )


def _draw_step(axes: Any, name: str, now: MeshPair, plane: Plane | None, window: Any) -> None:
    """One mesh, or its cut, with its numbers."""
    mesh = now.after
    draw_mesh(axes, mesh, plane, "", window, _PAGE)
    axes.set_axis_off()
    lowest, inverted = float(mesh.quality.min()), int(mesh.inverted.sum())
    axes.set_title(f"{name}: lowest size-skew {lowest:.2f}, {inverted} inverted", fontsize=_PAGE.points)


def draw_front_picture(path: Path, outcomes: Sequence[Outcome]) -> None:
    """Two rows, standard and corrected; one column per case. The file's description has the corrected numbers too."""
    page = Page(width=127.0 * len(outcomes), points=12.0)
    with styled(page):
        figure = Figure(figsize=page.inches(270.0), dpi=100, layout="constrained")
        axes = figure.subplots(2, len(outcomes), squeeze=False)
        for column, outcome in enumerate(outcomes):
            for row, (label, played) in enumerate(
                (("standard RBF", outcome.standard), ("corrected", outcome.corrected))
            ):
                lowest, inverted = played.summary["min_size_skew"], played.summary["inverted_cells"]
                title = f"{label}: lowest size-skew {lowest:.3f}, {inverted} inverted"
                title = f"{outcome.title}\n{title}" if row == 0 else title
                window = choose_window(played.before, played.worst, None)
                colours = draw_mesh(axes[row, column], played.worst, None, title, window, page)
                axes[row, column].set(xticks=[], yticks=[], title=title)
        bar = figure.colorbar(colours, ax=axes.ravel().tolist(), shrink=0.7, pad=0.01, extend="min")
        bar.set_label("size-skew of a cell (inverted: pink)")
        reached = " ".join(f"{outcome.corrected.summary['min_size_skew']:.3f}" for outcome in outcomes)
        figure.savefig(path, metadata={"Software": None, "Description": reached})


if __name__ == "__main__":
    for film in FILMS:
        draw(film, ROOT / "docs" / "images" / f"{film}.webp")
    with tempfile.TemporaryDirectory() as demo:
        draw_front_picture(ROOT / "docs" / "images" / "demo.png", play_demo(Path(demo))[:3])
