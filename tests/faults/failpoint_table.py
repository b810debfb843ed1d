"""All failpoints: name, what has just happened or will happen next, and the faults that can occur there.

:mod:`mesh_motion_server.failpoints` says how they work. Each is called in exactly one place of the server's code.
"""

from collections.abc import Mapping
from types import MappingProxyType

_LATE = "sleep:0.4"
#: Around a file: the process ends, is slow, or the operation fails.
_FILE = ("kill", "raise:EIO", "raise:ENOSPC", _LATE)
#: While a session computes: an allocation may fail, and a defect may raise an unexpected error.
_COMPUTING = ("kill", "raise:MemoryError", "raise:RuntimeError", _LATE)
#: While a process only passes data on.
_PASSING = ("kill", "raise:RuntimeError", _LATE)
#: In code in which nothing can fail, and in the supervisor, whose own errors would end the server.
_CERTAIN = ("kill", _LATE)
#: While the supervisor asks the kernel for a process, or reads the store.
_STARTING = ("kill", "raise:EAGAIN", "raise:ENOMEM", _LATE)
_READING = ("kill", "raise:EIO", "raise:EMFILE", _LATE)

_TABLE = (
    # the store
    ("store.create.folder-made", "the folder of a new session is there, nothing is in it", _FILE),
    ("store.create.spec-written", "spec.json is written, the folders are not synced", _FILE),
    ("store.open.locked", "an existing session's folder is locked", _FILE),
    ("store.mesh.unsynced", "mesh.bin is written and not synced", _FILE),
    ("store.mesh.written", "mesh.bin is durable, the journal not begun", _FILE),
    ("store.mesh.read", "mesh.bin is about to be read", _FILE),
    ("store.discard.renamed", "a discarded session is renamed, not deleted", _FILE),
    ("store.list", "the stored sessions are about to be listed", _READING),
    ("store.sweep", "a starting server looks for folders that were half made or half deleted", _CERTAIN),
    # the journal
    ("journal.create.slots", "the slots are written, there is no manifest", _FILE),
    ("journal.create.unnamed", "a new manifest is written under its provisional name", _FILE),
    ("journal.create.renamed", "a new manifest has its name, the folder is not synced", _FILE),
    ("journal.open.read", "an existing journal is judged, nothing is repaired", _FILE),
    ("journal.settle.record", "the last record is written again and synced, slots are not cleaned", _FILE),
    ("journal.settle.done", "what a crash left is repaired, except the provisional manifest", _FILE),
    ("journal.commit.start", "a commit is about to be written", _FILE),
    ("journal.commit.ahead", "the coordinates are written and not synced, their record is not known", _FILE),
    ("journal.commit.slot-unsynced", "the slot is written and not synced", _FILE),
    ("journal.commit.slot-synced", "the slot is durable, its record is not in the manifest", _FILE),
    ("journal.record.unsynced", "a record is written and not synced", _FILE),
    ("journal.record.synced", "a record is durable, the ledger does not know it", _FILE),
    ("journal.epoch.start", "the epoch is about to be raised", _FILE),
    ("journal.rotate", "the manifest is full, the next one not begun", _FILE),
    # the session
    ("session.upload.taken", "a part of the mesh is kept, the state not changed", _COMPUTING),
    ("session.build.checked", "the mesh is checked, the journal not begun", _COMPUTING),
    ("session.build.stored", "the mesh is durable, the session does not know it", _COMPUTING),
    ("session.move.start", "a Move is about to be computed", _COMPUTING),
    ("session.move.computed", "a Move is computed, its trial not taken", _COMPUTING),
    ("session.commit.start", "a commit is admitted, nothing is written", _COMPUTING),
    ("session.commit.durable", "a commit is durable, the session does not know it", _CERTAIN),
    ("session.rollback.start", "the trial is about to be dropped", _COMPUTING),
    ("session.reopen.start", "the journal is open, the model not built", _COMPUTING),
    ("session.reopen.restored", "a stored session is read, its epoch not raised", _COMPUTING),
    ("session.resume.raised", "the epoch is raised, the old holder not yet fenced", _COMPUTING),
    ("session.suspend", "the lease has ended", _COMPUTING),
    ("session.close", "files and lock are about to be given back", _COMPUTING),
    # the requests
    ("request.join", "a token was right, its peer does not speak for the partition yet", _COMPUTING),
    ("request.gather.first", "a collective request waits for the other partitions", _COMPUTING),
    ("request.execute", "all have asked whom a request needs", _COMPUTING),
    ("request.moved", "a Move's trial is taken, its replies not made", _COMPUTING),
    ("request.committed", "a commit is durable, its replies not made", _COMPUTING),
    ("request.unstored", "the replies are made and not remembered", _COMPUTING),
    ("request.stored", "the replies are remembered and not sent", _COMPUTING),
    ("request.replies.known", "the replies of journaled commits are known again", _COMPUTING),
    ("request.close.left", "the last partition has left, the session not closed", _COMPUTING),
    ("request.discard", "the session is about to be discarded, and then closed", _COMPUTING),
    # the worker
    ("template.start", "the process begins that workers are forked from", _PASSING),
    ("template.ready", "it has imported everything", _PASSING),
    ("template.fork", "it is about to fork a worker", _STARTING),
    ("worker.start", "a worker's process begins", _PASSING),
    ("worker.ordered", "a worker has its order", _PASSING),
    ("worker.hosting", "the session is there, the endpoint not bound", _PASSING),
    ("worker.bound", "the endpoint is bound, the supervisor does not know it", _PASSING),
    ("worker.received", "a request's frames are there, not decoded", _COMPUTING),
    ("worker.sending", "a reply is made and not sent", _COMPUTING),
    ("worker.sent", "a reply is sent", _PASSING),
    ("worker.lease-end", "no connection within the lease", _PASSING),
    ("worker.reclaim", "the supervisor asks for a new holder", _PASSING),
    ("worker.drain", "the supervisor asks for the end", _PASSING),
    ("worker.over", "the session's use has ended, the supervisor does not know it", _PASSING),
    # the supervisor
    ("supervisor.spawn", "a process is about to be started", _STARTING),
    ("supervisor.fork", "the template is about to be asked for a worker", _STARTING),
    ("supervisor.ordered", "a worker is asked for and has its order", _CERTAIN),
    ("supervisor.opened", "a worker has its order, the session is not in the registry", _CERTAIN),
    ("supervisor.request", "a control request has come from the gateway", _CERTAIN),
    ("supervisor.reported", "a worker's report is not taken in", _CERTAIN),
    ("supervisor.answer", "an OPEN or RESUME is done and not answered", _CERTAIN),
    ("supervisor.worker-ended", "a worker's end is known and not dealt with", _CERTAIN),
    ("supervisor.restart", "a session is about to get another worker", _CERTAIN),
    ("supervisor.gateway-ended", "the gateway's end is known and not dealt with", _CERTAIN),
    ("supervisor.drain", "the server gets the order to stop", _CERTAIN),
    # the gateway
    ("gateway.start", "the gateway's process begins", _PASSING),
    ("gateway.received", "a request's frames are there, not decoded", _COMPUTING),
    ("gateway.forward", "a request is about to go to the supervisor", _PASSING),
    ("gateway.reply", "a reply is about to be sent", _PASSING),
)

#: Name → the faults that a proof may cause there, as a plan names them.
POINTS: Mapping[str, tuple[str, ...]] = MappingProxyType({name: faults for name, _, faults in _TABLE})
