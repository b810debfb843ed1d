"""What happened to a session, for people: each request that took effect or was refused, and what the boundary did.

::

    SESSION'S FOLDER/history/                0700
        events-00000000.jsonl, …             one JSON object a line, see :mod:`.events`
        boundary-00000000.bin, …             see :mod:`.boundary`

The journal keeps only what a recovery needs; this is kept beside it, best effort: nothing is synced, and the first
write that fails, or a disk that lets steps wait again and again (:data:`.segments.ALLOWANCE`), ends the history with
one warning (:mod:`.writer`). No request ever fails or answers otherwise because of it. What was written when an answer
left survives a kill of the process; a loss of power may take the end.

Of the bytes granted (``history_bytes``) the events take a quarter, the oldest segments being removed, but for the line
that tells what was built; the boundary log takes the rest, from step 0 on, and then stops, for only a log without a gap
can be replayed.
"""

from mesh_motion_server.session.history.writer import History

__all__ = ["History"]
