"""Control requests OPEN, RESUME, LIST, PROBE, and the workers' reports about the start, life and end of sessions.

No sockets and no processes: the supervisor passes in the functions that start workers and send replies.
"""

import contextlib
import secrets
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from mesh_motion_protocol.codec import decode
from mesh_motion_protocol.errors import DataLoss, MeshMotionError, ResourceExhausted, SessionError
from mesh_motion_protocol.messages import List, Listed, Message, Open, Opened, Probe, Probed, Resume, Resumed

from mesh_motion_server.failpoints import failpoint
from mesh_motion_server.operation.disk_watch import DiskWatch
from mesh_motion_server.operation.tally import TALLY
from mesh_motion_server.security.allow_list import Access
from mesh_motion_server.security.authorisation import Verdict, decide, not_found, refusal
from mesh_motion_server.service.error_replies import error_reply
from mesh_motion_server.settings import ServerSettings
from mesh_motion_server.transport.late_replies import LateReplies
from mesh_motion_server.transport.opening import check_open, check_place, check_room, gives_way
from mesh_motion_server.transport.processes import Child
from mesh_motion_server.transport.registry import Asked, Live, Registry, RequestBook, fit
from mesh_motion_server.transport.replies import encoded
from mesh_motion_server.transport.telemetry import log

#: A worker must import, read its journal and factorize within this time, seconds; it gets the same time again for each
#: step that it recomputes.
_START_SECONDS = 600.0
#: A live worker that computes for the old holder has this long, seconds, to accept a new one. Then it is killed,
#: because the trial that it computes is lost anyway, and another worker resumes from the journal. A worker that already
#: knows the new holder only writes, possibly commits that were answered: it has as long as a drain.
_RECLAIM_SECONDS = 5.0
#: Largest number of RESUMEs that wait for one session; each fences the previous one.
_WAITING = 32
_SEEN = (Verdict.USE, Verdict.OVERSEE)


class Control:
    """Answers control requests and follows the workers.

    Parameters
    ----------
    start : callable
        Order for a worker → the child process that executes it.
    send : callable
        Peer and frame → sent to the gateway.
    access : Access
        The roles of each user.
    disk : DiskWatch
        The disk of the store: while it does not answer, the store is not read, because this thread would block.
    """

    def __init__(
        self,
        registry: Registry,
        settings: ServerSettings,
        start: Callable[[dict[str, Any]], Child],
        send: Callable[[bytes, bytes], None],
        access: Access,
        disk: DiskWatch,
    ) -> None:
        self.registry = registry
        self.draining = False
        self._settings = settings
        self._start = start
        self._send = send
        self._access = access
        self._disk = disk
        self._book = RequestBook()
        self._later = LateReplies(send)

    # --- requests ----------------------------------------------------------------------------------------------------

    def request(self, peer: bytes, user: str, frame: bytes) -> None:
        """Handle a control request that the gateway has checked; ``user`` is the public key of its connection."""
        self._later.asked()
        request = decode([frame])
        try:
            if isinstance(request, List):
                self._reply(peer, self._list(request, user))
            elif isinstance(request, Probe):
                self._reply(peer, self._probe(request, user))
            else:
                self._once(peer, user, request)
        except (MeshMotionError, OSError) as error:
            self._reply_error(peer, request, _known(error))

    def _once(self, peer: bytes, user: str, request: Message) -> None:
        """Execute OPEN and RESUME once per user and request id."""
        verdict = decide(self._access.roles(user), request.type, own=True)
        if verdict is not Verdict.USE:
            raise refusal(verdict, request.type)
        asked, new = self._book.enter(peer, user, request)
        if asked.reply is not None:
            self._send(peer, asked.reply)
        if not new:
            return
        self._execute(asked)

    def _execute(self, asked: Asked) -> None:
        try:
            if self.draining:
                raise ResourceExhausted("the server is stopping", code="UNAVAILABLE.DRAINING")
            if isinstance(asked.request, Open):
                self._open(asked, asked.request)
            elif isinstance(asked.request, Resume):
                self._resume(asked, asked.request)
        except (MeshMotionError, OSError) as error:
            self._refuse(asked, _known(error))

    def _open(self, asked: Asked, request: Open) -> None:
        check_place(self.registry, self._settings, asked.user)
        durability = check_open(request, self._settings)
        check_room(request, self._settings, self._disk)
        session, token = secrets.token_hex(16), secrets.token_bytes(32)
        child = self._start(
            {
                "order": "create",
                "session": session,
                "token": token,
                "dimension": request.dimension,
                "partitions": request.partitions,
                "method": request.settings,
                "label": request.label,
                "durability": durability,
                "evaluation": request.evaluation,
                "time": float(request.time),
                "time_levels": request.time_levels,
                "owner": asked.user,
            }
        )
        failpoint("supervisor.opened")
        live = Live(session, token, asked.user, child, request.label, request.partitions)
        self._expect(live, asked)
        self.registry.live[session] = live
        log().info(
            "open",
            session=session,
            label=request.label,
            partitions=request.partitions,
            owner=self._access.name(asked.user),
        )

    def _resume(self, asked: Asked, request: Resume) -> None:
        live = self._found(request, asked.user)
        if live is None:
            check_place(self.registry, self._settings, asked.user)
            live = Live(request.session, request.token, asked.user, self._start(_resume_order(request, asked.user)))
            self.registry.live[request.session] = live
            self._expect(live, asked)
            log().info("resume", session=live.session)
        elif live.asked is not None:
            _require_place(live)
            live.queue.append(asked)
        elif live.status == "dead":
            check_place(self.registry, self._settings, live.owner)
            self._restart(live, asked)
        else:
            live.reclaiming = True
            live.child.channel.offer({"order": "reclaim", "token": request.token})
            self._expect(live, asked, seconds=_RECLAIM_SECONDS)

    def _restart(self, live: Live, asked: Asked) -> None:
        """Start another worker for a session whose worker has ended, from its journal."""
        failpoint("supervisor.restart")
        live.child = self._start(_resume_order(live, live.owner))
        live.status, live.reclaiming, live.over = "starting", False, False
        live.suspended_at, live.giving_way = None, False
        self._expect(live, asked)
        log().info("resume", session=live.session)

    def _expect(self, live: Live, asked: Asked, *, seconds: float = _START_SECONDS) -> None:
        live.asked, live.deadline = asked, time.monotonic() + seconds

    def _found(self, request: Resume | Probe, user: str) -> Live | None:
        """Return the session of a request, None for one that only the store has.

        Raises SessionError: NOT_FOUND, the same for an unknown session, a wrong token, and another user's session.
        """
        try:
            return self._look_up(request, user)
        except SessionError:
            self._disk.require_answers()  # while the disk is silent, all unusable sessions get the same answer
            raise

    def _look_up(self, request: Resume | Probe, user: str) -> Live | None:
        if request.session not in self.registry.live:
            self._disk.require_answers()
        verdict = decide(self._access.roles(user), request.type, own=self._is_own(request.session, user))
        if verdict is Verdict.USE:
            return self.registry.authorised(request.session, request.token)
        if verdict is Verdict.OVERSEE:
            return self.registry.overseen(request.session)
        raise refusal(verdict, request.type, request.session)

    def _is_own(self, session: str, user: str) -> bool:
        try:
            return self.registry.owner(session) == user
        except DataLoss:
            if user:
                return False  # the owner cannot be read: treat as not the owner
            raise

    def _list(self, request: List, user: str) -> Listed:
        roles = self._access.roles(user)
        sees = {own: decide(roles, request.type, own=own) for own in (True, False)}
        if sees[True] not in _SEEN:
            raise refusal(sees[True], request.type)
        self._disk.require_answers()
        page, more = self.registry.page(request.after, lambda owner: sees[owner == user] in _SEEN)
        named = sees[False] in _SEEN
        sessions = [entry | ({"owner": self._access.name(owner)} if named else {}) for owner, entry in page]
        fitting = fit(sessions)
        more = more or len(fitting) < len(sessions)
        return Listed(client=request.client, sequence=request.sequence, sessions=fitting, more=more)

    def _probe(self, request: Probe, user: str) -> Probed:
        live = self._found(request, user)
        worker, epoch, endpoint = (live.status, live.epoch, live.endpoint) if live else ("none", 0, "")
        return Probed(
            client=request.client,
            sequence=request.sequence,
            session=request.session,
            worker=worker,
            epoch=epoch,
            endpoint=endpoint if worker == "alive" else "",
        )

    # --- workers -----------------------------------------------------------------------------------------------------

    def reported(self, live: Live, event: dict[str, Any]) -> None:
        """Handle a worker's report."""
        kind = event["event"]
        if kind == "born":
            log().info("worker_started", session=live.session, worker=live.child.pid)
        elif kind in ("serving", "reclaimed"):
            live.status, live.endpoint = "alive", event.get("endpoint", live.endpoint)
            live.label = event.get("label", live.label)
            live.partitions = event.get("partitions", live.partitions)
            live.epoch, live.state, live.step = event["epoch"], event["state"], event["step"]
            self._arrived(live)
        elif kind == "status":
            live.epoch, live.state, live.step = event["epoch"], event["state"], event["step"]
            live.note_suspended(event["suspended"], time.monotonic())
        elif kind == "reclaiming" and live.deadline is not None:
            live.deadline = time.monotonic() + max(_RECLAIM_SECONDS, self._settings.drain_seconds)
        elif kind == "recomputed" and live.deadline is not None:
            live.deadline = time.monotonic() + _START_SECONDS
        elif kind == "failed":
            live.failure = MeshMotionError(
                event["message"], code=event["code"], hint=event["hint"], details=event["details"]
            )
        elif kind == "not_reclaimed":
            live.child.kill()
        elif kind == "over":
            live.over = True

    def _arrived(self, live: Live) -> None:
        """The worker serves: answer the request that started it, then the next one in the queue."""
        asked, live.asked, live.deadline, live.reclaiming = live.asked, None, None, False
        if asked is None:
            return
        request = asked.request
        to: dict[str, Any] = {"client": request.client, "sequence": request.sequence}
        there: dict[str, Any] = {"session": live.session, "endpoint": live.endpoint, "epoch": live.epoch}
        if isinstance(request, Open):
            self._settle(asked, Opened(**to, **there, token=live.token))
        else:
            self._settle(asked, Resumed(**to, **there, state=live.state, step=live.step))
        self._next(live)

    def _next(self, live: Live) -> None:
        while live.queue and live.asked is None:
            self._execute(live.queue.popleft())

    def gone(self, live: Live, code: int) -> None:
        """Handle the end of a worker: by an order, by itself, or by a failure."""
        log().info("worker_ended", session=live.session, worker=live.child.pid, code=code, over=live.over)
        asked, live.asked, live.deadline = live.asked, None, None
        reclaiming, live.reclaiming = live.reclaiming, False
        _remove_socket(live.endpoint)
        live.status, live.endpoint = "dead", ""
        failure, live.failure = live.failure, None
        if live.over or (failure is not None and not reclaiming):
            # The journal, if there is one, has the state.
            self.registry.live.pop(live.session, None)
        if asked is not None:
            self._go_on(live, asked, reclaiming, failure or _worker_ended(code))
        self._next(live)
        self.registry.forget_fallen()

    def _go_on(self, live: Live, asked: Asked, reclaiming: bool, failure: MeshMotionError) -> None:
        """Answer the request that waited for an ended worker, or start another worker for it."""
        if not reclaiming or (self.draining and not live.over):
            self._refuse(asked, failure)
        elif live.over:
            self._execute(asked)  # it ended at its last holder's request: a new worker looks for a stored state
        else:
            try:
                self._restart(live, asked)
            except OSError as error:
                self._refuse(asked, _known(error))

    def keep_time(self, now: float) -> None:
        """Kill workers that did not start or did not accept the new holder in time; :meth:`gone` then continues."""
        self._later.send_due(now)
        for live in self.registry.live.values():
            if live.deadline is not None and live.deadline <= now:
                live.deadline = None
                live.child.kill()

    def next_deadline(self) -> float | None:
        """Return when :meth:`keep_time` must run next."""
        deadlines = (self._later.next_due(), *(live.deadline for live in self.registry.live.values()))
        return min((deadline for deadline in deadlines if deadline is not None), default=None)

    # --- replies -----------------------------------------------------------------------------------------------------

    def _settle(self, asked: Asked, reply: Message) -> None:
        failpoint("supervisor.answer")
        asked.reply = bytes(encoded(reply)[0])
        self._send(asked.peer, asked.reply)

    def _refuse(self, asked: Asked, error: MeshMotionError) -> None:
        """Refuse; a request that finds no place for its worker waits for a suspended session that gives way, if any."""
        live = gives_way(self.registry, error)
        if live is not None:
            log().info("gives_way", session=live.session, of=self._access.name(live.owner))
            live.deadline = time.monotonic() + self._settings.drain_seconds
            live.child.channel.offer({"order": "drain"})
            live.queue.append(asked)
            return
        self._book.forget(asked)
        self._reply_error(asked.peer, asked.request, error)

    def _reply_error(self, peer: bytes, request: Message, error: MeshMotionError) -> None:
        """Send an error; NOT_FOUND always has the same words and the same delay, whatever was looked up."""
        TALLY.count("refused", label=error.code)
        if error.code == "NOT_FOUND":
            reply = error_reply(request, not_found(getattr(request, "session", "")))
            self._later.put(peer, bytes(encoded(reply)[0]))
            return
        self._reply(peer, error_reply(request, error))

    def _reply(self, peer: bytes, reply: Message) -> None:
        self._send(peer, bytes(encoded(reply)[0]))


def _require_place(live: Live) -> None:
    """Raise if the queue of RESUMEs for this session is full."""
    if len(live.queue) >= _WAITING:
        raise ResourceExhausted(
            f"{_WAITING} requests wait to resume session {live.session} already",
            code="UNAVAILABLE",
            hint="try again in a second; only one holder at a time can move a session",
        )


def _resume_order(session: Resume | Live, owner: str) -> dict[str, Any]:
    """Return the order for a worker that resumes a stored session."""
    return {"order": "resume", "session": session.session, "token": session.token, "owner": owner}


def _remove_socket(endpoint: str) -> None:
    """Remove the file of the ipc endpoint that a killed worker has left."""
    if endpoint.startswith("ipc://"):
        with contextlib.suppress(OSError):
            Path(endpoint.removeprefix("ipc://")).unlink(missing_ok=True)


def _known(error: MeshMotionError | OSError) -> MeshMotionError:
    """Convert a refusal of the system, of a process or a file, to a MeshMotionError: nothing was started."""
    if isinstance(error, MeshMotionError):
        return error
    log().error("refused_by_system", reason=str(error))
    return ResourceExhausted(
        f"the server's operating system refuses: {error.strerror or error}",
        code="RESOURCE_EXHAUSTED",
        hint="try again; if this error comes again, check memory, processes and open files of the server's machine",
    )


def _worker_ended(code: int) -> MeshMotionError:
    how = f"signal {-code}" if code < 0 else f"exit status {code}"
    return MeshMotionError(f"the session's worker ended while it started ({how})", code="UNAVAILABLE.WORKER")
