"""The stand-in's service with one seeded fault, named by ``SEEDED_FAULT``: what the row of network faults must find.

``executes twice``: the replies to earlier requests are not known again. ``older step``: a session that is opened from
its journal for the second time is as it was at the first.
"""

import os
import shutil

from mesh_motion_server.session.journal.replies import ReplyTable
from mesh_motion_server.session.store import SessionStore as GoodStore
from mesh_motion_server.transport import template
from tests.faults.stand_in_service import SessionHost as GoodHost

SessionHost = GoodHost
FAULT = os.environ["SEEDED_FAULT"]

if FAULT == "executes twice":
    ReplyTable.find = lambda *_: None


class SessionStore(GoodStore):
    """Restores what it once kept."""

    def open(self, session, token):
        if FAULT == "older step":
            folder, kept = self.root / "sessions" / session, self.root / f"kept {session}"
            if kept.exists():
                shutil.rmtree(folder)
                shutil.copytree(kept, folder)
            else:
                shutil.copytree(folder, kept)
        return super().open(session, token)


def main(channel, level):
    """What the template runs."""
    return template.main(channel, level, lambda: (SessionHost, SessionStore))
