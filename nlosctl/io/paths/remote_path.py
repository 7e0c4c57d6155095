"""A file or folder of a store, named by a URL, that does what `io` asks of a path."""

from __future__ import annotations

import errno
import hashlib
import io
import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from fnmatch import fnmatchcase
from functools import lru_cache
from importlib import import_module
from pathlib import Path, PurePosixPath
from typing import Any, NamedTuple

from nlosctl.errors import MissingExtraError, NlosctlError, UsageError, did_you_mean

__all__ = ["SHOWING_AT_CLOSE", "RemotePath", "answering", "filesystem_of"]

SHOWING_AT_CLOSE = ("s3", "gcs", "abfs")

"""pyarrow's names of the stores in which a file is there when it is closed, whole, and folders are parts of names."""

_OF_PYARROW = ("s3", "gs", "gcs", "hdfs", "viewfs", "abfs", "abfss")


@lru_cache(maxsize=64)
def filesystem_of(process: int, scheme: str, authority: str, query: str) -> tuple[Any, str]:
    """Return the filesystem of a bucket or host, and the path of its top; connections are not shared by processes."""
    from pyarrow.fs import FileSystem, FSSpecHandler, PyFileSystem

    root = f"{scheme}://{authority}"
    if scheme in _OF_PYARROW:
        region = os.environ.get("AWS_REGION") or os.environ.get("AWS_DEFAULT_REGION")
        if scheme == "s3" and region and "region=" not in query:  # else AWS is asked where the bucket is
            query = f"{query}&region={region}" if query else f"?region={region}"
        filesystem, base = FileSystem.from_uri(root + query)
        return filesystem, str(base)
    try:
        fsspec: Any = import_module("fsspec")
    except ImportError:
        raise MissingExtraError(f"reading {scheme}:// URLs", "fsspec", "dask") from None
    known = {*_OF_PYARROW, "file", *fsspec.available_protocols()}
    if scheme not in known:
        raise UsageError(
            f"{root}: unknown scheme {scheme!r}{did_you_mean(scheme, sorted(known))}; there are s3, gs, hdfs, abfs, "
            f"file and those of fsspec"
        )
    filesystem, base = fsspec.core.url_to_fs(root)
    return PyFileSystem(FSSpecHandler(filesystem)), str(base)


@contextmanager
def answering(name: str) -> Iterator[None]:
    """Turn whatever a store or its library raises into an OSError of one line."""
    try:
        yield
    except (NlosctlError, FileExistsError):
        raise
    except FileNotFoundError as error:
        raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), name) from error
    except Exception as error:
        if isinstance(error, OSError) and error.filename == name:
            raise
        said = " ".join((str(error).strip().splitlines() or [type(error).__name__])[0].split())
        raise OSError(errno.EIO, f"{said}{_cure(said)}", name) from error


def _cure(said: str) -> str:
    if re.search(r"ACCESS_DENIED|credential|anonymous|forbidden|\b40[13]\b", said, re.IGNORECASE):
        return "; are there credentials in the environment or the store's configuration file?"
    if "libjvm" in said or "libhdfs" in said:
        return "; hdfs:// needs Java and Hadoop's client: set JAVA_HOME, HADOOP_HOME and CLASSPATH"
    if "resolving region" in said or "NETWORK_CONNECTION" in said:
        return "; is the name right, and the network there? AWS_REGION and AWS_ENDPOINT_URL name a store of one's own"
    return ""


_BUFFER_BYTES = 1 << 20


class _Status(NamedTuple):
    """What `os.stat_result` tells, as far as a store knows it; ``st_ino`` is made of what else changes with a file."""

    st_size: int
    st_mtime_ns: int
    st_ino: int


@dataclass(frozen=True)
class RemotePath:
    """A file or folder of a store, named as `pathlib.Path` names things.

    ``url`` has no slash at its end; ``query`` (``?region=...``) goes to the filesystem. It can be pickled: a process
    opens its own connection. Methods raise OSError where the store does not answer as hoped, UsageError for an unknown
    scheme.
    """

    url: str
    query: str = ""

    def __str__(self) -> str:
        return self.url + self.query

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
        """The folder that it is in; a bucket is its own."""
        return self if len(self.parts) == 1 else RemotePath(self.url.rpartition("/")[0], self.query)

    def __truediv__(self, step: str) -> RemotePath:
        return RemotePath(f"{self.url}/{step}", self.query)

    def with_name(self, name: str) -> RemotePath:
        """Return what stands beside it under another name."""
        return self.parent / name

    def absolute(self) -> RemotePath:
        """Return itself: a URL depends on no current folder."""
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
        found = self._information()
        if not found.is_file:
            raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), str(self))
        return _status(found, self._entity_tag() if found.mtime_ns is None else "")

    def samefile(self, other: object) -> bool:
        """Return whether the other is the same place."""
        return self == other

    def open(self, mode: str = "rb") -> io.BufferedReader:
        """Open the file for reading its bytes, back and forth."""
        file: Any = self.open_native()
        return io.BufferedReader(file, _BUFFER_BYTES)

    def open_native(self) -> Any:
        """Open the file for pyarrow."""
        filesystem, place = self._place()
        with answering(str(self)):
            return filesystem.open_input_file(place)

    def files(self, *, recursive: bool) -> list[tuple[RemotePath, tuple[str, ...], _Status]]:
        """Return the files of the folder, sorted by name: each with its steps below the folder, and its status."""
        from pyarrow.fs import FileSelector

        filesystem, place = self._place()
        with answering(str(self)):
            found = filesystem.get_file_info(FileSelector(place, recursive=recursive, allow_not_found=True))
        listed = []
        for information in found:
            if information.is_file:
                steps = tuple(information.path.removeprefix(place).strip("/").split("/"))
                path = RemotePath("/".join((self.url, *steps)), self.query)
                tag = path._entity_tag() if information.mtime_ns is None else ""
                listed.append((path, steps, _status(information, tag)))
        return sorted(listed, key=lambda entry: entry[1])

    def glob_files(self) -> list[tuple[RemotePath, _Status]]:
        """Return the files that this name, taken as a pattern (``*``, ``**``, ``[ab]``), matches, sorted."""
        steps = list(self.parts)
        first = next(place for place, step in enumerate(steps) if _has_magic(step))
        scheme = self.url.partition("://")[0]
        folder, pattern = RemotePath(f"{scheme}://{'/'.join(steps[:first])}", self.query), steps[first:]
        listed = folder.files(recursive=len(pattern) > 1 or pattern == ["**"])
        return [(path, status) for path, below, status in listed if _matches(below, tuple(pattern))]

    @property
    def has_magic(self) -> bool:
        """Whether the name is a pattern."""
        return any(map(_has_magic, self.parts[1:]))

    def has_bucket(self) -> bool:
        """Return whether there is the bucket, or the host, that it is in; fsspec's stores are trusted to make it."""
        from pyarrow.fs import PyFileSystem

        return isinstance(self._place()[0], PyFileSystem) or self.top.is_dir()

    def take(self, file: Path) -> None:
        """Put a whole file of this machine under this name; what was there stays until the new one is whole."""
        from pyarrow.fs import LocalFileSystem, PyFileSystem, copy_files

        filesystem, place = self._place()
        with answering(str(self)):
            if isinstance(filesystem, PyFileSystem):
                filesystem.handler.fs.put_file(str(file), place)
                return
            # one call without a word of Python in it: an interrupt comes before or after, never in its midst
            shows_at_close = filesystem.type_name in SHOWING_AT_CLOSE
            hidden = self.with_name(f".{self.name[:100]}.{os.getpid()}.part")
            first = place if shows_at_close else hidden._place()[1]
            local = LocalFileSystem()
            copy_files(str(file), first, source_filesystem=local, destination_filesystem=filesystem)
            if not shows_at_close:
                if self.is_file():
                    filesystem.delete_file(place)
                filesystem.move(first, place)

    def read_text(self, encoding: str) -> str:
        """Return the text of a file."""
        with self.open() as file:
            return file.read().decode(encoding)

    def iterdir(self) -> list[RemotePath]:
        """Return what is in the folder, sorted by name."""
        from pyarrow.fs import FileSelector

        filesystem, place = self._place()
        with answering(str(self)):
            found = filesystem.get_file_info(FileSelector(place, allow_not_found=True))
        return [self / name for name in sorted(information.base_name for information in found)]

    def mkdir(self, *, parents: bool = True, exist_ok: bool = True) -> None:
        """Make the folder, and those above, where a store has folders; in others they are parts of names."""
        filesystem, place = self._place()
        if filesystem.type_name not in SHOWING_AT_CLOSE:
            with answering(str(self)):
                filesystem.create_dir(place, recursive=True)

    def unlink(self, *, missing_ok: bool = True) -> None:
        """Remove the file if it is there."""
        filesystem, place = self._place()
        if self.is_file():
            with answering(str(self)):
                filesystem.delete_file(place)

    def rmdir(self) -> None:
        """Remove the folder; raise OSError where something is in it."""
        if self.iterdir():
            raise OSError(errno.ENOTEMPTY, os.strerror(errno.ENOTEMPTY), str(self))
        self.remove_all()

    def remove_all(self) -> None:
        """Remove the folder and all that is in it."""
        filesystem, place = self._place()
        if self.is_dir():
            with answering(str(self)):
                filesystem.delete_dir(place)

    def _information(self) -> Any:
        filesystem, place = self._place()
        with answering(str(self)):
            return filesystem.get_file_info(place)

    def _entity_tag(self) -> str:
        """Return what fsspec tells of the version of a file, for stores that tell pyarrow no time."""
        filesystem, place = self._place()
        with answering(str(self)):
            return str(filesystem.handler.fs.ukey(place)) if hasattr(filesystem, "handler") else ""

    def _place(self) -> tuple[Any, str]:
        scheme, _, rest = self.url.partition("://")
        authority, _, below = rest.partition("/")
        with answering(str(self)):
            filesystem, base = filesystem_of(os.getpid(), scheme.lower(), authority, self.query)
        return filesystem, f"{base.rstrip('/')}/{below}" if below else base


def _status(information: Any, tag: str) -> _Status:
    number = int(hashlib.sha256(tag.encode()).hexdigest()[:15], 16) if tag else 0
    return _Status(int(information.size or 0), int(information.mtime_ns or 0), number)


def _has_magic(step: str) -> bool:
    return "*" in step or "[" in step


def _matches(steps: tuple[str, ...], pattern: tuple[str, ...]) -> bool:
    """Return whether the steps of a path match those of a pattern; hidden ones only where it says so, as in a shell."""
    if not pattern or not steps:
        return not steps and all(step == "**" for step in pattern)
    if pattern[0] == "**" and _matches(steps, pattern[1:]):
        return True
    if steps[0].startswith(".") and not pattern[0].startswith("."):
        return False
    if pattern[0] == "**":
        return _matches(steps[1:], pattern)
    return fnmatchcase(steps[0], pattern[0]) and _matches(steps[1:], pattern[1:])
