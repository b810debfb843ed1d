"""A session that computes nothing, a replacement of the real one for the tests of transport.

Its state is one small file per session. Labels ask for trouble: ``slow`` holds MOVE until a file named ``go`` lies in
the state folder, ``crash`` ends the process in MOVE, ``broken`` fails to open, ``bad-reply`` answers with a message
that cannot be encoded, ``lingers`` closes its line to the supervisor and does not end.
"""

import gc
import json
import os
import time
from types import SimpleNamespace

import numpy as np
from mesh_motion_protocol import messages as m
from mesh_motion_protocol.errors import InvalidInput, SessionError

from mesh_motion_server.service.envelope import Envelope
from mesh_motion_server.transport import template
from mesh_motion_server.transport.channel import Channel


class SessionStore:
    def __init__(self, root, identity=(0, 0)):
        self.root, self.identity = root, identity
        root.mkdir(parents=True, exist_ok=True)

    def sweep(self):
        return []

    def path(self, session):
        return self.root / f"{session}.json"

    def read(self, session):
        try:
            return SimpleNamespace(**json.loads(self.path(session).read_text()))
        except OSError:
            raise SessionError("no such session", code="NOT_FOUND") from None

    def write(self, session, **values):
        part = self.root / f"{session}.part"
        part.write_text(json.dumps({"session": session, **values}))
        part.replace(self.path(session))

    def names(self):
        return sorted(path.stem for path in self.root.glob("*.json"))

    def describe(self, session):
        return self.read(session)

    def owner(self, session):
        return self.read(session).owner if self.path(session).exists() else None

    owner_listed = owner

    def check_token(self, session, token):
        if self.read(session).token != token.hex():
            raise SessionError("no such session", code="NOT_FOUND")


class SessionHost:
    def __init__(self, store, **values):
        self.store, self.values = store, values
        self.session, self.label, self.epoch, self.step = (values[k] for k in ("session", "label", "epoch", "step"))
        self.partitions = values["partitions"]
        self.state, self.closed, self.next_deadline = "READY", False, None
        self.moves = 0
        self.save()

    @classmethod
    def create(cls, spec, store, *, limits):
        if spec.label == "broken":
            raise InvalidInput("this one does not open", hint="it is a test")
        return cls(
            store,
            session=spec.session,
            token=spec.token.hex(),
            label=spec.label,
            owner=spec.owner,
            epoch=1,
            step=0,
            partitions=spec.partitions,
            state="READY",
            dimension=spec.dimension,
        )

    @classmethod
    def resume(cls, session, token, store, *, limits, progress):
        store.check_token(session, token)
        values = vars(store.read(session))
        return cls(store, **(values | {"epoch": values["epoch"] + 1}))

    def save(self):
        self.store.write(**(self.values | {"epoch": self.epoch, "step": self.step}))

    def handle(self, envelope):
        request = envelope.message
        identity = {"client": request.client, "sequence": request.sequence}
        if request.epoch != self.epoch:
            reply = self.refuse(request, identity, "ABORTED.FENCED", "fenced")
        else:
            answers = {
                "JOIN": self.join,
                "STATUS": self.status,
                "MOVE": self.move,
                "COMMIT": self.commit,
                "CLOSE": self.close_session,
            }
            reply = answers.get(request.type, self.refuse)(request, identity)
        return [Envelope(envelope.peer, reply)]

    def oversee(self, envelope):
        return self.handle(envelope)

    def join(self, request, identity):
        return m.Joined(**identity, state=self.state, step=self.step, iteration=0)

    def refuse(self, request, identity, code="FAILED_PRECONDITION.STATE", message="not here"):
        more = {"hint": "", "retryable": False, "state": self.state, "details": {}}
        return m.ErrorReply(**identity, code=code, message=message, **more)

    def status(self, request, identity):
        return m.StatusReport(
            **identity,
            state=self.state,
            step=self.step,
            iteration=self.moves,
            waiting_for=[],
            report={"moves": self.moves, "pid": os.getpid()},
        )

    def move(self, request, identity):
        self.moves += 1
        (self.store.root / f"moving-{self.session}").touch()
        if self.label == "crash":
            os.abort()
        while self.label == "slow" and not (self.store.root / "go").exists():
            time.sleep(0.01)
        quality = {"bad": object()} if self.label == "bad-reply" else {}
        return m.Moved(
            **identity,
            step=request.step,
            iteration=self.moves,
            quality=quality,
            correction={},
            caches={},
            seconds={},
            warnings=[],
            displacement=2 * request.displacement,
            enrichment_points=np.empty((0, 2)),
        )

    def commit(self, request, identity):
        self.step = request.step
        self.save()
        return m.Committed(**identity, step=self.step, durable_step=self.step, digest=b"d" * 32, quality={})

    def close_session(self, request, identity):
        self.closed, self.state = True, "CLOSED"
        if request.outcome == "discard":
            self.store.path(self.session).unlink()
        return m.Closed(**identity, step=self.step)

    def expire(self, now):
        return []

    def suspend(self):
        self.state = "SUSPENDED"
        return []

    def reclaim(self, token):
        self.epoch += 1
        self.save()
        return self.epoch

    def close(self):
        (self.store.root / f"closed-{self.session}").touch()
        if self.label == "lingers":
            (line,) = (held for held in gc.get_objects() if isinstance(held, Channel))
            line.close()
            (self.store.root / f"lingers-{self.session}").touch()
            time.sleep(3600)


def main(channel, level):
    return template.main(channel, level, lambda: (SessionHost, SessionStore))
