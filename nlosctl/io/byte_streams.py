"""Opening a text input as bytes, gzipped or not."""

from __future__ import annotations

import gzip
from collections.abc import Iterator
from contextlib import contextmanager
from typing import IO, Any, cast

from nlosctl.io.inputs import Part

__all__ = ["closed_on_failure", "open_bytes"]


def open_bytes(part: Part) -> IO[bytes]:
    """Return the bytes of ``part``, unzipped where its format says so; raises OSError where it can't be opened."""
    if part.stream is not None:
        unzipped: Any = gzip.GzipFile(fileobj=part.stream) if part.format.compressed else part.stream
    else:
        opener = gzip.open if part.format.compressed else open
        unzipped = opener(cast(Any, part.path), "rb")
    return cast(IO[bytes], unzipped)


@contextmanager
def closed_on_failure(stream: IO[bytes]) -> Iterator[None]:
    """Close ``stream`` if the block raises."""
    try:
        yield
    except BaseException:
        stream.close()
        raise
