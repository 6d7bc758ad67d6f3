"""Answer this machine's own pages alone: the token, `Host` and `Origin` of each request.

A site whose name is made to point to this machine gets no answer, and neither does a form on another site.
"""

import hmac
from typing import Any

from starlette.responses import Response
from starlette.types import ASGIApp, Receive, Scope, Send

HOST = "127.0.0.1"
HEADERS = {
    "Content-Security-Policy": (
        "default-src 'none'; script-src 'self'; style-src 'self' 'unsafe-inline'; "
        "img-src 'self' blob: data:; connect-src 'self'; form-action 'none'; frame-ancestors 'none'; "
        "base-uri 'none'"
    ),
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cache-Control": "no-store",
}


class Guard:
    """Pass requests on that name this server as their host, come from its own pages, and know the token.

    `token`: the first part of every address. `port`: of the loopback address.
    """

    def __init__(self, app: ASGIApp, token: str, port: int) -> None:
        self._app, self._token = app, token.encode()
        self._hosts = {f"{name}:{port}" for name in (HOST, "localhost")}

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
            return
        headers = {key.lower(): value.decode("latin1") for key, value in scope["headers"]}
        host, origin = headers.get(b"host", ""), headers.get(b"origin")
        path = scope["path"]  # "*" of OPTIONS, and a host of CONNECT, are none
        given = path.removeprefix("/").partition("/")[0].encode(errors="replace")
        if host not in self._hosts or (origin is not None and origin != f"http://{host}"):
            refusal = "This address belongs to relight app, which answers its own pages alone.\n"
        elif not hmac.compare_digest(given, self._token):
            refusal = "Open the whole address that relight app printed: it ends in a token.\n"
        else:
            await self._app(scope, receive, _with_headers(send))
            return
        await Response(refusal, 403, HEADERS, "text/plain")(scope, receive, send)


def _with_headers(send: Send) -> Send:
    """Return a `send` that adds `HEADERS` to each response."""

    async def sending(message: Any) -> None:
        if message["type"] == "http.response.start":
            extra = [(key.lower().encode(), value.encode()) for key, value in HEADERS.items()]
            message = {**message, "headers": [*message["headers"], *extra]}
        await send(message)

    return sending
