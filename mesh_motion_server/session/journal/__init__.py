"""The files of a session on disk, and the durability of commits.

::

    journal.py           the commits: writing them, one manifest and two slots with states
    records.py, ledger.py  a record of the manifest; the content of the chain of records
    files.py, next_manifest.py, witness.py
                         the files: reading them; the next manifest; which record is known to be durable
    recovery.py          a journal after a crash or damage
    durability.py, keeper.py, relaxed.py
                         the levels: the condition that a commit waits for
    replies.py           exactly once: the stored replies
    mesh_store.py        the mesh on disk
    filesystem.py, background_call.py
                         the operations of a file system, which tests replace; a call in its own thread
"""
