"""Where a file is: a path on this machine, or a URL (``s3://bucket/key``) that does what reading asks of a path.

A path on this machine imports nothing.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit
from urllib.request import url2pathname

from nlosctl.errors import DataError, UsageError, did_you_mean
from nlosctl.io.paths.remote_path import RemotePath

__all__ = [
    "Location",
    "Mark",
    "RemotePath",
    "is_remote",
    "location",
    "mark_of",
    "mark_of_status",
    "names_folder",
    "near_name",
    "pyarrow_source",
    "require_utf8",
]

_URL = re.compile(r"([A-Za-z][A-Za-z0-9+.-]+)://([^?]*)(\?\w+=.*)?", re.DOTALL)

Location = Path | RemotePath


def is_remote(word: str) -> bool:
    """Return whether a word names a file elsewhere: a URL of another scheme than ``file``."""
    found = _URL.fullmatch(word)
    return found is not None and found[1].lower() != "file"


def names_folder(word: str) -> bool:
    """Return whether a path or URL ends with a slash (before its ``?region=...``)."""
    found = _URL.fullmatch(word)
    return (word if found is None else found[2]).endswith("/")


def location(word: str) -> Location:
    """Return the place that a path or URL names; ``file://`` URLs are paths.

    Raises UsageError for what can't be a name: nothing, or with a zero byte or a password in it.
    """
    if not word or "\0" in word:
        raise UsageError(f"{word!r} names no file; expected a path or a URL")
    found = _URL.fullmatch(word)
    if found is None:
        return Path(word)
    scheme, rest, query = found[1], found[2], found[3] or ""
    if scheme.lower() == "file":
        split = urlsplit(word)
        if split.netloc not in ("", "localhost"):
            raise UsageError(f"{word}: expected file:///FOLDER/NAME, a path of this machine")
        return Path(url2pathname(split.path))
    if ":" in rest.split("/")[0].rpartition("@")[0]:
        raise UsageError(
            f"{scheme}://...@{rest.split('/')[0].rpartition('@')[2]}: a password in a name would end up in results and "
            f"logs; give it in the environment or the store's own configuration file"
        )
    return RemotePath(f"{scheme}://{rest.rstrip('/')}", query)


def require_utf8(name: str) -> None:
    """Raise DataError where the name of an input is not UTF-8: results, which are, tell it."""
    try:
        name.encode("utf-8")
    except UnicodeEncodeError:
        raise DataError(
            f"{name}: the name is not UTF-8, and results tell the names of their inputs; rename it"
        ) from None


def near_name(path: Location) -> str:
    """Return `` (did you mean ...?)`` for the name in the same folder of this machine that is nearest, or nothing."""
    if isinstance(path, RemotePath) or not path.parent.is_dir():
        return ""
    return did_you_mean(path.name, [entry.name for entry in path.parent.iterdir()])


def pyarrow_source(path: Location) -> Any:
    """Return what pyarrow opens: the name of a file of this machine, else the open file."""
    return str(path) if isinstance(path, Path) else path.open_native()


Mark = tuple[int, int, int]


def mark_of(path: Location) -> Mark | None:
    """Return what changes when a file does: its place on the disk, size and time; None where it is not there."""
    try:
        found = path.stat()
    except OSError:
        return None
    return mark_of_status(found)


def mark_of_status(found: Any) -> Mark:
    """Return the mark of what a ``stat`` has told."""
    return found.st_ino, found.st_size, found.st_mtime_ns
