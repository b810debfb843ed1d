"""What a session has on disk, and when a commit is durable.

::

    journal.py           the commits: writing them, one manifest and two slots with states
    records.py, ledger.py  a record of the manifest; what the chain of records says
    files.py, next_manifest.py, witness.py
                         the files: reading them; the next manifest; which record is known to be durable
    recovery.py          a journal as a crash or damage left it
    durability.py, keeper.py, relaxed.py
                         the levels: what a commit waits for
    replies.py           exactly once: the stored replies
    mesh_store.py        the mesh on disk
    filesystem.py, background_call.py
                         all that this asks of a file system, which tests replace; a call in a thread of its own
"""
