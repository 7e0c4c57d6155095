"""Opening a text input as bytes, gzipped or not."""

from __future__ import annotations

import gzip
import io
from collections.abc import Iterator
from contextlib import contextmanager
from typing import IO, Any, cast

from nlosctl.contract.limits import limit, refusal_hint
from nlosctl.errors import DataError
from nlosctl.io.paths.inputs import Part
from nlosctl.io.paths.locations import Location

__all__ = ["FREE_EXPANSION_BYTES", "closed_on_failure", "expansion_fault", "open_bytes"]

_BUFFER_BYTES = 1 << 17

FREE_EXPANSION_BYTES = 256 << 20
"""What unpacks to less than this may have been packed as well as it pleases."""


def open_bytes(part: Part) -> IO[bytes]:
    """Return the bytes of ``part``, unzipped where its format says so; raises OSError where it can't be opened."""
    stream: Any = part.stream if part.stream is not None else cast(Location, part.path).open("rb")
    if part.format.compressed:
        stream = io.BufferedReader(_Unzipped(stream, part.name), _BUFFER_BYTES)
    return cast(IO[bytes], stream)


class _Unzipped(io.RawIOBase):
    """The content of a gzipped stream; raises DataError where it grows beyond the limit ``expansion``."""

    def __init__(self, zipped: IO[bytes], name: str) -> None:
        self._counted = _Counted(zipped)
        self._file = gzip.GzipFile(fileobj=cast(Any, self._counted))
        self._name, self._most, self._given = name, limit("expansion"), 0

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: Any) -> int:
        got = self._file.read1(len(buffer))
        buffer[: len(got)] = got
        self._given += len(got)
        if self._given > FREE_EXPANSION_BYTES and self._given > self._most * self._counted.taken:
            raise DataError(expansion_fault(self._name, self._most))
        return len(got)

    def close(self) -> None:
        super().close()
        self._file.close()
        self._counted.zipped.close()


class _Counted:
    """A stream that counts what is read from it."""

    def __init__(self, zipped: IO[bytes]) -> None:
        self.zipped = zipped
        self.taken = 0

    def read(self, size: int = -1) -> bytes:
        got = self.zipped.read(size)
        self.taken += len(got)
        return got


def expansion_fault(name: str, most: int) -> str:
    """Return what to say of a file that grows too much when it is unpacked."""
    return f"{name}: unpacks to more than {most} times its size: no honest table does; {refusal_hint('expansion')}"


@contextmanager
def closed_on_failure(stream: IO[bytes]) -> Iterator[None]:
    """Close ``stream`` if the block raises."""
    try:
        yield
    except BaseException:
        stream.close()
        raise
