"""A session: the only mutable state of the server, and how it outlives a crash.

::

    session.py           one session: trial, commit, rollback, resume
    state.py, values.py    its states as a table; the values that it swaps as a whole
    model.py, motions.py what it asks of the numerics; a Move as a function of values
    factors.py           what depends on a state alone, kept for the iterations of a step
    replies.py           exactly once: the stored replies
    spec.py              what OPEN fixes

    uploads.py           the mesh while it comes in
    partitions.py, merging.py, joining.py, ordering.py, numbering.py
                         n partitions as one mesh in canonical order, and the way back

    store.py, listing.py the folders of all sessions, and what lists say of them
    mesh_store.py        the mesh on disk
    journal.py, next_manifest.py, ledger.py, records.py, journal_files.py
                         the commits on disk: writing them, what their chain says, its records, reading them
    recovery.py, witness.py, inspection.py
                         a journal as a crash or damage left it; read only, for people
    durability.py, keeper.py, relaxed.py, replay.py
                         the levels: what a commit waits for, what is computed again
    filesystem.py        all that this asks of a file system, which tests replace

No sockets, no processes: :mod:`mesh_motion_server.service` turns messages into its calls.
"""
