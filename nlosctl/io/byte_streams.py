"""Opening a text input as bytes, gzipped or not."""

from __future__ import annotations

import gzip
from typing import IO, Any, cast

from nlosctl.io.inputs import Part

__all__ = ["open_bytes"]


def open_bytes(part: Part) -> IO[bytes]:
    """Return the bytes of ``part``, unzipped where its format says so; raises OSError where it can't be opened."""
    if part.stream is not None:
        unzipped: Any = gzip.GzipFile(fileobj=part.stream) if part.format.compressed else part.stream
    else:
        opener = gzip.open if part.format.compressed else open
        unzipped = opener(cast(Any, part.path), "rb")
    return cast(IO[bytes], unzipped)
