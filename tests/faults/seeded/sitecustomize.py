"""Faults for the server's own processes: each process imports this module at its start, and the module changes the
functions that SEEDED_FAULTS names.

The folder is put first on PYTHONPATH by the fixture ``seed``. A process started with ``-m`` has its own copy of the
main module, so faults are put into the modules that it imports.
"""

# ruff: noqa: PLC0415  (what no fault breaks is not loaded)

import os
from collections.abc import Callable

FAULTS: dict[str, Callable[[], None]] = {}


def fault(seed: Callable[[], None]) -> Callable[[], None]:
    FAULTS[seed.__name__.replace("_", " ")] = seed
    return seed


# --- authorisation ---


@fault
def a_monitor_may_close() -> None:
    from mesh_motion_server.security.authorisation import MATRIX, Role, Verdict

    MATRIX[Role.MONITOR]["CLOSE"] = (Verdict.OVERSEE, Verdict.OVERSEE)


@fault
def an_owner_may_probe_others_sessions() -> None:
    from mesh_motion_server.security.authorisation import MATRIX, Role, Verdict

    MATRIX[Role.OWNER]["PROBE"] = (Verdict.USE, Verdict.USE)


@fault
def an_admin_may_not_list() -> None:
    from mesh_motion_server.security.authorisation import MATRIX, Role, Verdict

    MATRIX[Role.ADMIN]["LIST"] = (Verdict.DENIED, Verdict.DENIED)


@fault
def statuses_show_places() -> None:
    from mesh_motion_server.service import status

    status.without_places = lambda reply: reply


@fault
def no_delay_of_not_found() -> None:
    from mesh_motion_server.transport import late_replies

    late_replies._SECONDS = 0.0


@fault
def a_lookup_that_takes_its_time_after_the_delay_began() -> None:
    import time

    from mesh_motion_server.transport.control import Control
    from mesh_motion_server.transport.registry import Registry

    owner, reply_error = Registry.owner, Control._reply_error

    def slow(self, session):
        found = owner(self, session)
        time.sleep(0.03 * (found is not None))
        return found

    def late(self, *given):
        self._later.asked()
        reply_error(self, *given)

    Registry.owner, Control._reply_error = slow, late


@fault
def another_hint_where_there_is_a_session() -> None:
    from mesh_motion_protocol.errors import SessionError

    from mesh_motion_server.transport import control

    request, not_found, control_of = control.Control.request, control.not_found, []

    def remember(self, *given):
        control_of[:] = [self]
        request(self, *given)

    def worded(session):
        known = control_of[0].registry.owner(session) is not None
        error = not_found(session)
        return SessionError(error.message, code="NOT_FOUND", hint="it is not yours") if known else error

    control.Control.request, control.not_found = remember, worded


@fault
def an_allow_list_that_is_read_once() -> None:
    from mesh_motion_server.security.allow_list import AllowList

    look = AllowList._look
    AllowList._look = lambda self: None if self._entries else look(self)


@fault
def users_who_name_themselves() -> None:
    import contextlib

    import zmq

    from mesh_motion_server.security.allow_list import Everybody
    from mesh_motion_server.transport import protection

    def user_of(frame, _protection):
        with contextlib.suppress(zmq.ZMQError):
            return str(frame.get("User-Id"))
        return ""

    protection.user_of = user_of
    Everybody.roles = lambda self, key: ("owner",)


# --- failpoints ---


@fault
def a_reply_before_its_record() -> None:
    import numpy as np

    from mesh_motion_server.service.dispatch import SessionHost
    from mesh_motion_server.session.journal.journal import Journal

    write, handle, late = Journal.store, SessionHost.handle, []

    def write_late_and_handle(self, envelope):
        while late:
            write(*late.pop())
        return handle(self, envelope)

    Journal.store = lambda self, entry, state: late.append((self, entry, np.array(state)))
    SessionHost.handle = write_late_and_handle


@fault
def an_epoch_in_memory() -> None:
    from dataclasses import replace

    from mesh_motion_server.session.journal.journal import Journal

    def raise_epoch(self):
        self.ledger = replace(self.ledger, epoch=self.ledger.epoch + 1)
        return self.ledger.epoch

    Journal.raise_epoch = raise_epoch


@fault
def a_record_without_its_reply() -> None:
    from mesh_motion_server.session.journal.ledger import Commit

    as_body = Commit.as_body
    Commit.as_body = lambda self: as_body(self) | {"requests": []}


@fault
def an_error_that_is_answered_as_none() -> None:
    from mesh_motion_protocol.errors import DataLoss

    from mesh_motion_server.session.session import Session

    attempt = Session._write

    def careless(self, write, after):
        try:
            attempt(self, write, after)
        except DataLoss:
            self._now = after

    Session._write = careless


@fault
def a_worker_that_is_given_away_twice() -> None:
    from mesh_motion_server.transport.supervisor import Supervisor

    start, given = Supervisor._start_session, []

    def keep(self, order):
        given.append(given[0] if given else start(self, order))
        return given[0]

    Supervisor._start_session = keep


@fault
def a_worker_that_hangs_where_it_fails() -> None:
    import time

    from mesh_motion_server.service import execution

    execution.known_error = lambda error: time.sleep(3600)


# --- network ---


@fault
def requests_that_are_executed_twice() -> None:
    from mesh_motion_server.session.journal.replies import ReplyTable

    ReplyTable.find = lambda *_: None


@fault
def a_resume_at_an_older_step() -> None:
    """A session that is opened from its journal for the second time has the state of the first time."""
    import shutil

    from mesh_motion_server.session.store import SessionStore

    honest = SessionStore.open

    def older(self, session, token):
        folder, kept = self.root / "sessions" / session, self.root / f"kept {session}"
        if kept.exists():
            shutil.rmtree(folder)
            shutil.copytree(kept, folder)
        else:
            shutil.copytree(folder, kept)
        return honest(self, session, token)

    SessionStore.open = older


# --- isolation: what the row itself needs ---


@fault
def sessions_with_bad_manners() -> None:
    """Labels choose a fault in STATUS; FETCH is answered with 100 MB for any mesh.

    ``kill`` ends the process at once, ``abort`` as a failed assertion in native code does, ``memory`` takes memory
    until the worker's limit.
    """
    import signal

    import numpy as np
    from mesh_motion_protocol.messages import Fetched

    from mesh_motion_server.service.dispatch import SessionHost
    from mesh_motion_server.service.envelope import Envelope

    handle, ends = SessionHost.handle, {"kill": signal.SIGKILL, "abort": signal.SIGABRT}

    def take_memory(_envelope):
        taken = []
        while True:
            taken.append(np.ones(64 << 20, dtype=np.uint8))

    def ill_mannered(self, envelope):
        request = envelope.message
        if request.type == "FETCH":
            large = {"step": 0, "points": np.zeros((100_000_000 // 24, 3))}
            return [Envelope(envelope.peer, Fetched(client=request.client, sequence=request.sequence, **large))]
        if request.type == "STATUS" and self.label in ends:
            os.kill(os.getpid(), ends[self.label])
        if request.type == "STATUS" and self.label == "memory":
            return self._answered(envelope, take_memory)
        return handle(self, envelope)

    SessionHost.handle = ill_mannered


# --- many sessions ---


@fault
def one_reply_store_for_all_sessions() -> None:
    import os
    import pickle
    from pathlib import Path

    from mesh_motion_server.session.journal.replies import ReplyTable

    folder, find, store = Path(os.environ["SEEDED_FOLDER"]), ReplyTable.find, ReplyTable.store

    def path(request):
        return folder / f"{request.client.hex()}-{request.sequence}"

    def found(self, request):
        known = find(self, request)
        if known is None and path(request).exists():
            return pickle.loads(path(request).read_bytes())
        return known

    def stored(self, request, reply, nbytes=0):
        store(self, request, reply, nbytes)
        if reply is not None and reply.type == "MOVED":
            part = path(request).with_suffix(f".{os.getpid()}")
            part.write_bytes(pickle.dumps(reply))
            part.replace(path(request))

    ReplyTable.find, ReplyTable.store = found, stored


@fault
def tokens_that_are_not_checked() -> None:
    from mesh_motion_server.session.spec import StoredSpec
    from mesh_motion_server.transport.registry import Registry

    StoredSpec.admits = lambda self, token: True
    Registry.authorised = lambda self, session, token: self.live.get(session)


@fault
def workers_that_stay() -> None:
    from mesh_motion_server.service.dispatch import SessionHost

    SessionHost.closed = property(lambda self: False, lambda self, value: None)


@fault
def the_reference_mesh_after_a_resume() -> None:
    from mesh_motion_server.session import session
    from mesh_motion_server.session.state import CommittedState

    session.restore = lambda journal, _model, mesh, *_, **_named: CommittedState(journal.ledger.step, mesh.points)


# --- soak ---


@fault
def a_list_that_grows_with_each_commit() -> None:
    import os

    from mesh_motion_server.session.session import Session

    commit, kept = Session.commit, []

    def keep(self, *given, **further):
        kept.append(os.urandom(int(os.environ["SEEDED_BYTES"])))
        return commit(self, *given, **further)

    Session.commit = keep


@fault
def a_descriptor_kept_for_each_join() -> None:
    import os

    from mesh_motion_server.service.holders import Holders

    join = Holders.join

    def keep(self, *given):
        os.dup(0)
        join(self, *given)

    Holders.join = keep


@fault
def replies_that_are_never_dropped() -> None:
    from mesh_motion_server.session.journal.replies import ReplyTable

    ReplyTable._shrink = lambda self, newest: None


for name in filter(None, os.environ.get("SEEDED_FAULTS", "").split(",")):
    FAULTS[name]()
