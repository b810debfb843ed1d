"""The web application: the page and its files, and its data requests."""

import asyncio
import gzip
import math
import mimetypes
import time
from collections import Counter
from collections.abc import Callable
from concurrent.futures import Executor
from pathlib import Path
from typing import Any, TypeVar

from mesh_motion_protocol.errors import MeshMotionError
from starlette.applications import Starlette
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import FileResponse, Response
from starlette.routing import Mount, Route
from starlette.staticfiles import StaticFiles
from starlette.types import Scope

from mesh_motion_server.transport.telemetry import log
from mesh_motion_server.watch.page.archive import Archive, as_json, integer
from mesh_motion_server.watch.page.guard import Guard

STATIC = Path(__file__).with_name("static")
_JSON = "application/json"
#: Points of a chart if the request names no number; the page itself requests as many (static/history.js).
_POINTS = 1500
#: Minimum seconds between two readings of the list, and the maximum share of the time: many folders take long to read.
_LIST_SECONDS, _LIST_SHARE = 1.0, 0.05
#: Longer answers are compressed at the cheapest level: a long history shrinks to a quarter, which helps remote users
#: behind a tunnel.
_COMPRESSED_BYTES = 16 << 10
#: Maximum number of pending answers of one kind; each kind has one thread.
_WAITING = 24
Answer = TypeVar("Answer")
_STATUS = {"NOT_FOUND": 404, "INVALID_ARGUMENT": 400}


class Page:
    """The pages of one server.

    Parameters
    ----------
    build : dict
        Versions.
    insecure : bool
        Whether other addresses than the loopback may reach it.
    """

    def __init__(self, state_folder: Path, build: dict[str, str], *, insecure: bool = False) -> None:
        for suffix, kind in ((".js", "text/javascript"), (".svg", "image/svg+xml"), (".css", "text/css")):
            mimetypes.add_type(kind, suffix)  # some systems give scripts a type that browsers refuse
        self._archive = Archive(state_folder)
        self._build = build
        self._news: dict[str, Any] = {"missing": "", "sessions": []}
        self._waiting: Counter[Executor] = Counter()
        self._trouble = ""
        self._shown: dict[str, Any] = {}
        self._due = 0.0
        routes = [
            Route("/", self._index),
            Route("/api/sessions", self._sessions),
            Route("/api/sessions/{session}", self._detail),
            Route("/api/sessions/{session}/series", self._series),
            Route("/api/sessions/{session}/mesh.png", self._mesh),
            Mount("/static", _Files(directory=STATIC)),
        ]
        handlers: dict[Any, Any] = {MeshMotionError: _refused, HTTPException: _missing}
        self.app = Guard(Starlette(routes=routes, exception_handlers=handlers), insecure=insecure)

    def update(self, news: dict[str, Any]) -> None:
        """Take the supervisor's message, sent every second."""
        self._news = news

    async def _index(self, _request: Request) -> Response:
        return FileResponse(STATIC / "index.html", headers={"cache-control": "no-cache"})

    async def _sessions(self, request: Request) -> Response:
        return await self._json(request, self._archive.lists, self._list)

    async def _detail(self, request: Request) -> Response:
        archive, session = self._archive, request.path_params["session"]
        return await self._json(request, archive.histories, lambda: archive.detail(session))

    async def _series(self, request: Request) -> Response:
        archive, session, asked = self._archive, request.path_params["session"], request.query_params
        first = integer(asked.get("first"), lambda: None)
        points = max(1, integer(asked.get("points"), lambda: _POINTS))
        return await self._json(request, archive.histories, lambda: archive.series(session, first, points))

    async def _mesh(self, request: Request) -> Response:
        archive, session, dark = self._archive, request.path_params["session"], "dark" in request.query_params
        picture, newer = await self._made(archive.meshes, lambda: archive.mesh(session, dark=dark))
        headers = {"cache-control": "no-store"} | ({"retry-after": f"{math.ceil(newer)}"} if newer else {})
        return Response(picture, media_type="image/png", headers=headers)

    def _list(self) -> bytes:
        """The list, JSON; in the thread ``lists``. It is made once a second at most, for any number of pages."""
        started = time.monotonic()
        if started >= self._due:
            self._shown = self._listed()
            ended = time.monotonic()
            self._due = max(started + _LIST_SECONDS, ended + (ended - started) / _LIST_SHARE)
        return as_json({"at": time.time()} | self._shown)

    def _listed(self) -> dict[str, Any]:
        news = self._news
        missing, sessions = news["missing"], self._shown.get("sessions", [])
        try:
            sessions, self._trouble = self._archive.overview(news["sessions"]), ""
        # any error: the page shows the previous list and says so, and the read is repeated
        except Exception as error:
            missing = f"the list cannot be read: {str(error) or type(error).__name__}"
            if missing != self._trouble:
                self._trouble = missing
                log().warning("page_list_failed", error=repr(error))
        return {"build": self._build, "missing": missing, "sessions": sessions}

    async def _json(self, request: Request, thread: Executor, make: Callable[[], bytes]) -> Response:
        """A JSON answer, compressed if it is long and the browser accepts that."""
        headers = {"cache-control": "no-store", "vary": "accept-encoding"}
        content = await self._made(thread, make)
        if len(content) > _COMPRESSED_BYTES and "gzip" in request.headers.get("accept-encoding", ""):
            content = await asyncio.to_thread(gzip.compress, content, 1)
            headers["content-encoding"] = "gzip"
        return Response(content, media_type=_JSON, headers=headers)

    async def _made(self, thread: Executor, make: Callable[[], Answer]) -> Answer:
        """An answer, computed in its thread."""
        if self._waiting[thread] >= _WAITING:
            raise HTTPException(503, "too many requests at a time")
        self._waiting[thread] += 1
        try:
            return await asyncio.get_running_loop().run_in_executor(thread, make)
        except asyncio.CancelledError:  # raised by uvicorn, which would answer 500: a stop is no defect
            raise HTTPException(503, "the server stops") from None
        finally:
            self._waiting[thread] -= 1


class _Files(StaticFiles):
    """The page's files; browsers must ask whether they have changed."""

    async def get_response(self, path: str, scope: Scope) -> Response:
        response = await super().get_response(path, scope)
        response.headers["cache-control"] = "no-cache"
        return response


async def _refused(_request: Request, error: Exception) -> Response:
    """The answer for an error of the lower layers: its code, message and hint."""
    if not isinstance(error, MeshMotionError):
        raise error
    said = {"code": error.code, "message": error.message, "hint": error.hint}
    status = _STATUS.get(error.code.partition(".")[0], 503)
    return Response(as_json(said), status, media_type=_JSON, headers={"cache-control": "no-store"})


async def _missing(_request: Request, error: Exception) -> Response:
    status, message = (error.status_code, error.detail) if isinstance(error, HTTPException) else (500, "")
    return Response(as_json({"message": message}), status, media_type=_JSON)
