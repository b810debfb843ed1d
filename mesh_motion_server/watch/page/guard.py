"""Access control of the pages: refuses unknown host names, requests from other sites, and other methods.

A page of another site can make a browser send requests to servers on the user's machine. It can read the answers only
if its name resolves to this machine (DNS rebinding). So the guard accepts only requests to an address or ``localhost``,
refuses requests that the browser marks as cross-site, and no answer gives permissions to other sites.
"""

from collections.abc import Awaitable, Callable, MutableMapping
from typing import Any

from mesh_motion_server.security.host_header import is_allowed_host

Scope = MutableMapping[str, Any]
Send = Callable[[MutableMapping[str, Any]], Awaitable[None]]
Receive = Callable[[], Awaitable[MutableMapping[str, Any]]]
App = Callable[[Scope, Receive, Send], Awaitable[None]]

_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; connect-src 'self'; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
_HEADERS = [
    (b"content-security-policy", _POLICY.encode()),
    (b"cross-origin-opener-policy", b"same-origin"),
    (b"cross-origin-resource-policy", b"same-origin"),
    (b"permissions-policy", b"camera=(), geolocation=(), microphone=()"),
    (b"referrer-policy", b"no-referrer"),
    (b"x-content-type-options", b"nosniff"),
    (b"x-frame-options", b"DENY"),
]
_SEVERAL_SITES = (b"cross-site", b"same-site")


class Guard:
    """Protects an application.

    Parameters
    ----------
    insecure : bool
        Whether addresses outside the loopback are accepted as names of this server.
    """

    def __init__(self, app: App, *, insecure: bool = False) -> None:
        self._app = app
        self._insecure = insecure

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer or refuse one request; the answer gets the headers that block other sites."""
        if scope["type"] != "http":
            return
        refusal = self._refusal(scope)

        async def protected(message: MutableMapping[str, Any]) -> None:
            if message["type"] == "http.response.start":
                message["headers"] = [*_plain(message.get("headers", [])), *_HEADERS]
            await send(message)

        if refusal is None:
            await self._app(scope, receive, protected)
            return
        status, text = refusal
        headers = [(b"content-type", b"text/plain; charset=utf-8"), (b"content-length", str(len(text)).encode())]
        if status == 405:
            headers.append((b"allow", b"GET, HEAD"))
        await protected({"type": "http.response.start", "status": status, "headers": headers})
        await protected({"type": "http.response.body", "body": b"" if scope["method"] == "HEAD" else text})

    def _refusal(self, scope: Scope) -> tuple[int, bytes] | None:
        named = [value for name, value in scope["headers"] if name == b"host"]
        if len(named) != 1 or not is_allowed_host(named[0].decode("latin-1"), insecure=self._insecure):
            return 421, b"expected this machine's address or localhost as the host\n"
        if scope["method"] not in ("GET", "HEAD"):
            return 405, b"expected GET or HEAD: nothing is changed here\n"
        site = next((value for name, value in scope["headers"] if name == b"sec-fetch-site"), b"")
        if site in _SEVERAL_SITES and scope["path"] != "/":
            return 403, b"expected a request of this page\n"
        return None


def _plain(headers: Any) -> list[tuple[bytes, bytes]]:
    """The application's headers, without those that the guard adds."""
    ours = {name for name, _ in _HEADERS}
    return [(name, value) for name, value in headers if name not in ours]
