"""The program without its start: each ``nlosctl`` is a fork of a process that has imported everything."""

from __future__ import annotations

import array
import atexit
import gc
import importlib
import io
import json
import os
import pkgutil
import shutil
import signal
import socket
import struct
import subprocess
import sys
import tempfile
from functools import cache
from pathlib import Path

import nlosctl

__all__ = ["warm_path"]

_IMPORTED = ("matplotlib.backends.backend_agg", "matplotlib.backends.backend_svg", "matplotlib.pyplot")
"""Besides all modules of nlosctl."""

_CLIENT = """#!{python} -IS
import array, json, os, socket, sys
server = socket.socket(socket.AF_UNIX)
server.connect({address!r})
request = json.dumps([sys.argv[1:], os.getcwd(), dict(os.environ)]).encode()
streams = (socket.SOL_SOCKET, socket.SCM_RIGHTS, array.array("i", [0, 1, 2]))
server.sendmsg([len(request).to_bytes(8, "little")], [streams])
server.sendall(request)
code = int.from_bytes(server.recv(8), "little", signed=True)
if code < 0:
    os.kill(os.getpid(), -code)
os._exit(code)
"""


@cache
def warm_path() -> str:
    """Return a PATH on which ``nlosctl`` is such a fork, with its caller's arguments, folder, environment, streams."""
    folder = Path(tempfile.mkdtemp(prefix="nlosctl-warm-"))
    address = str(folder / "socket")
    server = subprocess.Popen([sys.executable, __file__, address], stdout=subprocess.PIPE, stdin=subprocess.DEVNULL)
    atexit.register(_stop, server, folder)
    assert server.stdout is not None
    with server.stdout as lines:
        assert lines.readline() == b"ready\n"
    (folder / "nlosctl").write_text(_CLIENT.format(python=sys.executable, address=address))
    (folder / "nlosctl").chmod(0o755)
    return os.pathsep.join([str(folder), str(Path(sys.executable).parent), os.environ["PATH"]])


def _stop(server: subprocess.Popen[bytes], folder: Path) -> None:
    server.kill()
    server.wait()
    shutil.rmtree(folder, ignore_errors=True)


def _serve(address: str) -> None:
    """Answer requests until this process is killed or its parent has gone."""
    modules = [module.name for module in pkgutil.walk_packages(nlosctl.__path__, "nlosctl.")]
    for name in (*modules, *_IMPORTED):
        importlib.import_module(name)
    gc.freeze()
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)
    with socket.socket(socket.AF_UNIX) as listening:
        listening.bind(address)
        listening.listen(64)
        listening.settimeout(5.0)
        parent = os.getppid()
        os.write(1, b"ready\n")
        while os.getppid() == parent:
            try:
                caller, _ = listening.accept()
            except TimeoutError:
                continue
            if os.fork() == 0:
                signal.signal(signal.SIGCHLD, signal.SIG_DFL)
                listening.close()
                _answer(caller)
            caller.close()


def _answer(caller: socket.socket) -> None:
    """Run one request in a fork of this fork, send its exit code, and end."""
    streams = array.array("i", [0, 0, 0])
    size, control, _, _ = caller.recvmsg(8, socket.CMSG_SPACE(streams.itemsize * 3))
    streams = array.array("i", control[0][2])
    with caller.makefile("rb") as received:
        words, folder, environment = json.loads(received.read(struct.unpack("<q", size)[0]))
    running = os.fork()
    if running == 0:
        caller.close()
        for number, stream in enumerate(streams):
            os.dup2(stream, number)
            os.close(stream)
        os.chdir(folder)
        os.environ.clear()
        os.environ.update(environment)
        _run(words)
    for stream in streams:
        os.close(stream)
    for number in range(3):
        os.close(number)
    code = os.waitstatus_to_exitcode(os.waitpid(running, 0)[1])
    caller.sendall(code.to_bytes(8, "little", signed=True))
    os._exit(0)


def _run(words: list[str]) -> None:
    """Run the program on the streams 0, 1 and 2, and end."""
    from nlosctl.cli.__main__ import main

    sys.argv = ["nlosctl", *words]
    sys.stdin = io.TextIOWrapper(io.BufferedReader(io.FileIO(0, "r", closefd=False)))
    sys.stdout = io.TextIOWrapper(io.BufferedWriter(io.FileIO(1, "w", closefd=False)))
    sys.stderr = io.TextIOWrapper(io.BufferedWriter(io.FileIO(2, "w", closefd=False)), line_buffering=True)
    sys.exit(main())


if __name__ == "__main__":
    _serve(sys.argv[1])
