"""A session: the only mutable state of the server, and how it outlives a crash.

::

    session.py           one session: trial, commit, rollback, resume
    state.py, values.py    its states as a table; the values that it swaps as a whole
    model.py, motions.py what it asks of the numerics; a Move as a function of values
    replay.py            states that were logged, not stored, computed again
    factors.py           what depends on a state alone, kept for the iterations of a step
    spec.py              what OPEN fixes
    store.py, listing.py the folders of all sessions, and what lists say of them
    inspection.py        a session's folder, read only, for people

    journal/             the commits, the mesh and the replies on disk
    partitions/          the mesh of n partitions as one mesh, and the way back
    history/             what happened, for people who look at it

The rooms import nothing of the modules above them; ``journal`` and ``history`` know ``partitions`` and ``journal``.

No sockets, no processes: :mod:`mesh_motion_server.service` turns messages into its calls.
"""
