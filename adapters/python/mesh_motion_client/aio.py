"""The client for programs with an event loop: the same calls, awaited.

::

    from mesh_motion_client import aio

    async with aio.connect("tcp://127.0.0.1:7440") as server, server.open(mesh, {"support_radius": 0.5}) as session:
        moved = await session.move(displacements)
        await session.commit()

Each server and each session waits in its own thread: the event loop is not blocked, and several sessions can move at
the same time. The calls, their arguments and errors are those of :mod:`.server` and :mod:`.session`. A call whose task
is cancelled goes on in its thread; the next one waits for it, and the same call gets its answer.
"""

from __future__ import annotations

import asyncio
import sys
from collections.abc import AsyncIterator, Callable, Coroutine
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import AbstractAsyncContextManager, asynccontextmanager
from functools import partial, wraps
from types import TracebackType
from typing import Any, Concatenate, Generic, Literal, NoReturn, ParamSpec, TypeVar

from mesh_motion_protocol.errors import InvalidInput

from mesh_motion_client import server, session

__all__ = ["Server", "Session", "connect"]

P = ParamSpec("P")
R = TypeVar("R")
Outer = TypeVar("Outer")
Inner = TypeVar("Inner", bound=server.Server | session.Session)


class _InThread(Generic[Inner]):
    """An object of the client, and the only thread that calls it."""

    def __init__(self, inner: Inner, thread: ThreadPoolExecutor) -> None:
        self.inner = inner
        self.thread = thread

    def __repr__(self) -> str:
        return repr(self.inner)

    def __getattr__(self, name: str) -> NoReturn:
        kind = type(self).__name__
        where = f": read inner.{name}, while no call runs" if hasattr(vars(self).get("inner"), name) else ""
        raise AttributeError(f"the asynchronous {kind} has no {name!r}{where}", name=name, obj=self)


class _Context(AbstractAsyncContextManager[Outer]):
    """An asynchronous context that says how to enter it if it is awaited."""

    def __init__(self, context: AbstractAsyncContextManager[Outer], call: str) -> None:
        self._context = context
        self._call = call

    async def __aenter__(self) -> Outer:
        return await self._context.__aenter__()

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> bool | None:
        return await self._context.__aexit__(kind, error, trace)

    def __await__(self) -> NoReturn:
        raise InvalidInput(
            f"{self._call}(…) is a context, which cannot be awaited", hint=f"async with {self._call}(…) as …:"
        )


def _submitted(
    of: _InThread[Inner], method: Callable[Concatenate[Inner, P], R], *arguments: P.args, **named: P.kwargs
) -> Future[R]:
    """Call the method in the object's thread; if that has ended with its context, the object says that it is closed."""
    try:
        return of.thread.submit(method, of.inner, *arguments, **named)
    except RuntimeError:
        done: Future[R] = Future()
        done.set_result(method(of.inner, *arguments, **named))
        return done


def _awaited(
    method: Callable[Concatenate[Inner, P], R],
) -> Callable[Concatenate[_InThread[Inner], P], Coroutine[Any, Any, R]]:
    """Return a coroutine function that calls the method in the thread."""

    @wraps(method)
    async def call(self: _InThread[Inner], /, *arguments: P.args, **named: P.kwargs) -> R:
        return await asyncio.wrap_future(_submitted(self, method, *arguments, **named))

    return call


def _opened(
    method: Callable[Concatenate[server.Server, P], session.Session], outcome: Literal["keep", "discard"]
) -> Callable[Concatenate[Server, P], AbstractAsyncContextManager[Session]]:
    """Return an asynchronous context manager that calls the method in the server's thread and yields the session.

    ``outcome``: how a session is closed if its caller was cancelled while the session was being opened.
    """

    @asynccontextmanager
    async def open_session(self: Server, /, *arguments: P.args, **named: P.kwargs) -> AsyncIterator[Session]:
        made = _submitted(self, method, *arguments, **named)
        async with _open(made, ThreadPoolExecutor(1), lambda late: late.close(outcome)) as (inner, thread):
            yield Session(inner, thread)

    @wraps(method)
    def call(self: Server, /, *arguments: P.args, **named: P.kwargs) -> AbstractAsyncContextManager[Session]:
        return _Context(open_session(self, *arguments, **named), f"server.{method.__name__}")

    return call


def _connected(function: Callable[P, server.Server]) -> Callable[P, AbstractAsyncContextManager[Server]]:
    """Return an asynchronous context manager that calls the function and yields the server."""

    @asynccontextmanager
    async def connect_server(*arguments: P.args, **named: P.kwargs) -> AsyncIterator[Server]:
        own = ThreadPoolExecutor(1)
        made = own.submit(partial(function, *arguments, **named))
        async with _open(made, own, server.Server.close) as (inner, thread):
            yield Server(inner, thread)

    @wraps(function)
    def call(*arguments: P.args, **named: P.kwargs) -> AbstractAsyncContextManager[Server]:
        return _Context(connect_server(*arguments, **named), f"aio.{function.__name__}")

    return call


@asynccontextmanager
async def _open(
    made: Future[Inner], thread: ThreadPoolExecutor, close_late: Callable[[Inner], None]
) -> AsyncIterator[tuple[Inner, ThreadPoolExecutor]]:
    """Wait for ``made``, yield its object and its thread, and close it there; ``close_late`` closes a late object."""
    try:
        inner = await asyncio.wrap_future(made)
    except BaseException:
        made.add_done_callback(lambda done: None if done.cancelled() or done.exception() else close_late(done.result()))
        thread.shutdown(wait=False)
        raise
    try:
        yield inner, thread
    finally:
        await asyncio.get_running_loop().run_in_executor(thread, inner.__exit__, *sys.exc_info())
        thread.shutdown(wait=False)


class Session(_InThread[session.Session]):
    """A session whose calls are awaited; made by :class:`Server`.

    Attributes
    ----------
    inner : mesh_motion_client.Session
        The session itself, for its attributes, as ``inner.moving_nodes``; read them while no call runs.
    """

    move = _awaited(session.Session.move)
    commit = _awaited(session.Session.commit)
    tangent = _awaited(session.Session.tangent)
    cotangent = _awaited(session.Session.cotangent)
    rollback = _awaited(session.Session.rollback)
    points = _awaited(session.Session.points)
    status = _awaited(session.Session.status)
    close = _awaited(session.Session.close)


class Server(_InThread[server.Server]):
    """A connection to a server whose calls are awaited; made by :func:`connect`.

    ``open``, ``join`` and ``resume`` are contexts of a :class:`Session`; they run one after the other.

    Attributes
    ----------
    inner : mesh_motion_client.Server
    """

    open = _opened(server.Server.open, "discard")
    join = _opened(server.Server.join, "keep")
    resume = _opened(server.Server.resume, "keep")
    sessions = _awaited(server.Server.sessions)


connect = _connected(server.connect)
