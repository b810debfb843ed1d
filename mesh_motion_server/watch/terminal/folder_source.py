"""Sessions from a server's state folder alone: nobody is asked, so a server that has died is shown as well."""

from __future__ import annotations

import time
from pathlib import Path

from mesh_motion_server.errors import MeshMotionError
from mesh_motion_server.session.listing import SPEC
from mesh_motion_server.watch.observation.follow import last_event
from mesh_motion_server.watch.observation.sessions import Sessions, SessionView
from mesh_motion_server.watch.observation.standing import rests
from mesh_motion_server.watch.terminal.recording import Recording
from mesh_motion_server.watch.terminal.sources import Details, SessionLine, Unreadable, in_order

__all__ = ["FolderSource"]

#: Histories that are kept in memory, those looked at last; one of 100 000 steps takes some 100 MB.
_MOST_RECORDINGS = 4
_AT_REST = "at rest"


class FolderSource:
    """The sessions of a state folder, or the one session of its own folder.

    Parameters
    ----------
    folder : Path
        May come into being later, and go.
    """

    def __init__(self, folder: Path) -> None:
        self.where = str(folder)
        is_session = (folder / SPEC).is_file() or (folder / "history").is_dir()
        self._only = folder.name if is_session else None
        self._root = folder.parent.parent if is_session else folder
        self._sessions = Sessions(self._root)
        self._recordings: dict[str, Recording] = {}
        self._minima: dict[str, tuple[float, float | None]] = {}

    def sessions(self) -> list[SessionLine]:
        """See :class:`~.sources.Source`: those that a process holds first, then by label."""
        if not self._root.is_dir():
            raise Unreadable("the folder is not there (yet)")
        try:
            views = self._sessions.views()
        except (OSError, MeshMotionError) as error:
            raise Unreadable(f"the folder cannot be read: {error}") from error
        views = [view for view in views if self._only in (None, view.session)]
        known = {view.session for view in views}
        self._minima = {name: value for name, value in self._minima.items() if name in known}
        for gone in set(self._recordings) - known:
            del self._recordings[gone]
        return in_order([self._line(view) for view in views])

    def details(self, session: str, seconds: float) -> Details | None:
        """See :class:`~.sources.Source`."""
        folder = self._sessions.folder / session
        if not folder.is_dir():
            self._recordings.pop(session, None)
            return None
        recording = self._recordings.pop(session, None) or Recording(folder)
        self._recordings[session] = recording  # the last one looked at
        while len(self._recordings) > _MOST_RECORDINGS:
            del self._recordings[next(iter(self._recordings))]
        recording.read(seconds)
        return recording.details()

    def verdict(self, lines: list[SessionLine]) -> str:
        """See :class:`~.sources.Source`."""
        if lines and all(line.is_live is False for line in lines):
            latest = max(line.changed_at or 0.0 for line in lines)
            when = time.strftime("%Y-%m-%d %H:%M:%S", time.localtime(latest))
            return f"no process holds a session: these are files, last written {when}"
        return ""

    def close(self) -> None:
        """See :class:`~.sources.Source`."""
        self._recordings.clear()

    def _line(self, view: SessionView) -> SessionLine:
        return SessionLine(
            session=view.session,
            label=view.label,
            state=_AT_REST if rests(view.state, view.held) else view.state,
            step=view.step,
            minimum=self._minimum(view),
            changed_at=view.changed_at,
            is_live=view.held,
            is_recorded=view.recorded,
        )

    def _minimum(self, view: SessionView) -> float | None:
        """Of the last commit; read again when something has happened."""
        known = self._minima.get(view.session)
        if known is not None and known[0] == view.changed_at:
            return known[1]
        try:
            event = last_event(Path(view.folder), ("committed",))
        except OSError:
            event = None
        value = event["quality"].get("metric", {}).get("min") if event else None
        value = float(value) if isinstance(value, int | float) else None
        self._minima[view.session] = (view.changed_at, value)
        return value
