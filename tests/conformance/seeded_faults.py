"""Wrong servers: a real server with one seeded fault, by name, and the cases that must detect it."""

import itertools
import time
from dataclasses import dataclass, replace

import msgpack
import numpy as np
from mesh_motion_numerics.correction.part_of_mesh import Elsewhere
from mesh_motion_numerics.mesh import swept_volumes
from mesh_motion_protocol import codec, digests, header, schema
from mesh_motion_protocol.messages import ErrorReply, Welcome

from mesh_motion_server.service import commands, error_replies, execution, fetch, move
from mesh_motion_server.service.gathering import Gathering
from mesh_motion_server.service.holders import Holders
from mesh_motion_server.session import answers, motions
from mesh_motion_server.session import session as session_module
from mesh_motion_server.session.field_slope import FieldSlope
from mesh_motion_server.session.journal.durability import FullKeeper, ReplayKeeper
from mesh_motion_server.session.journal.journal import Journal
from mesh_motion_server.session.journal.relaxed import RelaxedKeeper
from mesh_motion_server.session.journal.replies import ReplyTable
from mesh_motion_server.session.partitions.meshes import MergedMesh
from mesh_motion_server.session.session import Session
from mesh_motion_server.session.spec import StoredSpec
from mesh_motion_server.transport import gateway, worker
from mesh_motion_server.transport.gateway import Gateway
from mesh_motion_server.transport.registry import Registry, RequestBook


@dataclass(frozen=True)
class Fault:
    """One thing broken.

    ``seed``: takes pytest's monkeypatch; ``caught``: cases, or beginnings of ids, that must fail, each at least once.
    """

    name: str
    seed: object
    caught: tuple[str, ...]


def listed_in(faults):
    """Return a decorator, with the cases that must fail, which adds what seeds a fault to a list."""

    def fault(*caught):
        def register(seed):
            faults.append(Fault(seed.__name__.replace("_", " "), seed, caught))
            return seed

        return register

    return fault


def nothing(*_, **__):
    return None


def replacing(*changes):
    """Seed a fault by changes: an object, its attribute, and the wrong value."""

    def seed(patch):
        for change in changes:
            patch.setattr(*change)

    return seed


def around(owner, name, wrong):
    """As ``replacing``; the wrong function gets the right one as its first argument."""
    right = getattr(owner, name)
    return replacing((owner, name, lambda *given, **named: wrong(right, *given, **named)))


_COUNT = itertools.count(1)
#: Faults of one wrong function; longer ones follow.
FAULTS = [
    # exactly once
    Fault("forgets what was executed", replacing((ReplyTable, "find", nothing)),
          ("10.1-repeat-of-MOVE", "10.1-MOVE-counts-once", "10.1-UPLOAD-appends-once", "10.1-repeat-of-COMMIT")),
    Fault("takes another content for a repeat", replacing((ReplyTable, "_same", lambda self, known, request: known)),
          ("10.2-MOVE-other-displacement", "10.2-MOVE-one-bit-of-it", "10.2-COMMIT-then-MOVE")),
    Fault("takes memory for content", replacing((digests, "_NO_CONTENT", {"epoch"})), ("22.7-memory-is-no-content",)),
    Fault("passes over arrays in the content", replacing((digests, "_blocks", lambda array, dtype: [])),
          ("10.2-MOVE-other-displacement", "10.2-MOVE-one-bit-of-it")),
    Fault("keeps fewer replies than it says",
          around(ReplyTable, "__init__", lambda init, self, per_client, *rest: init(self, 2, *rest)),
          ("6-more-replies-than-stored",)),
    # who may
    Fault("lets fenced holders go on",
          around(Holders, "check_address",
                 lambda check, self, request: check(self, replace(request, epoch=self._session.epoch))),
          ("11.3-MOVE-of-an-older-epoch", "11.3-STATUS-of-an-older-epoch", "17-ABORTED.FENCED")),
    Fault("raises the epoch twice",
          around(Session, "resume", lambda resume, self: resume(self) and resume(self)),
          ("11.3-RESUME-raises-the-epoch",)),
    Fault("takes requests of strangers", replacing((Holders, "check_joined", nothing)),
          ("7-STATUS-before-JOIN", "7-MOVE-before-JOIN", "9.1-other-partitions-connection")),
    Fault("takes every token at JOIN", replacing((StoredSpec, "admits", lambda self, token: True)),
          ("11.8-JOIN-with-a-wrong-token",)),
    Fault("takes every token at PROBE",
          replacing((Registry, "authorised", lambda self, session, token: self.live.get(session))),
          ("11.8-PROBE-wrong-token",)),
    # durability
    Fault("never stores a relaxed commit",
          replacing((RelaxedKeeper, "_run", nothing), (RelaxedKeeper, "catch_up", nothing)),
          ("21.2-durable-step-relaxed", "21.3-CLOSE-and-RESUME-relaxed")),
    Fault("logs no commit", replacing((ReplayKeeper, "commit", nothing), (ReplayKeeper, "rest", nothing)),
          ("21.3-CLOSE-and-RESUME-replay",)),
    Fault("calls an older step durable", replacing((FullKeeper, "durable_after", lambda self, step: step - 1)),
          ("21.2-durable-step-full", "21.2-durable-step-replay")),
    # states and results
    Fault("does not look at the step", replacing((Session, "require_next_step", nothing)),
          ("12-MOVE-step-next-but-one", "12-ROLLBACK-step-committed-already", "7.2-MOVE-of-another-step")),
    Fault("takes any quality", replacing((session_module, "refuse_unacceptable", lambda *_: [])),
          ("23.8-bad-quality-is-refused",)),
    Fault("corrects nothing", replacing((session_module, "is_good", lambda method, quality: True)),
          ("23.7-bad-cells-are-corrected", "23.7-larger-region")),
    Fault("frees nodes whose cells it has not", replacing((Elsewhere, "require_here", nothing)),
          ("23.7-larger-region",)),
    Fault("lets every client judge", replacing((Session, "require_client_evaluation", nothing)),
          ("8-JUDGE-where-the-server-judges",)),
    Fault("answers the weights of some nodes twice",
          around(MergedMesh, "scatter_moving", lambda honest, *given: [2 * own for own in honest(*given)]),
          ("24.1-transpose",)),
    Fault("answers the first vector only",
          around(Session, "_by_vector", lambda honest, self, given, apply: honest(self, given[:, :2] * 2, apply)),
          ("24.1-moving-nodes", "24.3-columns")),
    Fault("differentiates whatever there is",
          replacing((Session, "require_slope", lambda self, operation, what: self.admit(operation)),
                    (Session, "_points_of", lambda self, what: self.coordinates("committed"))),
          ("24.2-no-trial", "24.6-no-derivative")),
    Fault("takes any time", replacing((Session, "require_later", nothing)), ("25.1-times-grow",)),
    Fault("does not ask for times",
          replacing((Session, "require_time_of_commit", nothing), (Session, "require_velocity", nothing)),
          ("25.3-levels-take-a-time", "25.4-missing")),
    Fault("sweeps all faces of the cells in any case",
          around(Session, "swept", lambda honest, self, partition, faces: honest(self, partition, None)),
          ("25.7-given-faces",)),
    Fault("sweeps with the areas of the new mesh",
          around(swept_volumes, "_swept", lambda honest, before, after: honest(after, 2 * after - before)),
          ("25.5-conservation",)),
    Fault("answers the velocities of a way twice as long",
          around(Session, "_velocities", lambda honest, *given: [2 * own for own in honest(*given)]),
          ("25.2-tangent",)),
    Fault("answers the field at rest", replacing((Session, "field", lambda self, frame: self._built.field)),
          ("23.9-field-survives",)),
    Fault("digests in the wrong byte order",
          around(digests, "frames_of", lambda honest, array: honest(np.ascontiguousarray(array).byteswap())),
          ("16-one-move", "16-after-a-rollback")),
    # partitions
    Fault("does not compare what partitions ask for", replacing((Gathering, "check_agreement", nothing)),
          ("9.2-MOVE-and-COMMIT", "9.2-two-frames", "9.2-two-numbers-of-vectors")),
    # the wire
    Fault("does not bound the header", replacing((header, "_admitted", lambda items, depth, too_many: items)),
          ("4.9-13-levels", "4.9-257-items-in-a-map")),
    Fault("does not look at ranges", replacing((schema, "_check_marker", nothing)),
          ("4-client-of-15-bytes", "12-JOIN-token-of-31-bytes", "12-OPEN-dimension-above",
           "12-HELLO-agent-of-257-bytes")),
    Fault("forgets the id of a refused request", replacing((codec, "_request_id", lambda header: (bytes(16), 0))),
          ("4-id-with-a-wrong-type", "4-id-with-an-unknown-field")),
    # errors, versions
    Fault("gives no hint",
          replacing((error_replies, "ErrorReply", lambda **fields: ErrorReply(**(fields | {"hint": ""})))),
          ("17-FAILED_PRECONDITION.STEP", "17-NOT_FOUND")),
    Fault("calls every error retryable",
          replacing((error_replies, "ErrorReply", lambda **fields: ErrorReply(**(fields | {"retryable": True})))),
          ("17-FAILED_PRECONDITION.STEP", "17-NOT_FOUND")),
    Fault("agrees to every minor version",
          replacing((gateway, "Welcome", lambda **fields: Welcome(**(fields | {"version": [1, 7]})))),
          ("18.1-a-later-minor", "18.1-later-and-ours")),
    Fault("takes control requests at a session",
          replacing((worker, "unexpected", lambda request, *_, **__: worker.Pong(client=request.client, sequence=1))),
          ("2.2-OPEN-at-data",)),
    # by a wrong function around the right one
    Fault("takes the epoch for content",
          around(commands, "request_digest",
                 lambda honest, message: honest(message) + bytes([getattr(message, "epoch", 0) % 256])),
          ("10.2-epoch-is-no-content",)),
    Fault("opens again for each repeat",
          around(RequestBook, "enter", lambda enter, self, *asked: (self._users.clear(), enter(self, *asked))[1]),
          ("10.6-repeat-of-OPEN", "10.6-repeat-of-RESUME")),
    Fault("drops the trial for a derivative",
          around(Session, "cotangent", lambda honest, self, *given: (honest(self, *given), self.rollback())[0]),
          ("24.5-nothing-changes",)),
    Fault("answers another field",
          around(FieldSlope, "tangent",
                 lambda honest, *given: replace(found := honest(*given), coefficients=2 * found.coefficients)),
          ("24.7-field-of-the-tangent", "24.8-counted-coefficients")),
    Fault("leaves out what other nodes count",
          around(FieldSlope, "cotangent",
                 lambda honest, self, given: honest(self, replace(given, coefficients=0 * given.coefficients))),
          ("24.8-counted-coefficients",)),
    Fault("takes the first step for every step",
          around(answers, "scheme_velocity",
                 lambda honest, *given: honest(*given[:3], replace(given[3], time=given[4] - 0.25), given[4])),
          ("25.2-bdf1", "25.3-bdf2-survives")),
    Fault("drops the trial when it refuses",
          around(Session, "require_next_step",
                 lambda check, self, step: (step != self.step + 1 and self.iteration and self.rollback(),
                                            check(self, step))[1]),
          ("7.2-MOVE-of-another-step", "7.2-trial-after-a-refused-move-commits")),
    Fault("computes a little differently each time",
          around(MergedMesh, "scatter_differences",
                 lambda honest, *given: [own + next(_COUNT) * 1e-17 for own in honest(*given)]),
          ("7.1-same-move-same-bytes",)),
    Fault("answers the connection that asked first",
          around(execution.Execution, "_gather",
                 lambda gather, self, arrival, command: [] if self._gathering and self._gathering.repeats(arrival)
                 else gather(self, arrival, command)),
          ("2.5-repeated-request-is-answered-where-it-was-repeated-last",)),
    Fault("takes the last of two keys",
          replacing((header, "_map", lambda reader, frame, depth: {
              reader.unpack(): header._value(reader, frame, depth + 1) for _ in range(reader.read_map_header())})),
          ("4.1-key-twice-in-the-header", "4.1-key-twice-in-fields")),
    Fault("takes true for 1",
          around(schema, "_check_kind", lambda check, value, kind, finite:
                 check(int(value) if isinstance(value, bool) and kind is int else value, kind, finite)),
          ("12-MOVE-step-is-bool", "12-OPEN-partitions-is-bool")),
    Fault("answers twice", around(Gateway, "_reply", lambda reply, *given: (reply(*given), reply(*given))[1]),
          ("2.5-one-reply-to-each-of-many",)),
    Fault("boots again for every client",
          replacing((gateway, "Welcome", lambda **fields:
                     Welcome(**(fields | {"boot": next(_COUNT).to_bytes(16, "big")})))),
          ("18.4-boot-is-one",)),
    Fault("leaves a limit out",
          replacing((gateway, "Welcome", lambda limits, **fields:
                     Welcome(limits={name: value for name, value in limits.items() if name != "drain_ms"}, **fields))),
          ("6-drain_ms-in-WELCOME",)),
]  # fmt: skip
fault = listed_in(FAULTS)


# --- exactly once ---


@fault("10.5-error-is-not-remembered")
def remembers_errors_as_executed(patch):
    def refuse(self, request_id, reply, nbytes=0, store=ReplyTable.store):
        if reply is not None:
            store(self, request_id, reply, nbytes)
            return
        store(self, replace(request_id, content=b"failed"), None)

    patch.setattr(ReplyTable, "store", refuse)


# --- durability ---


@fault("21.3-CLOSE-and-RESUME-relaxed")
def closes_before_the_disk_has_it(patch):
    store = Journal.store

    def slow(self, *given):
        time.sleep(0.1 * (self.ledger.foundation.durability == "relaxed"))
        store(self, *given)

    patch.setattr(Journal, "store", slow)
    patch.setattr(RelaxedKeeper, "catch_up", nothing)


@fault("21.5-step-after-the-next-relaxed")
def does_not_report_lost_steps(patch):
    patch.setattr(Session, "_reopened", property(lambda self: False, nothing), raising=False)


# --- states and results ---


@fault("25.3-bdf2-survives", "25.3-bossak-survives")
def resumes_without_earlier_levels(patch):
    resume = Session.resume

    def forgetful(self):
        found, committed = resume(self), self._committed_state
        self._swap(committed=replace(committed, level=replace(committed.level, arrays=())))
        return found

    patch.setattr(Session, "resume", forgetful)


@fault("7.5-committed-frame", "7.5-reference-frame")
def rounds_the_displacement(patch):
    run = move.run

    def rounded(*given):
        return [replace(m, displacement=m.displacement.astype("<f4").astype("<f8")) for m in run(*given)]

    command = execution.COMMANDS["MOVE"]
    patch.setitem(execution.COMMANDS, "MOVE", replace(command, run=rounded))


@fault("12-FETCHED-step-with-the-reference-mesh")
def gives_step_0_with_the_reference_mesh(patch):
    answer = fetch.answer

    def wrong(session, request):
        reply = answer(session, request)
        return replace(reply, step=0) if request.what == "reference" else reply

    patch.setitem(execution.COMMANDS, "FETCH", replace(execution.COMMANDS["FETCH"], answer=wrong))


# --- the wire ---


@fault("4.3-fixext-4-in-a-map", "4.3-ext-8-in-a-map")
def admits_extension_types(patch):
    patch.setattr(header, "_no_extension", lambda code, data: code)
    unpacker = msgpack.Unpacker
    patch.setattr(header.msgpack, "Unpacker", lambda *file, **given: unpacker(*file, **(given | {"max_ext_len": 64})))


@fault("4.8-nil-behind-the-map", "4.8-itself-behind-the-map")
def passes_over_what_follows_the_map(patch):
    def first(frame, unpack=codec.unpack):
        reader = msgpack.Unpacker()
        reader.feed(frame)
        reader.skip()
        return unpack(frame[: reader.tell()])

    patch.setattr(codec, "unpack", first)


@fault("5.3-MOVE-a-byte-more", "5.3-two-chunks-cut-elsewhere")
def does_not_measure_frames(patch):
    def filled(declared, frames, *_, **__):
        size = int(np.prod(declared["shape"])) * int(declared["dtype"][-1])
        raw = b"".join(map(bytes, frames))[:size].ljust(size, b"\0")
        wide = declared["dtype"].replace("4", "8")
        return np.frombuffer(raw, dtype=declared["dtype"]).reshape(declared["shape"]).astype(wide)

    patch.setattr(codec, "array_of", filled)


@fault("5.6-MOVE-nan-<f8", "5.6-MOVE-inf-<f8")
def moves_nodes_to_nowhere(patch):
    check = move._check_rows

    def blind(session, request):
        check(session, replace(request, displacement=np.nan_to_num(request.displacement, posinf=0, neginf=0)))

    patch.setattr(move, "_check_rows", blind)
    patch.setattr(motions, "_check_places", lambda targets, mesh: None)  # would see it a line later
