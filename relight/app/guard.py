"""Answer the application's own pages alone: the token, `Host` and `Origin` of each request.

A site whose name is made to point to this machine gets no answer, and neither does a form on another site.
"""

import hmac

from starlette.responses import Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

HOST = "127.0.0.1"
ALL = "0.0.0.0"  # all addresses of this machine
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

    `token`: the first part of every address. `host` and `port`: where the server listens. On all addresses
    of the machine, `Host` has to be the one that the connection came to, or the loopback's.
    """

    def __init__(self, app: ASGIApp, token: str, port: int, host: str = HOST) -> None:
        self._app, self._token, self._port, self._is_open = app, token.encode(), port, host == ALL
        names = (HOST, "localhost") if host in (HOST, ALL) else (host,)
        self._hosts = {f"{name}:{port}" for name in names}

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
            return
        headers = {key.lower(): value.decode("latin1") for key, value in scope["headers"]}
        host, origin = headers.get(b"host", ""), headers.get(b"origin")
        path = scope["path"]  # "*" of OPTIONS, and a host of CONNECT, are none
        given = path.removeprefix("/").partition("/")[0].encode(errors="replace")
        if host not in self._hosts_of(scope) or (origin is not None and origin != f"http://{host}"):
            refusal = "This address belongs to relight app, which answers its own pages alone.\n"
        elif not hmac.compare_digest(given, self._token):
            refusal = "Open the whole address that relight app printed: it ends in a token.\n"
        else:
            await self._app(scope, receive, _with_headers(send))
            return
        await Response(refusal, 403, HEADERS, "text/plain")(scope, receive, send)

    def _hosts_of(self, scope: Scope) -> set[str]:
        """Return what `Host` may be in a request, whose `server` is the connection's own end."""
        own = (scope.get("server") or [None])[0] if self._is_open else None
        return self._hosts | {f"{own}:{self._port}"} if own else self._hosts


def _with_headers(send: Send) -> Send:
    """Return a `send` that adds `HEADERS` to each response."""

    async def sending(message: Message) -> None:
        if message["type"] == "http.response.start":
            extra = [(key.lower().encode(), value.encode()) for key, value in HEADERS.items()]
            message = {**message, "headers": [*message["headers"], *extra]}
        await send(message)

    return sending
