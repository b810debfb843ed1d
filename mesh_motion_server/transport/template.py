"""The template: the process that imports everything once and becomes each worker.

It forks a worker for each line that the supervisor hands over. The worker gets its order: create a session, or resume
one from its journal; then it listens and serves (:mod:`.worker`).
"""

from __future__ import annotations

import gc
import os
import signal
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any

import msgpack
import zmq
from mesh_motion_protocol.errors import MeshMotionError, ResourceExhausted, brief, brief_details
from mesh_motion_protocol.limits import FRAME_BYTES

from mesh_motion_server.failpoints import activate, failpoint
from mesh_motion_server.operation.tally import TALLY
from mesh_motion_server.session.spec import SessionSpec
from mesh_motion_server.session.store import SessionStore
from mesh_motion_server.settings import MethodSettings, ServerSettings
from mesh_motion_server.transport.channel import Channel
from mesh_motion_server.transport.endpoints import Endpoint, EndpointError, bind_first, router
from mesh_motion_server.transport.processes import (
    fork_from_template,
    limit_address_space,
    limit_descriptors,
    offer_to_the_oom_killer,
    wake_on_signals,
)
from mesh_motion_server.transport.protection import (
    Protection,
    Rights,
    forward_handshakes,
    keep_secrets_out_of_core_files,
)
from mesh_motion_server.transport.self_test import check_refuses
from mesh_motion_server.transport.telemetry import configure, log, name_session
from mesh_motion_server.transport.worker import Worker

if TYPE_CHECKING:
    from mesh_motion_server.service.dispatch import SessionHost

#: Whole messages queued per connection: the high-water mark counts messages, whatever their size.
_QUEUED = 2
#: Number of open files and connections: some for the journal and libraries, and one connection per partition and
#: client.
_DESCRIPTORS = 2048
#: Largest details of a failure sent to the supervisor, whose line accepts headers only; the message has the same
#: content.
_DETAILS_BYTES = 16 << 10


#: The classes with which a worker serves: of its host, and of the store.
Service = tuple[type["SessionHost"], type[SessionStore]]


def _import_service() -> Service:
    """Import everything that a session needs: once, before the first worker is forked."""
    import mesh_motion_numerics.motion.motion  # noqa: F401, PLC0415 (the host imports it with the first mesh)

    from mesh_motion_server.service.dispatch import SessionHost  # noqa: PLC0415

    return SessionHost, SessionStore


def main(channel: Channel, level: str, import_service: Callable[[], Service] = _import_service) -> int:
    """Import everything, then fork workers; each of them serves."""
    offer_to_the_oom_killer()
    signal.signal(signal.SIGTERM, signal.SIG_IGN)  # the supervisor ends this process
    configure("worker", level)
    activate()
    failpoint("template.start")
    gc.disable()  # saves a tenth of the import time
    service = import_service()
    failpoint("template.ready")
    channel.send({"event": "warm"})
    gc.freeze()  # then collections in a worker leave the shared pages unchanged
    gc.enable()
    while (line := channel.take_over()) is not None:
        try:
            in_worker = fork_from_template()
        except OSError as error:
            log().error("no_worker", reason=str(error))
            in_worker = False
        if in_worker:
            channel.close()
            return _work(line, service)
        line.close()
    return 0


def _work(channel: Channel, service: Service) -> int:
    """Take the order and serve, in a worker."""
    signals = wake_on_signals(signal.SIGTERM)
    failpoint("worker.start")
    channel.send({"event": "born", "pid": os.getpid()})
    order = channel.receive()
    if order is None or order["order"] == "drain":
        return 0
    name_session(order["session"])
    return _serve(channel, order, service, signals)


def _serve(channel: Channel, order: dict[str, Any], service: Service, signals: Any) -> int:
    """Serve from the order to the end of the session."""
    failpoint("worker.ordered")
    hosts, stores = service
    settings = ServerSettings.model_validate_json(order["settings"])
    limit_address_space(settings.worker_memory_bytes)
    limit_descriptors(_DESCRIPTORS)
    protection = Protection.of_order(order)
    context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
    context.set(zmq.MAX_SOCKETS, 64)
    socket = router(context, message_bytes=FRAME_BYTES, queued=_QUEUED, handshake_seconds=settings.handshake_seconds)
    try:
        store = stores(settings.state_folder, identity=tuple(order["root"]))
        host = _host(order, hosts, store, settings, partial(_report_progress, channel))
    except Exception as error:
        channel.send({"event": "failed", "tally": TALLY.take()} | _failure(error))
        return 1
    try:
        failpoint("worker.hosting")
        try:
            endpoint = _listen(context, socket, Endpoint.parse(order["endpoint"]), protection, settings)
        except EndpointError as error:
            channel.send({"event": "failed", "tally": TALLY.take()} | _failure(error))
            return 1
        failpoint("worker.bound")
        # The worker must watch connections before the endpoint is known: a connection that it did not see start would
        # keep no lease.
        worker = Worker(channel, socket, host, settings, Rights(protection, order["owner"]))
        serving = {"event": "serving", "endpoint": endpoint, "label": host.label, "partitions": host.partitions}
        channel.send(serving | {"epoch": host.epoch, "state": str(host.state), "step": host.step})
        try:
            worker.run(signals)
        finally:
            worker.disconnect()
        failpoint("worker.over")
        channel.send({"event": "over", "closed": host.closed})
    finally:
        # after any failure: a context with an open socket would never end, and so the process would not end
        try:
            host.close()
            channel.send({"event": "farewell", "tally": TALLY.take()})
        finally:
            socket.close(linger=5_000)
            context.term()
    return 0


def _listen(
    context: zmq.Context[zmq.Socket[bytes]],
    socket: zmq.Socket[bytes],
    control: Endpoint,
    protection: Protection | None,
    settings: ServerSettings,
) -> str:
    """Bind next to the control endpoint; with keys, only if a real connection shows that unknown keys are refused.

    Returns
    -------
    str
        The endpoint that clients get.
    """
    if protection is not None:
        keep_secrets_out_of_core_files()
        forward_handshakes(context, protection.handshakes)
        protection.protect(socket)
    endpoint = bind_first(socket, control.worker_addresses(settings.data_ports))
    if protection is not None:
        check_refuses(endpoint, protection)
    return Endpoint.parse(endpoint).advertised_as(settings.advertised_host)


def _report_progress(channel: Channel, step: int) -> None:
    """Report a recomputed step, so that the supervisor continues to wait."""
    channel.offer({"event": "recomputed", "step": step})


def _host(
    order: dict[str, Any],
    hosts: type[SessionHost],
    store: SessionStore,
    settings: ServerSettings,
    progress: Callable[[int], None],
) -> SessionHost:
    if order["order"] == "resume":
        return hosts.resume(order["session"], order["token"], store, limits=settings, progress=progress)
    spec = SessionSpec(
        session=order["session"],
        token=order["token"],
        dimension=order["dimension"],
        partitions=order["partitions"],
        settings=MethodSettings.from_mapping(order["method"]),
        label=order["label"],
        durability=order["durability"],
        owner=order["owner"],
        evaluation=order["evaluation"],
        time=order["time"],
        time_levels=order["time_levels"],
    )
    return hosts.create(spec, store, limits=settings)


def _failure(error: Exception) -> dict[str, Any]:
    """Return the error for the supervisor; an unexpected error is INTERNAL, and its trace is logged."""
    if not isinstance(error, (MeshMotionError, MemoryError)):
        log().exception("start_failed")
        text = brief(f"{type(error).__name__}: {error}")
        return {"code": "INTERNAL", "message": text, "hint": "", "details": {}}
    if isinstance(error, MemoryError):
        error = ResourceExhausted("the session does not fit into the worker's memory", code="RESOURCE_EXHAUSTED.MEMORY")
    details = brief_details(error.details)
    if len(msgpack.packb(details, default=str)) > _DETAILS_BYTES:
        details = {}
    return {"code": error.code, "message": brief(error.message), "hint": error.hint, "details": details}
