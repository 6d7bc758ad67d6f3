"""Requests to the app that no page sends: other targets, JSON that no browser reads, names without UTF-8."""

import asyncio
import json
import os
import subprocess
import sys
import time

import pytest

pytest.importorskip("starlette")
pytest.importorskip("uvicorn")

from starlette.requests import Request

from relight.app.answers import refusing
from relight.app.guard import Guard
from relight.app.server import Server
from relight.app.session import Session
from relight.app.worker import Refused


class Worker:
    """A worker that analyses at once."""

    async def run(self, task, folder, arguments, report=None, brief=False):
        return {"scene": {}, "notes": []}


def asked(endpoint, body=b"", **path):
    """The status and the text of an answer."""

    async def receive():
        return {"type": "http.request", "body": body, "more_body": False}

    async def run():
        scope = {
            "type": "http", "method": "POST", "path": "/", "headers": [], "query_string": b"",
            "path_params": path, "asgi": {"spec_version": "2.4"},
        }  # fmt: skip
        answer = await refusing(endpoint)(Request(scope, receive))
        if hasattr(answer, "body_iterator"):
            return answer.status_code, "".join([str(part) async for part in answer.body_iterator])
        return answer.status_code, answer.body.decode()

    return asyncio.run(run())


@pytest.fixture
def server(tmp_path):
    session = Session(tmp_path)
    photograph = session.new_photograph("a.png")
    photograph.about = {"cut_out": False, "width": 9, "height": 9, "preview": "p", "notes": []}
    yield Server(session, Worker())
    session.close()


@pytest.mark.parametrize("path", ["*", "127.0.0.1:80", "", "/", "//", "/\udcff/", "/token"])
@pytest.mark.parametrize("method", ["OPTIONS", "CONNECT", "GET"])
def test_targets_that_are_no_paths_are_refused(path, method):
    sent = []

    async def send(message):
        sent.append(message)

    scope = {"type": "http", "method": method, "path": path, "headers": [(b"host", b"127.0.0.1:8000")]}
    asyncio.run(Guard(None, "a token", 8000)(scope, None, send))
    assert sent[0]["status"] == 403


DRAWN = '{"drawn": {"lasso": [[0, 0], [1, 0], [1, 1]], "x": %s}}'


@pytest.mark.parametrize(
    "value",
    ["1e999", "-1e999", "NaN", "Infinity", '"\\ud800"', '{"\\udfff": 1}', "[" * 40 + "]" * 40,
     "[" * 600 + "]" * 600, '{"a":' * 600 + "1" + "}" * 600, "[" * 100_000],
)  # fmt: skip
def test_no_drawing_locks_the_session(server, value):
    (photograph,) = server.session.photographs.values()
    status, text = asked(server.analyse, (DRAWN % value).encode(), id=photograph.id)
    assert status == 400
    assert "expected JSON" in json.loads(text)["sentence"]
    assert asked(server.about)[0] == 200
    assert asked(server.analyse, (DRAWN % "[[[1.5]]]").encode(), id=photograph.id)[0] == 200
    assert asked(server.about)[0] == 200


def test_names_without_utf_8_are_told_with_question_marks(server):
    async def gone(request):
        raise Refused("\udcff.png: no longer exists.", 404)

    status, text = asked(gone)
    assert status == 404
    assert json.loads(text) == {"sentence": "?.png: no longer exists."}
    status, text = asked(server.add_from_root, json.dumps({"path": "%FFgone.png"}).encode())
    assert status == 404
    assert json.loads(text) == {"sentence": "?gone.png: no longer exists."}


@pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")
@pytest.mark.parametrize(
    "signals",
    [
        pytest.param(["SIGTERM"], marks=pytest.mark.slow),
        ["SIGTERM", "SIGTERM"],
        ["SIGINT", "SIGINT"],
        pytest.param(["SIGHUP"], marks=pytest.mark.slow),
    ],
)
def test_signals_right_after_the_start_leave_nothing(tmp_path, signals):
    program = (
        "import os, signal, sys\n"
        "signal.signal(signal.SIGHUP, signal.SIG_DFL)\n"
        "from relight.app.serving import serve\n"
        "serve(None, 0, lambda address: print(address, flush=True))\n"
    )
    process = subprocess.Popen(
        [sys.executable, "-c", program], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        env={**os.environ, "TMPDIR": str(tmp_path)},
    )  # fmt: skip
    assert process.stdout.readline().startswith("http")
    for name in signals:
        process.send_signal(getattr(__import__("signal"), name))
        time.sleep(0.2)
    _, said = process.communicate(timeout=120)
    assert not list(tmp_path.iterdir())
    assert said.count("Traceback") <= ("SIGINT" in signals)  # of the interruption, which the command catches
    assert "CancelledError" not in said
