"""The sessions of a state folder and their states, from their folders alone."""

from dataclasses import dataclass
from pathlib import Path

from mesh_motion_protocol.errors import MeshMotionError

from mesh_motion_server.session.history.events import FOLDER
from mesh_motion_server.session.journal.filesystem import PosixFileSystem
from mesh_motion_server.session.listing import UNREADABLE, Listing
from mesh_motion_server.session.state import State
from mesh_motion_server.session.store import SessionStore
from mesh_motion_server.watch.observation.follow import last_event

#: The state of a session after its last event.
_STATES = {
    "built": State.READY,
    "moved": State.TRIAL,
    "committed": State.READY,
    "rolled_back": State.READY,
    "resumed": State.READY,
    "suspended": State.SUSPENDED,
    "joined": State.READY,
    "frozen": State.FROZEN,
    "closed": State.CLOSED,
    "failed": State.FAILED,
}
#: Events of the step after the committed one; the others name the committed one, or none.
_AHEAD = ("moved", "rolled_back")


@dataclass(frozen=True)
class SessionView:
    """The state of a session, read from its folder."""

    session: str
    label: str
    folder: str
    dimension: int
    partitions: int
    durability: str
    #: The last committed step in the journal, or in the history if that is later (``relaxed``) and not lost in a crash
    #: (a process still holds the session).
    step: int
    #: The state after the last event: READY, TRIAL, SUSPENDED, FROZEN, CLOSED or FAILED; for a session without events
    #: READY, FAILED if its files do not verify, UNREADABLE if the disk does not give them.
    state: str
    held: bool | None  # whether a process holds it; None if the system does not report it
    changed_at: float  # unix time of the last event, or of the folder's last change if there is no event
    recorded: bool  # whether it has a history


class Sessions:
    """The sessions of a state folder; repeated calls read only what has changed.

    Parameters
    ----------
    state_folder : Path
        Need not exist yet.
    """

    def __init__(self, state_folder: Path) -> None:
        self._store = SessionStore(state_folder)
        self._listing = Listing(PosixFileSystem())

    def views(self) -> list[SessionView]:
        """All built sessions, the last changed first."""
        held = _held_inodes()
        found = [self._view(stored.session, held) for stored in self._store.sessions()]
        return sorted((view for view in found if view is not None), key=lambda view: -view.changed_at)

    def _view(self, session: str, held: set[int] | None) -> SessionView | None:
        folder = self._store.root / "sessions" / session
        try:
            stored, event = self._store.describe(session), last_event(folder, _STATES)
            changed_at = float(event["at"]) if event else folder.stat().st_mtime
            inode = (folder / "lock").stat().st_ino
        except FileNotFoundError:
            return None  # it was discarded in the meantime
        except OSError:
            return SessionView(session, "", str(folder), 0, 0, "", 0, UNREADABLE, None, 0.0, recorded=False)
        is_held = None if held is None else inode in held
        begun = 0 if event is None or is_held is False else event.get("step", 0) - (event["event"] in _AHEAD)
        return SessionView(
            session=session,
            label=stored.label,
            folder=str(folder),
            dimension=stored.dimension,
            partitions=stored.partitions,
            durability=self._durability(folder),
            step=max(stored.step, begun),
            state=str(_STATES[event["event"]] if event and stored.state == State.READY else stored.state),
            held=is_held,
            changed_at=changed_at,
            recorded=(folder / FOLDER).is_dir(),
        )

    def _durability(self, folder: Path) -> str:
        try:
            return self._listing.spec(folder).durability
        except MeshMotionError:
            return ""


def _held_inodes() -> set[int] | None:
    """Inodes of files that a process has locked completely; None if the system does not report them."""
    try:
        lines = Path("/proc/locks").read_text(encoding="ascii").splitlines()
    except OSError:
        return None
    fields = (line.split() for line in lines)
    return {int(found[5].rpartition(":")[2]) for found in fields if len(found) > 5 and found[1] == "FLOCK"}
