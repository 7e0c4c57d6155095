"""Opening files of other programs."""

from __future__ import annotations

import shutil
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from typing import IO, Any

from nlosctl.errors import DataError
from nlosctl.io.paths.locations import Location, location, near_name, require_utf8

__all__ = ["foreign_path", "open_foreign"]

_IN_MEMORY_BYTES = 64 << 20


def foreign_path(word: str) -> Location | None:
    """Return the path of a file, None for stdin (``-``); raise DataError where there is no such file."""
    if word == "-":
        return None
    path = location(word)
    if path.is_dir():
        raise DataError(f"{word}: is a folder, expected a file; name its files, or let the shell: {word.rstrip('/')}/*")
    if not path.exists():
        raise DataError(f"{word}: there is no such file{near_name(path)}")
    require_utf8(word)
    return path


@contextmanager
def open_foreign(word: str) -> Iterator[IO[bytes]]:
    """Open a file, or stdin, as bytes in which a reader can go back; raise DataError where it can't be read."""
    path = foreign_path(word)
    try:
        if path is not None and path.is_file():
            with path.open("rb") as file:
                yield file
            return
        source: Any = sys.stdin.buffer if path is None else path.open("rb")
        with tempfile.SpooledTemporaryFile(max_size=_IN_MEMORY_BYTES) as spooled:
            shutil.copyfileobj(source, spooled)
            spooled.seek(0)
            yield spooled
    except OSError as error:
        raise DataError(f"{word}: can't be read: {error.strerror or error}") from error
