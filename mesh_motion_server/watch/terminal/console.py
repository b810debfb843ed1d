"""The only access to Rich: no text is ever markup, and no text has control characters.

Labels, names of patches and messages come from clients and files. In such text Rich would read ``[/x]`` as an error,
``[link=…]`` as a hyperlink and ``[coarse]`` as a style. So no other module makes a console, a table, a text or a
progress bar of Rich; a test of the sources checks this.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, Protocol

import rich.console
import rich.table
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from rich.text import Text

from mesh_motion_server.watch.terminal.text import plain


class Advance(Protocol):
    """Shows the progress, with some words."""

    def __call__(self, done: int, total: int, words: str) -> None: ...


def console(**options: Any) -> rich.console.Console:
    """A console that prints strings unchanged; with ``soft_wrap`` long lines continue on the next line."""
    return rich.console.Console(markup=False, emoji=False, highlight=False, **options)


def inert(*lines: object, style: str = "") -> Text:
    """Text without markup, on these lines and no others."""
    return Text("\n".join(map(plain, lines)), style=style)


class Table(rich.table.Table):
    """A table whose strings are inert."""

    def __init__(self, *headers: str, title: str | None = None, **options: Any) -> None:
        options |= {"title": None if title is None else inert(title), "title_justify": "left"}
        super().__init__(*map(plain, headers), **options)

    def add_row(self, *cells: rich.console.RenderableType | None, **options: Any) -> None:
        """Append a row; see Rich."""
        super().add_row(*(inert(cell) if isinstance(cell, str) else cell for cell in cells), **options)


@contextmanager
def working(what: str) -> Iterator[Callable[[str], None]]:
    """Show a spinner on standard error with a description of the work; yield a function to change this text."""
    with console(stderr=True).status(inert(what)) as status:
        yield lambda words: status.update(inert(words))


@contextmanager
def progress_bar(what: str) -> Iterator[Advance]:
    """Show a bar on standard error that disappears at the end; yield a function (done, total, words) to advance it."""
    words = TextColumn("{task.description}", markup=False)
    columns = TextColumn("step", markup=False), MofNCompleteColumn(), BarColumn(), TimeElapsedColumn(), words
    with Progress(*columns, console=console(stderr=True), transient=True) as progress:
        task = progress.add_task(plain(what), total=None)

        def advance(done: int, total: int, words: str) -> None:
            progress.update(task, completed=done, total=total, description=plain(words))

        yield advance
