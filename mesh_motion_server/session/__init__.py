"""A session: the only mutable state of the server, and its durability.

::

    session.py           one session: trial, commit, rollback, resume
    answers.py           answers that change nothing: derivatives, headroom, swept volumes
    position.py          its state and steps, and the requests that are allowed in them
    corrections.py       the correction of a mesh whose cells are with the client
    state.py, values.py  the states as a table; the values that the session replaces as a whole
    model.py, motions.py what a session needs from the numerics; a Move as a function of values
    replay.py            recomputes states that were logged, not stored
    factors.py           cache of data that depend on a state only, for the iterations of a step
    spec.py              the values that OPEN fixes
    store.py, listing.py the folders of all sessions, and their description in lists
    inspection.py        a session's folder, read only, for people

    journal/             commits, mesh and replies on disk
    partitions/          merges the meshes of n partitions, and maps results back
    history/             the events, for people to read

The subpackages import nothing from the modules above them; ``journal`` and ``history`` import ``partitions`` and
``journal``.

No sockets, no processes: :mod:`mesh_motion_server.service` turns messages into calls of this package.
"""
