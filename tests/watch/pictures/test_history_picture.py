"""Content of the history's figure, read from its artists."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mesh_motion_protocol.errors import InvalidInput

from mesh_motion_server.watch.pictures.runs import Run, read_played, read_runs

pytest.importorskip("matplotlib")

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_rgb

from mesh_motion_server.watch.pictures.history import draw_history, panels_of
from mesh_motion_server.watch.pictures.page import Page, styled
from mesh_motion_server.watch.pictures.palette import DARK

MakePlayed = Callable[..., Path]


def drawn(runs: list[Run], **options: Any) -> tuple[Any, dict[str, Any]]:
    page = options.pop("page", Page())
    with styled(page):
        figure = draw_history(runs, page, **options)
        figure.draw_without_rendering()
    return figure, {axes.get_ylabel().replace("\n", " "): axes for axes in figure.axes}


def known(run: Run, **columns: Any) -> Run:
    return replace(run, columns=run.columns | columns)


def line(axes: Any, label: str) -> Any:
    (found,) = [line for line in axes.get_lines() if line.get_label() == label]
    return found


def test_one_run_has_what_was_predicted_and_what_came(played: MakePlayed) -> None:
    run = read_played(played())
    _, panels = drawn([run])
    assert list(panels) == ["size-skew", "iterations", "server, ms", "enrichment points"]
    quality = panels["size-skew"]
    for label, values in (
        ("minimum", run.columns["actual_min"]),
        ("minimum, predicted", run.columns["predicted_min"]),
        ("without correction", run.columns["standard_min"]),
        ("mean", run.columns["actual_mean"]),
    ):
        np.testing.assert_array_equal(line(quality, label).get_xdata(), run.step)
        np.testing.assert_array_equal(line(quality, label).get_ydata(), values)
    assert set(line(quality, "threshold").get_ydata()) == {0.2}
    assert quality.get_legend() is not None


def test_the_prediction_shows_where_it_was_another(played: MakePlayed) -> None:
    run = read_played(played())
    wrong = known(run, predicted_min=run.columns["actual_min"] - 0.1)
    _, panels = drawn([wrong])
    below = line(panels["size-skew"], "minimum, predicted")
    np.testing.assert_allclose(below.get_ydata(), run.columns["actual_min"] - 0.1)
    assert below.get_linewidth() > line(panels["size-skew"], "minimum").get_linewidth()


def test_percentiles_are_bands(played: MakePlayed) -> None:
    run = read_played(played())
    low = run.columns["actual_min"]
    _, panels = drawn([known(run, actual_p1=low + 0.1, actual_p5=low + 0.2, actual_p50=low + 0.3)])
    labels = [text.get_text() for text in panels["size-skew"].get_legend().get_texts()]
    assert {"percentiles 1 to 5", "5 to 50"} <= set(labels)


def test_refusals_are_marked_at_their_steps(played: MakePlayed) -> None:
    run = replace(read_played(played()), refused=(4, 4))
    _, panels = drawn([run])
    assert list(line(panels["size-skew"], "refused").get_xdata()) == [4]


def test_several_runs_have_a_colour_and_a_dash_each(played: MakePlayed) -> None:
    runs = read_runs([played("standard"), played("corrected")])
    figure, panels = drawn(runs)
    lines = [line(panels["size-skew"], run.label) for run in runs]
    assert [each.get_label() for each in lines] == ["standard", "corrected"]
    assert lines[0].get_color() != lines[1].get_color()
    assert lines[0].get_linestyle() != lines[1].get_linestyle()
    assert figure.get_suptitle() == ""


def inked(axes: Any, colour: Any) -> int:
    """Pixels of a colour within a panel of the rendered picture."""
    axes.figure.set_dpi(300)
    canvas = FigureCanvasAgg(axes.figure)
    canvas.draw()
    box, image = axes.get_window_extent(), np.asarray(canvas.buffer_rgba())[::-1]
    part = image[int(box.y0) : int(box.y1), int(box.x0) : int(box.x1), :3].astype(int)
    return int((np.abs(part - [round(255 * c) for c in to_rgb(colour)]).sum(axis=2) < 60).sum())


def test_each_run_is_in_the_legend_whatever_its_name(played: MakePlayed) -> None:
    runs = read_runs([played("standard", 3), played("corrected", 3)])
    named = [replace(run, label=name) for run, name in zip(runs, ("_wing", "$\\frac{[/x]$"), strict=True)]
    _, panels = drawn(named)
    texts = [text.get_text() for text in panels["size-skew"].get_legend().get_texts()]
    assert texts[:2] == [" _wing", "$\\frac{[/x]$"]


def test_a_run_of_a_single_step_is_seen(played: MakePlayed) -> None:
    run = read_played(played("once", steps=1))
    _, panels = drawn([run])
    quality, seconds = panels["size-skew"], panels["server, ms"]
    for label in ("minimum", "mean", "without correction"):
        assert inked(quality, line(quality, label).get_color()) > 20, label
    *colour, opacity = seconds.collections[0].get_facecolor()[0]
    assert inked(seconds, [opacity * part + 1.0 - opacity for part in colour]) > 500
    assert [tick for tick in quality.get_xticks() if 0.5 <= tick <= 1.5] == [1.0]


def test_a_run_of_a_single_step_is_seen_next_to_a_long_one(played: MakePlayed) -> None:
    runs = read_runs([played("long", steps=30), played("once", steps=1)])
    _, panels = drawn(runs)
    colour = line(panels["size-skew"], "once").get_color()
    assert inked(panels["size-skew"], colour) > 5


def test_runs_of_one_name_are_kept_apart(played: MakePlayed, tmp_path: Path) -> None:
    first = played("flag")
    (tmp_path / "later").mkdir()
    second = tmp_path / "later" / "flag"
    first.rename(second)
    runs = read_runs([second, played("flag")])
    assert len({run.label for run in runs}) == 2


def test_a_tall_first_step_does_not_flatten_the_others(played: MakePlayed) -> None:
    _, panels = drawn([read_played(played())])
    seconds = panels["server, ms"]
    assert seconds.get_ylim()[1] < 20.0
    assert [text.get_text() for text in seconds.texts] == ["first step: 502 ms"]


def test_a_long_run_is_thinned_and_keeps_its_extremes(played: MakePlayed) -> None:
    short = read_played(played())
    count = 100_000
    low = np.full(count, 0.5)
    low[77_777] = -0.25
    unknown = np.full(count, np.nan)
    taken = np.full(count, 0.01)
    taken[33_333] = 9.0
    angle = np.full(count, 40.0)
    angle[55_555] = 81.0
    long = replace(short, columns=dict.fromkeys(short.columns, unknown))
    long = known(long, step=np.arange(1.0, count + 1), actual_min=low, predicted_min=low, standard_min=low)
    long = known(long, iterations=np.ones(count), enrichment_points=np.zeros(count), non_orthogonality=angle)
    long = known(long, **{f"seconds_{phase}": taken for phase in ("solve", "predict", "correct", "displace")})
    _, panels = drawn([long])
    minimum = line(panels["size-skew"], "minimum")
    assert len(minimum.get_xdata()) <= 5000
    assert minimum.get_ydata().min() == -0.25
    assert minimum.get_xdata()[np.argmin(minimum.get_ydata())] == 77_778
    (angles,) = panels["non- orthogonality, °"].get_lines()
    assert angles.get_ydata().max() == 81.0
    assert panels["server, s"].collections[0].get_paths()[0].vertices[:, 1].max() == 9.0


def test_the_least_orthogonal_face_has_a_panel_where_it_is_known(played: MakePlayed) -> None:
    run = read_played(played())
    assert "non-orthogonality" not in panels_of([run])  # a run of one dimension, or an older one
    angles = np.linspace(30.0, 70.0, len(run.step))
    newer = replace(known(run, non_orthogonality=angles), label="newer")
    _, panels = drawn([newer, run])
    (only,) = panels["non- orthogonality, °"].get_lines()
    np.testing.assert_array_equal(only.get_ydata(), angles)
    _, panels = drawn([newer], panels=["non-orthogonality"])
    assert list(panels) == ["non- orthogonality, °"]


def test_panels_are_chosen_by_name_and_empty_ones_are_left_out(played: MakePlayed) -> None:
    run = read_played(played())
    assert list(drawn([run], panels=["seconds"])[1]) == ["server, ms"]
    assert panels_of([known(run, iterations=np.ones(12), enrichment_points=np.zeros(12))]) == ["quality", "seconds"]


def test_steps_are_chosen(played: MakePlayed) -> None:
    whole = read_played(played())
    run = whole.between(3, 5)
    assert list(run.step) == [3, 4, 5]
    assert len(run.columns["actual_min"]) == len(run.columns["seconds_solve"]) == 3
    with pytest.raises(InvalidInput, match="flag has the steps 1 to 12, none from 20 to the last"):
        whole.between(20, None)


def test_another_metric_has_no_prediction_and_no_threshold(played: MakePlayed) -> None:
    run = read_played(played(), "skew")
    assert run.threshold is None
    np.testing.assert_allclose(run.columns["actual_min"][2], 0.15)
    _, panels = drawn([run])
    assert {each.get_label() for each in panels["skew"].get_lines()} == {"minimum"}


def test_a_run_is_drawn_in_its_own_metric(played: MakePlayed) -> None:
    folder = played()
    summary = json.loads((folder / "summary.json").read_text())
    summary["method"]["quality_metric"] = "skew"
    (folder / "summary.json").write_text(json.dumps(summary))
    assert (read_played(folder).metric, read_played(folder).threshold) == ("skew", 0.2)
    assert read_played(folder, "size-skew").threshold is None


def test_dark_paper_has_light_ink(played: MakePlayed) -> None:
    figure, panels = drawn([read_played(played())], page=Page(theme=DARK))
    assert figure.get_facecolor()[:3] < (0.2, 0.2, 0.2)
    assert line(panels["size-skew"], "minimum").get_color() == DARK.runs[0]


def test_a_run_without_a_step_is_said_to_have_none(played: MakePlayed) -> None:
    run = read_played(played())
    empty = replace(run, columns=dict.fromkeys(run.columns, np.array([])))
    with pytest.raises(InvalidInput, match="no step was committed yet: flag"):
        drawn([empty])


def test_a_damaged_table_is_named(played: MakePlayed) -> None:
    folder = played()
    (folder / "steps.csv").write_text("step,oops\n1,2\n")
    with pytest.raises(InvalidInput, match=r"steps\.csv: expected the steps that play writes, found no iterations"):
        read_played(folder)
    (folder / "steps.csv").write_text("step\none\n")
    with pytest.raises(InvalidInput, match=r"steps\.csv: not readable"):
        read_played(folder)
