"""Streams copied to temporary files, so that they can be read several times."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from functools import partial
from typing import IO

from nlosctl.errors import DataError
from nlosctl.io.paths.inputs import Input, Part

__all__ = ["spooled"]

_BLOCK_BYTES = 1 << 20


@contextmanager
def spooled(inputs: Sequence[Input], most_bytes: int) -> Iterator[list[Input]]:
    """Provide the inputs with every stream that can be read only once copied to a temporary file.

    Raises DataError for a stream of more than ``most_bytes``, or if the file cannot be written.
    """
    with ExitStack() as files:

        def copied(part: Part) -> Part:
            if part.stream is None or part.reopen is not None:
                return part
            file = files.enter_context(tempfile.TemporaryFile())
            _copy(part, file, most_bytes)
            return replace(part, reopen=partial(_from_start, file)).again()

        yield [replace(given, parts=tuple(map(copied, given.parts))) for given in inputs]


def _copy(part: Part, file: IO[bytes], most_bytes: int) -> None:
    count = 0
    assert part.stream is not None  # noqa: S101 - a stream
    with part.stream as stream:
        while block := stream.read(_BLOCK_BYTES):
            count += len(block)
            if count > most_bytes:
                raise DataError(
                    f"{part.name}: more than {most_bytes} bytes, which several passes need in a temporary file; save "
                    "it as a file and name that, or raise `max_spool_bytes`"
                )
            try:
                file.write(block)
                file.flush()
            except OSError as error:
                folder = tempfile.gettempdir()
                raise DataError(
                    f"{part.name}: can't be copied to a temporary file in {folder}: {error.strerror or error}; save it "
                    "as a file and name that, or set TMPDIR"
                ) from error


def _from_start(file: IO[bytes]) -> IO[bytes]:
    """Return the file opened again at its start; the two share their position."""
    again = os.fdopen(os.dup(file.fileno()), "rb")
    again.seek(0)
    return again
