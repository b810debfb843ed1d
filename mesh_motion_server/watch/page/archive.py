"""Answers to the page's requests, with one thread for each kind, so that a long history does not delay the list.

The archive reads only the data that a page shows, and caches them: the series of the last few sessions, some pictures,
and the answers as long as they are valid. So any number of pages costs the same as one.
"""

import json
import re
import time
from collections import OrderedDict
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, TypeVar

from mesh_motion_protocol.errors import InvalidInput, SessionError

from mesh_motion_server.watch.observation.overview import Overview
from mesh_motion_server.watch.observation.reading import Reading

#: Number of sessions whose series are cached.
_FOLLOWED = 16
#: Number of series answers that are cached until new events come.
_ANSWERS = 12
#: Number of sessions whose pictures are cached.
_DRAWN = 8
#: Minimum seconds between two pictures of a mesh, for any number of readers and any step rate.
_MESH_SECONDS = 3.0
#: Maximum share of the time for pictures: after one that takes a second, the next waits twenty seconds.
_MESH_SHARE = 0.05
_SESSION = re.compile(r"[0-9a-f]{32}")

Value = TypeVar("Value")


class Archive:
    """The data of a state folder.

    Attributes
    ----------
    lists, histories, meshes : ThreadPoolExecutor
        With one thread each; call the methods in these threads.
    """

    def __init__(self, state_folder: Path) -> None:
        self.lists, self.histories, self.meshes = (ThreadPoolExecutor(1, name) for name in ("list", "history", "mesh"))
        self._folder = state_folder / "sessions"
        self._overview = Overview(state_folder)
        self._followed: OrderedDict[str, Reading] = OrderedDict()
        self._answers: OrderedDict[tuple[Any, ...], tuple[Reading, tuple[int, int], bytes]] = OrderedDict()
        self._drawn: OrderedDict[str, _Drawn] = OrderedDict()

    def overview(self, live: list[list[Any]]) -> list[dict[str, Any]]:
        """The list; in the thread ``lists``."""
        return self._overview.listed(live)

    def detail(self, session: str) -> bytes:
        """A session without its series, JSON; in the thread ``histories``."""
        followed = self._follow(session)
        return self._answer(followed, (session,), followed.detail)

    def series(self, session: str, first: int | None, points: int) -> bytes:
        """The session's series, JSON; in the thread ``histories``."""
        followed = self._follow(session)
        asked = (session, first, points)
        return self._answer(followed, asked, lambda: followed.series(first, points))

    def mesh(self, session: str, *, dark: bool) -> tuple[bytes, float]:
        """The session's stored mesh as PNG, and the seconds until a newer one is drawn; in the thread ``meshes``."""
        folder = self._found(session)
        drawn = self._drawn.pop(session, None) or _Drawn(folder)
        self._drawn[session] = drawn
        while len(self._drawn) > _DRAWN:
            self._drawn.popitem(last=False)
        try:
            return drawn.picture(dark=dark)
        except MemoryError:
            raise InvalidInput("the mesh is too large to be drawn here") from None
        except ModuleNotFoundError as error:
            missing = f"the server has no package {error.name}: install the extra monitor"
            raise InvalidInput(f"the mesh cannot be drawn: {missing}") from None

    def _follow(self, session: str) -> Reading:
        folder = self._found(session)
        followed = self._followed.pop(session, None) or Reading(folder)
        self._followed[session] = followed
        while len(self._followed) > _FOLLOWED:
            self._followed.popitem(last=False)
        followed.catch_up()
        return followed

    def _answer(self, followed: Reading, asked: tuple[Any, ...], make: Callable[[], Any]) -> bytes:
        """The cached answer, if no event was added since; otherwise a new one."""
        known = self._answers.pop(asked, None)
        if known is None or known[0] is not followed or known[1] != followed.stamp:
            known = (followed, followed.stamp, as_json(make()))
        self._answers[asked] = known
        while len(self._answers) > _ANSWERS:
            self._answers.popitem(last=False)
        return known[2]

    def _found(self, session: str) -> Path:
        """The session's folder."""
        if not _SESSION.fullmatch(session) or not (self._folder / session).is_dir():
            raise SessionError("there is no such session", code="NOT_FOUND", hint="it may have been discarded")
        return self._folder / session


class _Drawn:
    """The pictures of a session's mesh."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._pictures: dict[bool, bytes] = {}
        self._due = 0.0

    def picture(self, *, dark: bool) -> tuple[bytes, float]:
        """PNG of the currently stored state, or of a recent one and the seconds until a newer one is drawn."""
        from mesh_motion_server.watch.page.drawing import draw  # noqa: PLC0415  (kernels and matplotlib: seconds to load)

        now = time.monotonic()
        if now >= self._due:
            self._pictures = {}
        if dark in self._pictures:
            return self._pictures[dark], self._due - now
        self._pictures[dark] = draw(self._folder, dark=dark)
        ended = time.monotonic()
        self._due = ended + max(_MESH_SECONDS, (ended - now) / _MESH_SHARE)
        return self._pictures[dark], 0.0


def as_json(value: Any) -> bytes:
    """Compact JSON."""
    # a lone surrogate in a damaged history stays an escape sequence, which JSON allows
    return json.dumps(value, allow_nan=False, separators=(",", ":"), ensure_ascii=False).encode(
        errors="backslashreplace"
    )


def integer(text: str | None, default: Callable[[], Value]) -> int | Value:
    """A non-negative integer of a request, or the default. Raises InvalidInput if it is something else."""
    if text is None:
        return default()
    if not (text.isascii() and text.isdigit() and len(text) < 16):
        raise InvalidInput(f"expected a whole number, got {text[:40]!r}")
    return int(text)
