"""Programs in processes of their own that begin with torch imported: elsewhere that takes each two seconds.

They are forks of a server that has imported what `PRELOADED` names. It runs no network, so it has no threads.
"""

import multiprocessing
import os
import runpy
import sys
import threading
from contextlib import contextmanager
from multiprocessing.connection import Listener
from pathlib import Path
from tempfile import NamedTemporaryFile

# A process has one server: it begins with what `shadow.lightstage.stage` forks as well.
PRELOADED = ["shadow.lightstage.stage", "relight.pipeline.render", "relight.pipeline.analyse"]
SERVER = multiprocessing.get_context("forkserver")
CLIENT = """#!{python} -IS
import os, sys
from multiprocessing.connection import Client
with Client({address!r}) as server:
    server.send((sys.argv[1:], os.getcwd(), dict(os.environ)))
    status, printed = server.recv()
print(printed, end="")
sys.exit(status)
"""


@contextmanager
def started(program, *arguments):
    """Start a program, the text of one in Python; yield its process and a file of what it prints."""
    SERVER.set_forkserver_preload(PRELOADED)
    reader, writer = SERVER.Pipe(duplex=False)
    process = SERVER.Process(target=_piped, args=(program, [*map(str, arguments)], writer))
    process.start()
    writer.close()
    with reader, os.fdopen(os.dup(reader.fileno())) as printed:
        yield process, printed
    process.join()


def _piped(program, arguments, writer):
    os.dup2(writer.fileno(), sys.stdout.fileno())
    sys.argv = ["-c", *arguments]
    exec(compile(program, "<program>", "exec"), {"__name__": "__main__"})


@contextmanager
def small_command(path):
    """Let a file be the command `relight`, with the networks on a small canvas, while the context lasts."""
    SERVER.set_forkserver_preload(PRELOADED)
    with Listener(family="AF_UNIX") as listener:
        threading.Thread(target=_serve, args=(listener,), daemon=True).start()
        Path(path).write_text(CLIENT.format(python=sys.executable, address=listener.address))
        Path(path).chmod(0o755)
        yield


def _serve(listener):
    """Answer each call of the command with its exit status and what it printed, in turn."""
    while True:
        try:
            client = listener.accept()
        except OSError:  # it was closed
            return
        with client, NamedTemporaryFile("r") as printed:
            process = SERVER.Process(target=_command, args=(*client.recv(), printed.name))
            process.start()
            process.join()
            client.send((process.exitcode, printed.read()))


def _command(arguments, folder, environment, printed):
    os.chdir(folder)
    os.environ.update(environment)
    with open(printed, "w") as file:
        for stream in (sys.stdout, sys.stderr):
            os.dup2(file.fileno(), stream.fileno())
    sys.argv = ["relight", *arguments]
    runpy.run_module("helpers.small_command")
