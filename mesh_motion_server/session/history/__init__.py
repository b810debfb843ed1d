"""What happened to a session, for people: each request that took effect or was refused, and the boundary's motion.

::

    SESSION'S FOLDER/history/                0700
        events-00000000.jsonl, …             one JSON object a line, see :mod:`.events`
        boundary-00000000.bin, …             see :mod:`.boundary`

The journal keeps only what a recovery needs. The history has no guarantee: nothing is synced.
The first failed write, or a disk that repeatedly delays steps (:data:`.segments.ALLOWANCE`), ends the history with one
warning (:mod:`.writer`). The history never makes a request fail and never changes an answer. What was written when an
answer left survives a kill of the process; a loss of power may remove the end.

The events get a quarter of the granted bytes (``history_bytes``); when it is used, the oldest segments are removed,
except the line with event ``built``. The boundary log gets the rest. It starts at step 0 and stops when its bytes are
used, because only a log without a gap can be replayed.
"""

from mesh_motion_server.session.history.writer import History

__all__ = ["History"]
