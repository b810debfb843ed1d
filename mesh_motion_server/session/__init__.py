"""A session: the only mutable state of the server, and how it survives a crash.

::

    session.py           one session: trial, commit, rollback, resume
    answers.py           what it answers without a change: derivatives, headroom, swept volumes
    position.py          where it stands: its state and steps, and which requests fit there
    corrections.py       the correction of a mesh whose cells are with the client
    state.py, values.py  the states as a table; the values that the session replaces as a whole
    model.py, motions.py what a session needs from the numerics; a Move as a function of values
    replay.py            recomputes states that were logged, not stored
    factors.py           cache of what depends on a state alone, for the iterations of a step
    spec.py              what OPEN fixes
    store.py, listing.py the folders of all sessions, and their description in lists
    inspection.py        a session's folder, read only, for people

    journal/             commits, mesh and replies on disk
    partitions/          merges the meshes of n partitions, and maps results back
    history/             what happened, for people to read

The subpackages import nothing from the modules above them; ``journal`` and ``history`` import ``partitions`` and
``journal``.

No sockets, no processes: :mod:`mesh_motion_server.service` turns messages into calls of this package.
"""
