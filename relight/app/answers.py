"""Read requests and answer them: JSON, refusals as sentences, and progress in lines."""

import asyncio
import contextlib
import json
import math
from collections.abc import AsyncIterator, Awaitable, Callable
from typing import TypeVar
from urllib.parse import quote

from starlette.requests import ClientDisconnect, Request
from starlette.responses import JSONResponse, Response, StreamingResponse

from relight.app.messages import Answer, Object, Progress
from relight.app.worker import EXPECTED, Refused

BODY_BYTES = 4 << 20  # of a request that is no file
DEPTH = 32  # levels of a request's JSON
CONNECTION_CHECK = 0.25  # seconds between two checks whether the page is still connected

Report = Callable[[Progress], None]
Result = TypeVar("Result")


async def json_of(request: Request) -> Object:
    """Return a request's JSON object; raise Refused for anything else, or more than `BODY_BYTES`."""
    body = b""
    async for chunk in request.stream():
        body += chunk
        if len(body) > BODY_BYTES:
            raise Refused("The request is too large.", 413)
    try:
        parsed = json.loads(body or b"{}")
        _check_plain(parsed, DEPTH)
    except (ValueError, RecursionError) as error:
        raise Refused("expected JSON of numbers and text that are finite, in few levels", 400) from error
    if not isinstance(parsed, dict):
        raise Refused("expected a JSON object", 400)
    return parsed


def _check_plain(value: object, depth: int) -> None:
    """Raise ValueError for what Python's JSON takes and a browser's does not, and for too many levels.

    That is NaN, infinity, and halves of characters; what is kept of a request is sent back as JSON.
    """
    if depth == 0:
        raise ValueError("too many levels")
    if isinstance(value, float) and not math.isfinite(value):
        raise ValueError("not a finite number")
    if isinstance(value, str):
        value.encode()  # UnicodeEncodeError is a ValueError
    for each in (
        [*value, *value.values()] if isinstance(value, dict) else value if isinstance(value, list) else ()
    ):
        _check_plain(each, depth - 1)


def refusing(endpoint: Callable[[Request], Awaitable[Response]]) -> Callable[[Request], Awaitable[Response]]:
    """Wrap an endpoint: it answers a refusal by a sentence, as JSON."""

    async def answer(request: Request) -> Response:
        try:
            return await endpoint(request)
        except Refused as error:
            return JSONResponse({"sentence": str(error)}, error.status)
        except ClientDisconnect:
            return Response(status_code=499)  # nobody reads it
        except (KeyError, *EXPECTED) as error:
            return JSONResponse({"sentence": f"The request cannot be used: {type(error).__name__}."}, 400)

    return answer


async def while_connected(request: Request, work: Awaitable[Result]) -> Result:
    """Return what the work returns; cancel it when the page goes away, and raise Refused.

    The body of the request has been read.
    """
    job = asyncio.ensure_future(work)
    try:
        while not job.done():
            await asyncio.wait({job}, timeout=CONNECTION_CHECK)
            if not job.done() and await request.is_disconnected():
                raise Refused("The page has gone away.", 499)
        return job.result()
    finally:
        job.cancel()
        with contextlib.suppress(asyncio.CancelledError, Refused):
            await job


async def picture(request: Request, work: Awaitable[Answer]) -> Response:
    """Answer with the PNG of a task, and its warnings as a header, unless the page goes away."""
    answer = await while_connected(request, work)
    notes = {"X-Notes": quote(json.dumps(answer["notes"]))}
    return Response(answer["png"], media_type="image/png", headers=notes)


def streamed(work: Callable[[Report], Awaitable[dict[str, object]]]) -> Response:
    """Answer in lines of JSON: first the progress of the work, at last its result.

    The work is cancelled when the page goes away.
    """

    async def lines() -> AsyncIterator[str]:
        said: asyncio.Queue[Progress | None] = asyncio.Queue()
        job = asyncio.ensure_future(work(said.put_nowait))
        job.add_done_callback(lambda _: said.put_nowait(None))
        try:
            while (what := await said.get()) is not None:
                yield json.dumps({"progress": what}) + "\n"
            try:
                yield json.dumps({"done": job.result()}) + "\n"
            except Refused as error:
                yield json.dumps({"sentence": str(error)}) + "\n"
        finally:
            job.cancel()
            with contextlib.suppress(asyncio.CancelledError, Refused):
                await job

    return StreamingResponse(lines(), media_type="application/x-ndjson")
