"""The live view: what it shows, keys, sizes, and what comes and goes. Textual's pilot presses the keys."""

from __future__ import annotations

import asyncio
import shutil
import time
from collections.abc import Awaitable, Callable
from dataclasses import replace
from pathlib import Path

import pytest
from histories import go_on

pytest.importorskip("textual")

from textual.pilot import Pilot
from textual.widgets import Static

from mesh_motion_server.watch.terminal.app import MonitorApp
from mesh_motion_server.watch.terminal.folder_source import FolderSource
from mesh_motion_server.watch.terminal.snapshot import named
from mesh_motion_server.watch.terminal.watcher import Look

MakeSession = Callable[..., Path]
Steps = Callable[[Pilot[None], MonitorApp], Awaitable[None]]

#: A loaded machine takes its time.
_PATIENCE = 60.0


def text_of(app: MonitorApp, name: str) -> str:
    """What a piece of the screen says."""
    return str(app.query_one(f"#{name}", Static).content)


async def until(app: MonitorApp, name: str, wanted: str) -> str:
    """Wait until a piece says something."""
    end = time.monotonic() + _PATIENCE
    while wanted not in text_of(app, name) and time.monotonic() < end:
        await asyncio.sleep(0.02)
    assert wanted in text_of(app, name)
    return text_of(app, name)


def watch(folder: Path, steps: Steps, size: tuple[int, int] = (80, 24), session: str | None = None) -> MonitorApp:
    """Run the view on a folder, and the steps within it."""
    app = MonitorApp(FolderSource(folder), session, every=0.1)

    async def run() -> None:
        async with app.run_test(size=size) as pilot:
            await steps(pilot, app)

    asyncio.run(run())
    return app


def test_it_shows_the_essentials_and_follows(make_session: MakeSession, tmp_path: Path) -> None:
    folder = make_session("flap \x1b[2J", steps=200)

    async def steps(pilot: Pilot[None], app: MonitorApp) -> None:
        text = await until(app, "details", "lowest 0.207 in step")
        assert "flap �[2J" in text
        assert "\x1b" not in text
        for wanted in ("size-skew  minimum", "step 200", "mean", "▲", "iterations ", "solve 2", "worst"):
            assert wanted in text, wanted
        assert "refused MOVE: no valid mesh found" in text
        assert len(text.splitlines()) <= 24 - 2 - 2
        assert all(len(line) <= 80 for line in text.splitlines())
        go_on(folder, 200, 3)
        await until(app, "details", "step 203")
        await until(app, "list", " 203 ")

    watch(tmp_path / "state", steps)


def test_a_look_that_comes_while_the_widgets_go_is_passed_over(make_session: MakeSession, tmp_path: Path) -> None:
    make_session("a", steps=5)

    async def steps(pilot: Pilot[None], app: MonitorApp) -> None:
        look = app._look
        await app.screen.remove_children()
        app._take(look)

    watch(tmp_path / "state", steps)


def test_keys_choose_zoom_window_help_and_quit(make_session: MakeSession, tmp_path: Path) -> None:
    make_session("a", steps=150)
    make_session("b", steps=7)
    make_session("c", steps=8)

    async def steps(pilot: Pilot[None], app: MonitorApp) -> None:
        await until(app, "details", "──150")
        await pilot.press("j")
        await until(app, "details", "step 7")
        await pilot.press("down", "down", "j")
        await until(app, "details", "step 8")
        await pilot.press("k", "up")
        await until(app, "details", "└1")
        await pilot.press("w", "w")
        await until(app, "details", "└51")
        await pilot.press("w")
        await until(app, "details", "└1─")
        rows = len(text_of(app, "details").splitlines())
        await pilot.press("enter")
        await pilot.pause()
        assert len(text_of(app, "details").splitlines()) > rows
        await pilot.press("question_mark")
        await until(app, "details", "a process holds the session")
        await pilot.press("escape")
        await until(app, "details", "step 150")
        await pilot.press("q")

    app = watch(tmp_path / "state", steps)
    assert app.return_code == 0


def test_a_session_is_chosen_by_label(make_session: MakeSession, tmp_path: Path) -> None:
    make_session("a", steps=5)
    make_session("b", steps=6)

    async def steps(pilot: Pilot[None], app: MonitorApp) -> None:
        await until(app, "details", "step 6")

    watch(tmp_path / "state", steps, session="b")


def test_a_session_that_is_not_there_yet_is_waited_for(make_session: MakeSession, tmp_path: Path) -> None:
    make_session("a", steps=5)

    async def steps(pilot: Pilot[None], app: MonitorApp) -> None:
        await until(app, "details", "step 5")
        await until(app, "head", "no session 'b' so far")
        make_session("b", steps=6)
        await until(app, "details", "step 6")
        assert "so far" not in text_of(app, "head")

    watch(tmp_path / "state", steps, session="b")


def test_a_label_counts_before_the_beginning_of_an_id(make_session: MakeSession, tmp_path: Path) -> None:
    make_session("one", steps=1)
    lines = FolderSource(tmp_path / "state").sessions()
    beginning = lines[0].session[:4]
    make_session(beginning, steps=2)
    lines = FolderSource(tmp_path / "state").sessions()
    assert [lines[named(lines, wanted)].step for wanted in (beginning, "one")] == [2, 1]  # type: ignore[index]
    assert (named(lines, "none"), named(lines, "")) == (None, None)


@pytest.mark.parametrize("size", [(20, 6), (40, 12), (80, 24), (200, 50)])
def test_every_size_is_filled_and_not_overfilled(
    make_session: MakeSession, tmp_path: Path, size: tuple[int, int]
) -> None:
    make_session("a label that is longer than any narrow terminal is wide", steps=150)

    async def steps(pilot: Pilot[None], app: MonitorApp) -> None:
        await until(app, "details", "150" if size[0] > 70 else "a label")
        widget = app.query_one("#details", Static)
        for line in text_of(app, "details").splitlines():
            assert len(line) <= size[0]
        assert widget.region.bottom <= size[1]
        assert app.screen.has_class("wide") == (size[0] >= 140)

    watch(tmp_path / "state", steps, size)


def test_the_size_changes(make_session: MakeSession, tmp_path: Path) -> None:
    make_session("a", steps=150)

    async def steps(pilot: Pilot[None], app: MonitorApp) -> None:
        await until(app, "details", "──150")
        await pilot.resize_terminal(170, 45)
        await pilot.pause()
        await pilot.pause()
        assert app.screen.has_class("wide")
        assert max(map(len, text_of(app, "details").splitlines())) > 90
        await pilot.resize_terminal(50, 14)
        await pilot.pause()
        await pilot.pause()
        assert max(map(len, text_of(app, "details").splitlines())) <= 50

    watch(tmp_path / "state", steps)


def test_sessions_and_the_folder_come_and_go(make_session: MakeSession, tmp_path: Path) -> None:
    async def steps(pilot: Pilot[None], app: MonitorApp) -> None:
        await until(app, "head", "is not there (yet)")
        first = make_session("first", steps=5, live=False)
        await until(app, "details", "step 5")
        await until(app, "head", "no process holds a session")
        make_session("second", steps=6)
        await until(app, "list", "second")
        assert "first" in text_of(app, "details")
        first.rename(tmp_path / "discarded")  # at once, as the store does
        gone = await until(app, "details", "first (")  # told, not swapped for another one
        assert "is there no more: it was discarded" in gone
        assert "step 5" in gone
        await asyncio.sleep(0.3)
        assert "first (" in text_of(app, "details")
        await pilot.press("down")
        await until(app, "details", "second")
        shutil.rmtree(tmp_path / "state")
        await until(app, "head", "is not there")

    watch(tmp_path / "state", steps)


@pytest.mark.parametrize("looks", [1, 2])
def test_what_was_known_outlives_a_folder_that_goes_before_its_line(
    make_session: MakeSession, tmp_path: Path, looks: int
) -> None:
    make_session("first", steps=5, live=False)

    async def steps(pilot: Pilot[None], app: MonitorApp) -> None:
        await until(app, "details", "step 5")
        known = app._look
        app._watcher.stop()  # what comes now is what follows
        app._chosen, app._last = "", None
        for look in (*[known] * looks, replace(known, details=None), Look()):
            app._take(look)
        gone = text_of(app, "details")
        assert "is there no more" in gone
        assert "step 5" in gone

    watch(tmp_path / "state", steps)


def test_a_thousand_sessions_are_scrolled(make_session: MakeSession, tmp_path: Path) -> None:
    folder = make_session("a", steps=2, live=False)
    for number in range(60):
        shutil.copytree(folder, folder.with_name(f"{number:032x}"))

    async def steps(pilot: Pilot[None], app: MonitorApp) -> None:
        await until(app, "list", "of 61")
        await pilot.press("end")
        await until(app, "list", "55–61 of 61")

    watch(tmp_path / "state", steps)
