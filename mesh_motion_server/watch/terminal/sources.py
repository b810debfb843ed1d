"""The sessions of a state folder for a terminal: the same values as on the monitor page, without a server."""

from pathlib import Path
from typing import Any

from mesh_motion_protocol.errors import MeshMotionError

from mesh_motion_server.session.spec import SPEC
from mesh_motion_server.watch.observation.overview import Overview
from mesh_motion_server.watch.observation.reading import Reading

#: Number of steps of a history in which the lowest minimum is searched; in a longer history each step represents its
#: neighbours by the lowest.
_POINTS = 600


class Unreadable(Exception):
    """The sessions cannot be read now; a later look may succeed."""


class FolderSource:
    """The sessions of a state folder, or the one session of its own folder; it may be created later, and removed.

    Attributes
    ----------
    where : str
        The folder.
    """

    def __init__(self, folder: Path) -> None:
        self.where = str(folder)
        is_session = (folder / SPEC).is_file() or (folder / "history").is_dir()
        self._only = folder.name if is_session else None
        self._root = folder.parent.parent if is_session else folder
        self._overview = Overview(self._root)
        self._reading: tuple[str, Reading] | None = None

    def sessions(self) -> list[dict[str, Any]]:
        """All sessions in the form of :class:`Overview`, first those that a process holds, then by label.

        Raises Unreadable if the folder is not there or cannot be read.
        """
        if not self._root.is_dir():
            raise self._unreadable("the folder is not there (yet)")
        try:
            listed = self._overview.listed()
        except (OSError, MeshMotionError) as error:
            raise self._unreadable(f"the folder cannot be read: {error}") from error
        found = [entry for entry in listed if self._only in (None, entry["session"])]
        # an order that is stable while no session is added or removed
        return sorted(found, key=lambda one: (one["worker"] == "none", not one["label"], one["label"], one["session"]))

    def _unreadable(self, why: str) -> Unreadable:
        self._overview = Overview(self._root)  # the next look may find another folder in its place
        return Unreadable(why)

    def details(self, session: str) -> dict[str, Any] | None:
        """One session in the form of :class:`Reading`, and the columns of its ``last`` step; None if it is gone.

        ``lowest`` is the step and value of the lowest minimum so far.
        """
        folder = self._root / "sessions" / session
        if not folder.is_dir():
            return None
        if self._reading is None or self._reading[0] != session:
            self._reading = session, Reading(folder)
        reading = self._reading[1]
        reading.catch_up()
        columns = reading.series(None, _POINTS)["columns"]
        found = zip(columns["actual_min"], columns["step"], strict=True)
        value, step = min((pair for pair in found if pair[0] is not None), default=(None, None))
        return reading.detail() | {
            "last": {name: column[-1] for name, column in columns.items() if column},
            "lowest": None if step is None else {"step": int(step), "minimum": value},
        }
