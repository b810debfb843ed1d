"""Plays actions on a server and on the model of a session side by side, and compares all that can be seen.

After each request it compares the replies, their receivers, types, codes and fields, and the state of the session; a
refused request must change neither state nor files. At the end power is lost, another server starts, and every
partition fetches the committed state.
"""

from dataclasses import replace
from random import Random
from typing import Any

from mesh_motion_protocol import messages as wire
from mesh_motion_protocol.codec import decode, encode

from mesh_motion_server.service.envelope import Envelope
from tests.faults.accidents import ACCIDENTS, Accident, Stall, ask_inside, refused_resume
from tests.faults.actions import ALL, Action
from tests.faults.check import require
from tests.faults.expected import Answer, Asked, compare, compare_all
from tests.faults.in_process import InProcessServer, standing_of
from tests.faults.in_process_parts import Replies
from tests.faults.ranks import Ranks
from tests.faults.session_model import SessionModel
from tests.faults.session_table import ADMITTED

#: Requests that wait until all commits are durable, or need the disk for something else.
_WAITED_FOR = ("OPEN", "RESUME", "CLOSE", "LEASE_END", "STOP", "BREAK", "HEAL")
#: Requests that a worker may get after its end: it is still in its state, and knows its epoch, but serves no client.
_ASKED_OF_THE_ENDED = ("", "epoch", "step", "reference", "discard")

#: After these TANGENT and COTANGENT are played, which change nothing: no draw, so the lives are those without them.
_DIFFERENTIATED = ("MOVE", "COMMIT", "ROLLBACK", "JOIN")


class Played:
    """A server, a session on it, and its model.

    ``kept``: the server's ``stored_replies``.
    """

    def __init__(self, server: InProcessServer, ranks: Ranks, kept: int) -> None:
        self.server = server
        self.operations = 0
        self.visited: set[tuple[str, str]] = set()
        self._ranks = ranks
        self._kept = kept
        self._resume: tuple[Asked, Any] | None = None
        self._stall: Stall | None = None
        self.model = self._open()

    @property
    def partitions(self) -> int:
        return len(self._ranks)

    def is_disconnected(self) -> bool:
        """Whether a partition's newest connection has not joined."""
        joined = [self.model.joined.get(p) == self._ranks.peer(p) for p in range(self.partitions)]
        return self.model.worker == "alive" and not all(joined)

    # --- actions -----------------------------------------------------------------------------------------------------

    def act(self, action: Action) -> bool:
        """Play the action, if it is possible now.

        Raises BrokenPromise if server and model differ.
        """
        if action.partition == ALL:
            each = [self.act(action._replace(partition=p)) for p in range(self.partitions)]
            return all(each)
        action = action._replace(partition=action.partition % self.partitions)
        try:
            if action.operation in _WAITED_FOR:
                self._end_stall(killed=False)
            done = getattr(self, f"_on_{action.operation.lower()}", self._on_request)(action)
            self._settle()
            self._compare_standing()
            if done and action.operation in _DIFFERENTIATED:
                self._differentiate()
        except Exception as error:
            error.add_note(f"(at {action}; the model is in {self.model.state or 'no process'}, step {self.model.step})")
            raise
        self.operations += done
        return bool(done)

    def finish(self) -> None:
        """Cut the power and start a server again; the committed state must be there for every partition."""
        self.act(Action("HEAL"))
        self.act(Action("POWER"))
        for kind in ("RESUME", "JOIN", "FETCH", "STATUS"):
            self.act(Action(kind, ALL if kind != "RESUME" else 0))

    def _open(self) -> SessionModel:
        about = {"partitions": self.partitions, "durability": self._ranks.level}
        asked = self._ranks.control(wire.Open, Action("OPEN"), dimension=2, **about)
        opened = self._control(asked)
        require(opened.type == "OPENED" and opened.epoch == 1, f"OPEN was answered {opened}")
        self._resume = None
        model = SessionModel(opened, self._ranks.shares(), self._kept, self._ranks.level)
        model.visited = self.visited
        return model

    def _on_open(self, action: Action) -> bool:
        """After the end of this session open another one; a refused OPEN does not touch this session."""
        if action.twist:
            return self._refused_open(action)
        if not self.model.gone or self.model.disk_broken:
            return False
        self.model = self._open()
        for partition in range(self.partitions):
            self._ranks.reconnect(partition)
        return True

    def _refused_open(self, action: Action) -> bool:
        before = self._standing()
        asked = self._ranks.control(wire.Open, action, dimension=2)
        reply, _ = self._control_with(asked, "disk" if action.twist == "disk" else "", 0)
        code = {"disk": "RESOURCE_EXHAUSTED.DISK", "unlisted": "UNAUTHENTICATED"}.get(action.twist, "PERMISSION_DENIED")
        require(getattr(reply, "code", "") == code, f"OPEN was answered {reply}")
        require(self._standing() == before, "an OPEN has changed another session")
        return True

    def _on_resume(self, action: Action) -> bool:
        if action.twist == "host":
            return self._resume_host()
        if action.twist in ("again", "other"):
            return self._repeat_resume(other=action.twist == "other")
        asked = self._ranks.about(wire.Resume, action, self.model)
        reply, fired = self._control_with(asked, "disk" if action.twist == "disk" else "", action.value)
        compare(self.model.gate_control(asked) or self.model.resume(asked, fired), reply)
        if reply.type == "RESUMED":
            self._resume = asked, reply
        return True

    def _resume_host(self) -> bool:
        """Send RESUME to the host of a worker that refuses it."""
        host = self._host()
        if host is None or "RESUME" in ADMITTED[self.model.state].split():
            return False
        self.model.admits("RESUME")
        refused_resume(host, self.model)
        return True

    def _repeat_resume(self, *, other: bool) -> bool:
        if self._resume is None:
            return False
        asked, first = self._resume
        reply = self._control(replace(asked, message=replace(asked.message, session="f" * 32)) if other else asked)
        if other:
            require(getattr(reply, "code", "") == "ABORTED.CONFLICT", f"another RESUME was answered {reply}")
        else:
            require(vars(reply) == vars(first), f"a RESUME was answered {first}, then {reply}")
        return True

    def _on_probe(self, action: Action) -> bool:
        asked = self._ranks.about(wire.Probe, action, self.model)
        reply = self._control(asked)
        known = self.model.epoch if self.model.worker != "none" else 0
        perhaps = ("NOT_FOUND",) if self.model.worker == "none" and None in self.model.may_be_found else ()
        right = Answer(asked, "PROBED", perhaps, {"worker": self.model.worker, "epoch": known})
        compare(self.model.gate_control(asked) or right, reply)
        return True

    def _on_list(self, action: Action) -> bool:
        asked = self._ranks.control(wire.List, action)
        reply = self._control(asked)
        if asked.user == "unlisted":
            require(getattr(reply, "code", "") == "UNAUTHENTICATED", f"LIST was answered {reply}")
            return True
        entries = {entry["session"]: entry for entry in reply.sessions}
        entry = entries.get(self.model.session)
        if asked.user == "stranger" or self.model.gone:
            require(entry is None, f"LIST shows {entry}")
        elif self.model.worker == "alive":
            require(entry and (entry["state"], entry["step"]) == (self.model.state, self.model.step), f"LIST: {entry}")
        elif None not in self.model.may_be_found:
            stored = {found.step for found in self.model.may_be_found if found}
            require(entry and entry["step"] in stored, f"LIST: {entry}, stored: step {stored}")
        return True

    def _on_lease_end(self, _action: Action) -> bool:
        if self.model.state == "CLOSED" and self._host() is not None:
            self.model.admits("LEASE_END")
            return bool(self._host().suspend() == [])
        if self.model.worker != "alive":
            return False
        compare_all(self.model.lease_ends(), self.server.end_lease(self.model.session))
        return True

    def _on_wait(self, _action: Action) -> bool:
        if not self.model.waiting:
            return False
        compare_all(self.model.time_out(), self.server.wait(self.model.session, 1e4))
        return True

    def _on_crash(self, _action: Action) -> bool:
        if self.model.worker != "alive":
            return False
        self._end_stall(killed=True)
        self.model.crashes("dead")
        self.server.kill(self.model.session)
        return True

    def _on_power(self, action: Action) -> bool:
        if self.model.worker == "alive" or self.model.state == "CLOSED":
            self.model.crashes("none")
        self.model.worker = "none"
        self._end_stall(killed=True)
        self.server.halt()
        self.server.files.lose_power(Random(action.value))
        self._start_over()
        return True

    def _on_stop(self, _action: Action) -> bool:
        if self.model.worker == "alive":
            self.model.ends()
        self.model.worker = "none"
        self.server.stop()
        self._resume = None
        return True

    def _on_break(self, _action: Action) -> bool:
        self.server.files.before = Accident(ACCIDENTS["disk"], 0)
        self.model.disk_broken = True
        return True

    def _on_stall(self, _action: Action) -> bool:
        """Only a session that does not wait for its disk continues."""
        if self.model.level != "relaxed" or self.model.worker != "alive" or self.model.disk_broken or self._stall:
            return False
        self.server.files.before = self._stall = Stall()
        return True

    def _end_stall(self, *, killed: bool) -> None:
        if self._stall is not None:
            stall, self._stall, self.server.files.before = self._stall, None, None
            stall.end(killed=killed)
            if not killed:
                self._settle()

    def _settle(self) -> None:
        if self._stall is None:
            self.server.settle(self.model.session)

    def _on_heal(self, _action: Action) -> bool:
        self.server.files.before = None
        self.model.disk_broken = False
        return True

    def _on_reconnect(self, action: Action) -> bool:
        self._ranks.reconnect(action.partition)
        return True

    def _start_over(self) -> None:
        self._on_heal(Action("HEAL"))
        self.server.crash()
        self._resume = None

    # --- derivatives -------------------------------------------------------------------------------------------------

    def _differentiate(self) -> None:
        """Send TANGENT and COTANGENT of all partitions: one is the transpose of the other, and the session does not
        change.
        """
        model = self.model
        idle = model.worker == "alive" and model.state in ("READY", "TRIAL") and not model.waiting
        if not idle or self.is_disconnected():
            return
        before, touched = self._standing(), len(self.server.files.operations)
        sums = [self._derivative(kind) for kind in (wire.Tangent, wire.Cotangent)]
        require(abs(sums[0] - sums[1]) < 1e-9 * (1.0 + abs(sums[0])), f"w · J v is {sums[0]}, Jᵀ w · v {sums[1]}")
        require(self._standing() == before, "a derivative has changed the session")
        require(touched == len(self.server.files.operations), "a derivative has changed a file")

    def _derivative(self, kind: Any) -> float:
        """The inner product of the result with the other request's vectors."""
        asked = [self._ranks.derivative(kind, p, self.model) for p in range(self.partitions)]
        replies = dict(reply for each in asked for reply in self._data(each, None))
        found = [decode(replies[self._ranks.peer(p)]) for p in range(len(replies))]
        types = {reply.type for reply in found}
        require(len(found) == self.partitions and types == {f"{kind.type}_FOUND"}, f"{kind.type} was answered {found}")
        return self._ranks.paired(found)

    # --- requests to the data endpoint -------------------------------------------------------------------------------

    def _on_request(self, action: Action) -> bool:
        host, closed = self._host(), self.model.state == "CLOSED"
        if host is None or (closed and action.twist not in _ASKED_OF_THE_ENDED):
            return False
        if (self.model.disk_broken or self._stall) and action.twist in (*ACCIDENTS, "inside"):
            return False
        if self.model.level == "relaxed" and action.twist in ("defect", "inside"):
            return False  # nothing is written while it commits
        asked = self._ranks.request(action, self.model)
        return asked is not None and self._ask(asked, action, host if closed else None)

    def _ask(self, asked: Asked, action: Action, ended: Any) -> bool:
        """Send the request, ask the model, and compare; ``ended`` is the host of an ended worker."""
        before, touched = self._standing(), len(self.server.files.operations)
        replies, fired = self._data_with(asked, action, ended)
        answers = self.model.ask(asked, fired if asked.kind in ("BUILD", "COMMIT") else "")
        if fired in ("crash", "power"):
            self._end_by(fired, action.value)
            return True
        compare_all(answers, replies)
        if all(answer.is_harmless for answer in answers):
            require(self._standing() == before, f"a refused {asked.kind} has changed the session")
            require(touched == len(self.server.files.operations), f"a refused {asked.kind} has changed a file")
        return True

    def _data_with(self, asked: Asked, action: Action, ended: Any) -> tuple[Replies, str]:
        """Send the request with the accident of its twist; return the replies, and whether the accident happened."""
        if action.twist == "inside":
            commit = asked, action.value
            inside = Accident(
                lambda: ask_inside(self._host(), self.model, self._ranks, *commit), action.value % 3, once=True
            )
            return inside.over(self.server.files, lambda: self._data(asked, ended)), ""
        if action.twist not in ACCIDENTS:
            return self._data(asked, ended), "disk" if self.model.disk_broken else ""
        accident = Accident(ACCIDENTS[action.twist], action.value)
        replies = accident.over(self.server.files, lambda: self._settled_data(asked, ended))
        return replies, action.twist if accident.fired else ""

    def _end_by(self, accident: str, seed: int) -> None:
        """End all processes in the middle of their work, and start others."""
        self.model.crashes("none")
        self.server.halt()
        if accident == "power":
            self.server.files.lose_power(Random(seed))
        self._start_over()

    def _host(self) -> Any:
        """The host that would answer: the worker's, or that of an ended worker."""
        if self.model.worker == "alive":
            return self.server.host(self.model.session)
        return self.server.ended.get(self.model.session) if self.model.state == "CLOSED" else None

    def _settled_data(self, asked: Asked, ended: Any) -> Replies:
        replies = self._data(asked, ended)
        self._settle()
        return replies

    def _data(self, asked: Asked, ended: Any) -> Replies:
        if ended is not None:
            envelopes = ended.handle(Envelope(asked.peer, asked.message))
            return [(e.peer, [bytes(frame) for frame in encode(e.message)]) for e in envelopes]
        return self.server.data(self.model.session, asked.user, asked.peer, encode(asked.message))

    # --- the control endpoint ----------------------------------------------------------------------------------------

    def _control(self, asked: Asked) -> Any:
        replies = self.server.control(asked.user, asked.peer, encode(asked.message))
        require(len(replies) == 1, f"{asked.kind} has {len(replies)} replies")
        return decode(replies[0][1])

    def _control_with(self, asked: Asked, accident: str, at: int) -> tuple[Any, str]:
        """Send a request during an accident; return the reply, and the accident if it happened."""
        if not accident or self.model.disk_broken:
            return self._control(asked), "disk" if self.model.disk_broken else ""
        armed = Accident(ACCIDENTS[accident], at)
        reply = armed.over(self.server.files, lambda: self._control(asked))
        return reply, accident if armed.fired else ""

    # --- comparison --------------------------------------------------------------------------------------------------

    def _standing(self) -> Any:
        host = self._host()
        return standing_of(host) if host is not None else None

    def _compare_standing(self) -> None:
        """State of the session according to the server."""
        model, host = self.model, self._host()
        if host is None:
            return
        got = host.state, host.step, host.epoch
        require(got == (model.state, model.step, model.epoch),
                f"the server is in {got}, the model in {(model.state, model.step, model.epoch)}")  # fmt: skip
        require(host.iteration == model.iteration, f"iteration {host.iteration}, in the model {model.iteration}")
        missing = host._execution.missing
        require(missing == model.missing, f"partitions {missing} are waited for, in the model {model.missing}")
