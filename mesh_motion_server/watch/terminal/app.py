"""The live view: a list of sessions, all about the chosen one, and a line of keys."""

from __future__ import annotations

import asyncio
import contextlib
import os
import signal
import sys
import time
from collections.abc import Sequence
from typing import ClassVar

from rich.cells import cell_len
from rich.text import Text
from textual.app import App, ComposeResult
from textual.binding import Binding, BindingType
from textual.events import Click, Resize
from textual.widgets import Static

from mesh_motion_server.watch.terminal.panels import WINDOWS, View, details_lines, gone_lines, help_lines, session_lines
from mesh_motion_server.watch.terminal.snapshot import named
from mesh_motion_server.watch.terminal.sources import Details, SessionLine, Source
from mesh_motion_server.watch.terminal.text import clip, plain
from mesh_motion_server.watch.terminal.watcher import Look, Watcher

__all__ = ["MonitorApp"]

_INTERRUPTED, _HUNG_UP = 130, 129
#: Between two looks whether the terminal is still there.
_TERMINAL_SECONDS = 2.0
#: From so many columns on the list stands beside the details.
_WIDE = 140
_LIST_COLUMNS = 56
#: Most rows of the list above the details, its heading included.
_LIST_ROWS = 8
_KEYS_LINE = " ↑↓ choose  enter alone  w steps  ? help  q quit"


class MonitorApp(App[None]):
    """Shows what a source tells.

    Parameters
    ----------
    source : Source
    session : str, optional
        Label of the one that is chosen as soon as it is there, or how its id begins.
    every : float
        Seconds between two looks.
    """

    ENABLE_COMMAND_PALETTE = False
    TITLE = "mesh-motion monitor"
    CSS = """
    Screen, Static { background: ansi_default; color: ansi_default; }
    Screen { layout: grid; grid-size: 1; grid-rows: 1 auto 1fr 1; }
    Screen.wide { grid-size: 2; grid-columns: 57 1fr; grid-rows: 1 1fr 1; }
    Screen.wide #head, Screen.wide #keys { column-span: 2; }
    Screen.wide #list { border-right: solid ansi_bright_black; }
    Screen.wide #details { padding-left: 1; }
    Screen.alone { grid-size: 1; grid-rows: 1 1fr 1; grid-columns: 1fr; }
    Screen.alone #head, Screen.alone #keys { column-span: 1; }
    Screen.alone #list { display: none; }
    Screen.alone #details { padding-left: 0; }
    Static { height: 100%; width: 100%; }
    #head { text-style: bold; }
    #keys { text-style: dim; }
    """
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("up,k", "move(-1)", "previous"),
        Binding("down,j", "move(1)", "next"),
        Binding("home,g", "move(-1000000)", "first"),
        Binding("end,G", "move(1000000)", "last"),
        Binding("enter", "alone", "alone"),
        Binding("escape", "back", "back"),
        Binding("w", "window", "steps"),
        Binding("question_mark", "help", "help"),
        Binding("q", "quit", "quit"),
        Binding("ctrl+c", "interrupt", "quit", priority=True),
    ]

    def __init__(self, source: Source, session: str | None = None, every: float = 1.0) -> None:
        super().__init__(ansi_color=True)  # the terminal's own colours, on its own paper
        self._where = plain(source.where)
        self._wanted = session
        self._chosen = ""
        self._last: tuple[SessionLine, Details | None] | None = None  # the chosen one as it was seen last
        self._look = Look(trouble="looking …")
        self._window = 0
        self._alone = self._helps = self._is_shown = False
        self._watcher = Watcher(source, self._tell, every)

    def compose(self) -> ComposeResult:
        """One piece of text each."""
        for name in ("head", "list", "details", "keys"):
            yield Static(id=name, markup=False)

    def on_mount(self) -> None:
        """Begin to look."""
        with contextlib.suppress(NotImplementedError, RuntimeError, ValueError):  # not in the main thread, as in tests
            asyncio.get_running_loop().add_signal_handler(signal.SIGTERM, self.exit)
        self._is_shown = True
        self._watcher.start()
        self.set_interval(_TERMINAL_SECONDS, self._end_without_terminal)
        self._show()

    def _end_without_terminal(self) -> None:
        """End at once when the terminal is gone and the hangup was ignored, as under nohup.

        Textual's reader would spin at the end of its input, and an orderly end would wait for it. Nothing is lost: this
        process only reads.
        """
        if not (self.is_headless or os.isatty(sys.__stderr__.fileno() if sys.__stderr__ else 2)):
            os._exit(_HUNG_UP)

    def on_unmount(self) -> None:
        """Look no more."""
        self._is_shown = False
        self._watcher.stop()

    def on_resize(self, event: Resize) -> None:
        """Lay it out anew."""
        del event
        self.call_after_refresh(self._show)

    def on_click(self, event: Click) -> None:
        """Choose the session that was clicked on."""
        widget = event.widget
        if widget is None or widget.id != "list" or event.y < 1:
            return
        room = max(self._list_rows() - 1, 1)
        first = min(max(self._place() - room // 2, 0), max(len(self._look.lines) - room, 0))
        self._choose(first + event.y - 1)

    def action_move(self, by: int) -> None:
        """Choose a session so many rows away."""
        self._choose(self._place() + by)

    def action_alone(self) -> None:
        """Show the chosen session alone, or no longer."""
        self._alone, self._helps = not self._alone and not self._helps, False
        self._show()

    async def action_back(self) -> None:
        """Back to the list."""
        self._alone = self._helps = False
        self._show()

    def action_window(self) -> None:
        """Chart fewer steps, or all again."""
        self._window = WINDOWS[(WINDOWS.index(self._window) + 1) % len(WINDOWS)]
        self._show()

    def action_help(self) -> None:
        """Show the keys, or no longer."""
        self._helps = not self._helps
        self._show()

    def action_interrupt(self) -> None:
        """End as an interrupted program does."""
        self.exit(return_code=_INTERRUPTED)

    # --- what is shown ---------------------------------------------------------------------------------------------

    def _tell(self, look: Look) -> None:
        """Called by the watcher's thread."""
        with contextlib.suppress(RuntimeError):  # the application has ended meanwhile
            self.call_from_thread(self._take, look)

    def _take(self, look: Look) -> None:
        if look.trouble and not look.lines and self._look.lines:
            look = Look(self._look.lines, self._look.session, self._look.details, "", look.trouble)
        self._look = look
        names = [line.session for line in look.lines]
        place = named(look.lines, self._wanted) if self._wanted is not None else None
        if place is not None:
            self._chosen, self._wanted = names[place], None
        if self._chosen not in names and self._last is None:
            self._chosen = names[0] if names else ""
        if self._chosen in names:  # one that was looked at and is gone is told, not swapped for another one
            before = self._last[1] if self._last else None
            known = look.details if look.session == self._chosen else None
            self._last = look.lines[names.index(self._chosen)], known or before  # its files go before its line does
        self._watcher.choose(self._chosen)
        self._show()

    def _place(self) -> int:
        """Of the chosen session in the list; -1 without one."""
        return next((i for i, line in enumerate(self._look.lines) if line.session == self._chosen), -1)

    def _choose(self, place: int) -> None:
        lines = self._look.lines
        if lines:
            self._wanted = self._last = None  # whoever chooses another one does not wait for it any more
            self._chosen = lines[min(max(place, 0), len(lines) - 1)].session
            self._watcher.choose(self._chosen)
            self._show()

    def _list_rows(self) -> int:
        """Rows of the list."""
        if self.screen.has_class("wide"):
            return max(self.size.height - 2, 1)
        return max(min(len(self._look.lines) + 1, _LIST_ROWS, self.size.height // 3), 2)

    def _show(self) -> None:
        """Write everything anew."""
        if not (self._is_shown and self.query("#head")):  # at its end the widgets go before it hears of it
            return
        columns, rows = self.size
        alone = self._alone or self._helps or (rows < 12 and self._alone)
        self.screen.set_class(columns >= _WIDE and not alone, "wide")
        self.screen.set_class(alone, "alone")
        wide = self.screen.has_class("wide")
        list_rows = self._list_rows()
        self._write("head", [self._head(columns)])
        self._write("keys", [Text(clip(_KEYS_LINE, columns))])
        now = time.time()
        if not alone:
            view = View(_LIST_COLUMNS if wide else columns, list_rows, now=now)
            self._write("list", self._list(view))
            self.query_one("#list", Static).styles.height = "100%" if wide else list_rows
        left = rows - 2 - (0 if wide or alone else list_rows)
        width = columns - _LIST_COLUMNS - 3 if wide else columns
        self._write("details", self._details(View(width, left, self._window, now, wrapped=alone or wide)))

    def _write(self, name: str, lines: Sequence[Text]) -> None:
        text = Text("\n", no_wrap=True, overflow="crop").join(lines)
        text.no_wrap, text.overflow = True, "crop"
        self.query_one(f"#{name}", Static).update(text)

    def _head(self, columns: int) -> Text:
        """Where it looks, and what is wrong."""
        look = self._look
        awaited = f"no session {self._wanted!r} so far" if self._wanted is not None else ""
        trouble = plain(look.trouble or awaited or look.verdict)
        where = f" mesh-motion · {self._where} · {len(look.lines)} sessions"
        if not trouble:
            return Text(clip(where, columns))
        what = Text(clip(where, max(columns - cell_len(trouble) - 3, 12)))
        what.append(
            clip("   " + trouble, columns - cell_len(what.plain)), style="bold red" if look.trouble else "yellow"
        )
        return what

    def _list(self, view: View) -> list[Text]:
        if not self._look.lines:
            return [Text(" no sessions", style="dim")]
        return session_lines(self._look.lines, self._place(), view)

    def _details(self, view: View) -> list[Text]:
        """Of the chosen session, as soon as they have come."""
        if self._helps:
            return help_lines()
        place = self._place()
        if place < 0:
            return [] if self._last is None else gone_lines(*self._last, view)
        line = self._look.lines[place]
        if self._look.session != line.session:
            return [Text(f"reading {plain(line.label) or line.session} …", style="dim")]
        return details_lines(line, self._look.details, view)
