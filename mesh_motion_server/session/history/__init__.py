"""The events of a session, for people: each request that took effect or was refused, and the boundary's motion.

::

    SESSION'S FOLDER/history/                0700
        events-00000000.jsonl, …             one JSON object a line, see :mod:`.events`
        boundary-00000000.bin, …             see :mod:`.boundary`

The journal keeps only the data that a recovery needs. The history has no guarantee: nothing is synced.
The first failed write, or a disk that repeatedly delays steps (:data:`.segments.ALLOWANCE`), ends the history with one
warning (:mod:`.writer`). The history never makes a request fail and never changes an answer. The lines that were
written before an answer was sent survive a kill of the process; a loss of power may remove the end.

The events get a quarter of the granted bytes (``history_bytes``); when it is used, the oldest segments are removed,
except the line with event ``built``. The boundary log gets the rest. It starts at step 0 and stops when its bytes are
used, because only a log without a gap can be replayed.

The journal of level "replay" also has the boundary's last displacements, but the two logs are separate. The journal's
space is reserved, its record takes one sync, and its inputs are dropped when a state is stored. The history grows up to
its limit, then stops, and must not stop the session. A step of 1000 nodes takes 30 µs in the history, its commit 7 ms;
a common log would take a second sync, 2 to 4 ms.
"""

from mesh_motion_server.session.history.writer import History

__all__ = ["History"]
