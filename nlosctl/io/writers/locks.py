"""Locks of folders into which one run at a time may write; they end with its process."""

from __future__ import annotations

import json
import os
import socket
import time
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Any

from nlosctl.errors import DataError
from nlosctl.io.writers.byte_output import try_lock

__all__ = ["WriterLock"]

_SECONDS_TO_END = 5.0
"""How long a lock may survive its process: until forked processes have noticed that it was killed."""


class WriterLock:
    """Context manager that holds the lock file ``path``, which names this process; ``what`` is locked, for messages.

    The lock ends with the process, however that ends. Where files cannot be locked, the file itself is the lock, and
    one of a process of this host that has ended is taken over. The folder of ``path`` is made if it is missing.
    Raises DataError if another process holds the lock, OSError if the file can't be written.
    """

    def __init__(self, path: Path, what: str) -> None:
        self._path, self._what = path, what
        self._descriptor: int | None = None
        self._made_folder = False

    def __enter__(self) -> WriterLock:
        self._made_folder = not self._path.parent.exists()
        self._path.parent.mkdir(exist_ok=True)
        deadline = time.monotonic() + _SECONDS_TO_END
        while self._descriptor is None:
            self._descriptor = self._attempt(is_last=time.monotonic() > deadline)
        os.truncate(self._descriptor, 0)
        os.pwrite(self._descriptor, json.dumps({"pid": os.getpid(), "host": socket.gethostname()}).encode(), 0)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        with suppress(OSError):
            self._path.unlink()
        if self._descriptor is not None:
            os.close(self._descriptor)
            self._descriptor = None
        if self._made_folder:
            with suppress(OSError):  # not empty
                self._path.parent.rmdir()

    def _attempt(self, *, is_last: bool) -> int | None:
        """Return the descriptor of the locked file, or None to try again; raise DataError if another process runs."""
        is_new, descriptor = self._opened()
        if descriptor is None:
            return None
        keeps = False
        try:
            locked = try_lock(descriptor)
            if locked and self._is_current(descriptor):
                keeps = True
            elif locked is None:
                keeps = is_new or self._taken_over(descriptor)
            elif locked is False:
                self._await_end(_holder(descriptor), is_last=is_last)
        finally:
            if not keeps:
                os.close(descriptor)
        return descriptor if keeps else None

    def _opened(self) -> tuple[bool, int | None]:
        try:
            return True, os.open(self._path, os.O_RDWR | os.O_CREAT | os.O_EXCL, 0o666)
        except FileExistsError:
            with suppress(FileNotFoundError):  # its holder has just ended
                return False, os.open(self._path, os.O_RDWR)
        return False, None

    def _is_current(self, descriptor: int) -> bool:
        """Return whether the path still names the open file, which its holder may have removed in the meantime."""
        with suppress(FileNotFoundError):
            return os.path.samestat(os.fstat(descriptor), self._path.stat())
        return False

    def _taken_over(self, descriptor: int) -> bool:
        holder = _holder(descriptor)
        if not _has_ended(holder):
            raise DataError(f"{self._message(holder)}; if it has ended, remove {self._path}")
        return True

    def _await_end(self, holder: dict[str, Any], *, is_last: bool) -> None:
        """Give a process that has just started, or was just killed, time to write its name, or to end."""
        if is_last or not (_has_ended(holder) or not holder):
            raise DataError(self._message(holder))
        time.sleep(0.02)

    def _message(self, holder: dict[str, Any]) -> str:
        by = f"process {holder['pid']} on {holder['host']}" if holder else "a process that did not write its name"
        return f"{self._what}: another run writes here ({by}); wait until it ends, or write to another folder"


def _holder(descriptor: int) -> dict[str, Any]:
    """Return process and host in a lock file; nothing while they are being written."""
    try:
        holder = json.loads(os.pread(descriptor, 1000, 0))
        return {"pid": int(holder["pid"]), "host": str(holder["host"])}
    except (ValueError, KeyError, TypeError):
        return {}


def _has_ended(holder: dict[str, Any]) -> bool:
    """Return whether a process is known to have ended: it ran on this host, and is gone."""
    if not holder or holder["host"] != socket.gethostname():
        return False
    try:
        os.kill(holder["pid"], 0)
    except ProcessLookupError:
        return True
    except (OSError, OverflowError):
        return False
    return False
