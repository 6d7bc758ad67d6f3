"""Requests to the application's guard."""

import asyncio

from relight.app.guard import Guard

TOKEN = "secret-token"


def status(path="/secret-token/", listening="127.0.0.1", came_to=None, **headers):
    """The status of a GET: 200 where the guard lets it pass."""
    sent = []

    async def page(scope, receive, send):
        await send({"type": "http.response.start", "status": 200, "headers": []})
        await send({"type": "http.response.body", "body": b""})

    async def receive():
        return {"type": "http.request", "body": b""}

    async def send(message):
        sent.append(message)

    headers = {"host": "127.0.0.1:8000"} | headers
    scope = {
        "type": "http", "method": "GET", "path": path, "raw_path": path.encode(), "query_string": b"",
        "headers": [(key.encode(), value.encode()) for key, value in headers.items()],
        "server": came_to and (came_to, 8000),
    }  # fmt: skip
    asyncio.run(Guard(page, TOKEN, 8000, listening)(scope, receive, send))
    assert any(key == b"content-security-policy" for key, _ in sent[0]["headers"])
    return sent[0]["status"]
