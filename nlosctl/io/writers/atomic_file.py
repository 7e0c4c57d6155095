"""A file in the making: bytes go to a temporary file, which takes the output's name at the end, or goes."""

from __future__ import annotations

import os
import secrets
import tempfile
import weakref
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO

from nlosctl.errors import DataError
from nlosctl.io.paths.locations import RemotePath, location

__all__ = ["NewFile", "writing"]


class NewFile:
    """The file ``target`` to be; ``sink`` takes its bytes. Nothing is under its name before `keep`.

    The temporary file lies beside it, for a URL in the system's folder for such. It goes with this object at the
    latest, wherever a run is interrupted. Raises OSError where it can't be made.
    """

    def __init__(self, target: str) -> None:
        self._place = location(target).resolve()
        folder = Path(tempfile.gettempdir()) if isinstance(self._place, RemotePath) else self._place.parent
        self._temporary: Path = folder / f".{self._place.name[:100]}.{secrets.token_hex(4)}.part"
        self._clear_away = weakref.finalize(self, _remove, self._temporary, os.getpid())
        self.sink: IO[bytes] = self._temporary.open("xb")

    def complete(self) -> None:
        """Take no more bytes, and see that the disk has them all: what is left is to take the name."""
        if not self.sink.closed:
            self.sink.flush()
            os.fsync(self.sink.fileno())
            self.sink.close()

    def keep(self) -> None:
        """Put the file in its place, whole; what was there is replaced."""
        self.complete()
        if isinstance(self._place, RemotePath):
            self._place.take(self._temporary)
            self._clear_away()
        else:
            self._temporary.replace(self._place)

    def discard(self) -> None:
        """Leave nothing of it."""
        with suppress(OSError):  # what waits to be written can't be, on a full disk: the file is given up anyway
            self.sink.close()
        self._clear_away()


@contextmanager
def writing(target: str) -> Iterator[None]:
    """Turn the faults of writing into a DataError that names the output; a closed pipe stays what it is."""
    try:
        yield
    except BrokenPipeError:
        raise
    except OSError as error:
        name = "standard output" if target == "-" else target
        raise DataError(f"{name}: can't be written: {error.strerror or error}") from error


def _remove(path: Path, maker: int) -> None:
    if os.getpid() == maker:  # a process forked meanwhile has nothing to clear away
        with suppress(OSError):
            path.unlink()
