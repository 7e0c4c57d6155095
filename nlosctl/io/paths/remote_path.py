"""A file or folder in a store, named by a URL, with the methods of `pathlib.Path` that this package uses."""

from __future__ import annotations

import errno
import hashlib
import io
import os
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path, PurePosixPath
from typing import Any, NamedTuple

from nlosctl.errors import hide_secrets
from nlosctl.io.paths.stores import SHOWING_AT_CLOSE, answering, filesystem_of

__all__ = ["HTTP", "RemotePath"]

HTTP = ("http", "https")
"""Schemes whose query belongs to one file, often as its signature, and not to the store."""

_BUFFER_BYTES = 1 << 20


class _Status(NamedTuple):
    """The fields of `os.stat_result` that a store knows; ``st_ino`` is a hash of the file's version."""

    st_size: int
    st_mtime_ns: int
    st_ino: int


@dataclass(frozen=True)
class RemotePath:
    """A file or folder in a store, with the interface of `pathlib.Path`.

    ``url`` has no slash at its end; ``query`` (``?region=...``) goes to the filesystem, that of http to the server with
    the name of this file alone. It can be pickled: a process opens its own connection. Methods raise OSError for an
    error of the store, UsageError for an unknown scheme.
    """

    url: str
    query: str = ""

    def __str__(self) -> str:
        return self.url + self.query

    def __repr__(self) -> str:
        return f"RemotePath({self.shown!r})"

    @property
    def shown(self) -> str:
        """The URL for results and messages, without its secrets."""
        return hide_secrets(str(self))

    @property
    def owns_query(self) -> bool:
        """Whether there is a query of this file alone, so that files beside it cannot be read."""
        return bool(self.query) and self._is_http

    @property
    def _is_http(self) -> bool:
        return self.url.partition("://")[0].lower() in HTTP

    @property
    def _query_beside(self) -> str:
        """The query of files beside or below this one."""
        return "" if self._is_http else self.query

    @property
    def parts(self) -> tuple[str, ...]:
        """The bucket or host, and the steps below it."""
        return tuple(self.url.partition("://")[2].split("/"))

    @property
    def name(self) -> str:
        """The last step."""
        return self.parts[-1]

    @property
    def stem(self) -> str:
        """The last step without its last suffix."""
        return PurePosixPath(self.name).stem

    @property
    def suffixes(self) -> list[str]:
        """All suffixes of the last step."""
        return PurePosixPath(self.name).suffixes

    @property
    def parent(self) -> RemotePath:
        """The folder; a bucket is its own parent."""
        return self if len(self.parts) == 1 else RemotePath(self.url.rpartition("/")[0], self._query_beside)

    def __truediv__(self, step: str) -> RemotePath:
        return RemotePath(f"{self.url}/{step}", self._query_beside)

    def with_name(self, name: str) -> RemotePath:
        """Return the location with this name in the same folder."""
        return self.parent / name

    def absolute(self) -> RemotePath:
        """Return itself: a URL does not depend on the current folder."""
        return self

    def resolve(self) -> RemotePath:
        """Return itself: stores have no links."""
        return self

    @property
    def top(self) -> RemotePath:
        """The bucket or host."""
        return self.parents[-1] if self.parents else self

    @property
    def parents(self) -> list[RemotePath]:
        """The folders above, the nearest first."""
        above = [self.parent] if self.parent != self else []
        return [*above, *(above[0].parents if above else [])]

    def exists(self) -> bool:
        """Return whether there is a file or folder."""
        return self.is_file() or self.is_dir()

    def is_file(self) -> bool:
        """Return whether there is a file."""
        return bool(self._information().is_file)

    def is_dir(self) -> bool:
        """Return whether there is a folder: something whose name begins with this one and a slash."""
        return str(self._information().type.name) == "Directory"

    def stat(self) -> _Status:
        """Return size and time of a file."""
        information = self._information()
        if not information.is_file:
            raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), str(self))
        return _status(information, self._entity_tag() if information.mtime_ns is None else "")

    def open(self, mode: str = "rb") -> io.BufferedReader:
        """Open the file for reading its bytes, back and forth."""
        file: Any = self.open_native()
        return io.BufferedReader(file, _BUFFER_BYTES)

    def open_native(self) -> Any:
        """Open the file for pyarrow."""
        filesystem, path = self._filesystem_path()
        with answering(str(self)):
            return filesystem.open_input_file(path)

    def files(self, *, recursive: bool) -> list[tuple[RemotePath, tuple[str, ...], _Status]]:
        """Return the files in the folder, sorted by name: each with its steps below the folder, and its status."""
        from pyarrow.fs import FileSelector

        filesystem, path = self._filesystem_path()
        with answering(str(self)):
            infos = filesystem.get_file_info(FileSelector(path, recursive=recursive, allow_not_found=True))
        listed = []
        for information in infos:
            if information.is_file:
                steps = tuple(information.path.removeprefix(path).strip("/").split("/"))
                file = RemotePath("/".join((self.url, *steps)), self._query_beside)
                tag = file._entity_tag() if information.mtime_ns is None else ""
                listed.append((file, steps, _status(information, tag)))
        return sorted(listed, key=lambda entry: entry[1])

    def glob_files(self) -> list[tuple[RemotePath, _Status]]:
        """Return the files that match this name as a pattern (``*``, ``**``, ``[ab]``), sorted."""
        steps = list(self.parts)
        first = next(index for index, step in enumerate(steps) if _has_magic(step))
        scheme = self.url.partition("://")[0]
        folder, pattern = RemotePath(f"{scheme}://{'/'.join(steps[:first])}", self.query), steps[first:]
        listed = folder.files(recursive=len(pattern) > 1 or pattern == ["**"])
        return [(path, status) for path, below, status in listed if _matches(below, tuple(pattern))]

    @property
    def has_magic(self) -> bool:
        """Whether the name is a pattern."""
        return any(map(_has_magic, self.parts[1:]))

    def has_bucket(self) -> bool:
        """Return whether its bucket or host exists; fsspec's stores may create it."""
        from pyarrow.fs import PyFileSystem

        return isinstance(self._filesystem_path()[0], PyFileSystem) or self.top.is_dir()

    def take(self, file: Path) -> None:
        """Upload a complete local file to this name; an existing file stays until the new one is complete."""
        from pyarrow.fs import LocalFileSystem, PyFileSystem, copy_files

        filesystem, path = self._filesystem_path()
        with answering(str(self)):
            if isinstance(filesystem, PyFileSystem):
                filesystem.handler.fs.put_file(str(file), path)
                return
            # one call without Python code in it, so that an interrupt comes before or after it
            shows_at_close = filesystem.type_name in SHOWING_AT_CLOSE
            hidden = self.with_name(f".{self.name[:100]}.{os.getpid()}.part")
            first = path if shows_at_close else hidden._filesystem_path()[1]
            local = LocalFileSystem()
            copy_files(str(file), first, source_filesystem=local, destination_filesystem=filesystem)
            if not shows_at_close:
                if self.is_file():
                    filesystem.delete_file(path)
                filesystem.move(first, path)

    def read_text(self, encoding: str) -> str:
        """Return the text of a file."""
        with self.open() as file:
            return file.read().decode(encoding)

    def iterdir(self) -> list[RemotePath]:
        """Return the content of the folder, sorted by name."""
        from pyarrow.fs import FileSelector

        filesystem, path = self._filesystem_path()
        with answering(str(self)):
            infos = filesystem.get_file_info(FileSelector(path, allow_not_found=True))
        return [self / name for name in sorted(information.base_name for information in infos)]

    def mkdir(self, *, parents: bool = True, exist_ok: bool = True) -> None:
        """Make the folder and its parents in stores that have folders."""
        filesystem, path = self._filesystem_path()
        if filesystem.type_name not in SHOWING_AT_CLOSE:
            with answering(str(self)):
                filesystem.create_dir(path, recursive=True)

    def unlink(self, *, missing_ok: bool = True) -> None:
        """Remove the file if it exists."""
        filesystem, path = self._filesystem_path()
        if self.is_file():
            with answering(str(self)):
                filesystem.delete_file(path)

    def rmdir(self) -> None:
        """Remove the folder; raise OSError if it is not empty."""
        if self.iterdir():
            raise OSError(errno.ENOTEMPTY, os.strerror(errno.ENOTEMPTY), str(self))
        self.remove_all()

    def remove_all(self) -> None:
        """Remove the folder and its content."""
        filesystem, path = self._filesystem_path()
        if self.is_dir():
            with answering(str(self)):
                filesystem.delete_dir(path)

    def _information(self) -> Any:
        filesystem, path = self._filesystem_path()
        with answering(str(self)):
            return filesystem.get_file_info(path)

    def _entity_tag(self) -> str:
        """Return fsspec's identifier of the version of a file, for stores without modification times in pyarrow."""
        filesystem, path = self._filesystem_path()
        with answering(str(self)):
            return str(filesystem.handler.fs.ukey(path)) if hasattr(filesystem, "handler") else ""

    def _filesystem_path(self) -> tuple[Any, str]:
        scheme, _, rest = self.url.partition("://")
        authority, _, below = rest.partition("/")
        with answering(str(self)):
            filesystem, base = filesystem_of(os.getpid(), scheme.lower(), authority, self._query_beside)
        path = f"{base.rstrip('/')}/{below}" if below else base
        return filesystem, f"{path}{self.query}" if self._is_http else path


def _status(information: Any, tag: str) -> _Status:
    number = int(hashlib.sha256(tag.encode()).hexdigest()[:15], 16) if tag else 0
    return _Status(int(information.size or 0), int(information.mtime_ns or 0), number)


def _has_magic(step: str) -> bool:
    return "*" in step or "[" in step


def _matches(steps: tuple[str, ...], pattern: tuple[str, ...]) -> bool:
    """Return whether the steps of a path match those of a pattern; hidden names need a leading dot, as in a shell."""
    if not pattern or not steps:
        return not steps and all(step == "**" for step in pattern)
    if pattern[0] == "**" and _matches(steps, pattern[1:]):
        return True
    if steps[0].startswith(".") and not pattern[0].startswith("."):
        return False
    if pattern[0] == "**":
        return _matches(steps[1:], pattern)
    return fnmatchcase(steps[0], pattern[0]) and _matches(steps[1:], pattern[1:])
