"""The inputs of a run, expanded to files: each input is one logical table, with one or more parts."""

from __future__ import annotations

import bz2
import io
import shutil
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from glob import glob, has_magic
from pathlib import Path, PurePosixPath
from typing import IO, Any
from urllib.parse import unquote

import pyarrow as pa

from nlosctl.errors import DataError, UsageError
from nlosctl.io.paths.locations import (
    FileFormat,
    Location,
    Mark,
    RemotePath,
    format_of_bytes,
    format_of_path,
    is_local,
    known_format_of_path,
    location,
    mark_of,
    mark_of_status,
    near_name,
    require_utf8,
)

__all__ = ["Input", "Part", "expand_inputs"]

_SPOOL_IN_MEMORY_BYTES = 64 << 20
_HEAD_BYTES = 4096
_BLOCK_BYTES = 1 << 16
_LONGEST_BLOCK = 2 << 20
"""A block of bzip2 has at most 900 kB of content, one of zstd 128 kB."""
_HIVE_NULL = "__HIVE_DEFAULT_PARTITION__"


@dataclass(frozen=True, kw_only=True)
class Part:
    """One file of an input: its name for messages, its format, and a path or an open byte stream.

    ``row_groups`` (start, stop) restricts a Parquet file to some of its row groups. ``keys`` are the columns in the
    names of its folders (``year=2026``), None for a null. ``mark`` (see `mark_of`) is checked when the file is read.
    ``reopen`` returns the stream from its start, if that is possible.
    """

    name: str
    format: FileFormat
    path: Location | None = None
    stream: IO[bytes] | None = None
    row_groups: tuple[int, int] | None = None
    keys: tuple[tuple[str, str | None], ...] = ()
    mark: Mark | None = None
    reopen: Callable[[], Any] | None = None

    def again(self) -> Part:
        """Return the part to be read once more."""
        return self if self.reopen is None else replace(self, stream=self.reopen())


@dataclass(frozen=True, kw_only=True)
class Input:
    """One logical table: a file, or the parts of a folder; ``name`` is the name given by the user.

    ``url`` is what a URL names, whose secrets the name does not have. ``remarks`` are lines on what is not read.
    """

    name: str
    parts: tuple[Part, ...]
    url: RemotePath | None = None
    remarks: tuple[str, ...] = ()

    @property
    def path(self) -> Location | None:
        """The file or folder, None for stdin; a scene may be in the same folder."""
        return self.url or (None if self.parts[0].path is None else location(self.name))


def expand_inputs(
    arguments: Sequence[str], input_format: FileFormat | None = None, stdin: IO[bytes] | None = None
) -> list[Input]:
    """Return the inputs that ``arguments`` name: files, folders, globs, and ``-`` for stdin.

    ``input_format`` overrides extensions and first bytes; ``stdin`` replaces the real one. Raises DataError for a
    missing file or a folder without tables, UsageError for an unknown extension or an input given twice.
    """
    inputs = [given for argument in arguments for given in _expand(argument, input_format, stdin)]
    if not inputs:
        raise UsageError("no input is given; name a file, a folder, a glob, or - for stdin")
    names = [given.name for given in inputs]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise UsageError(f"input given twice: {', '.join(twice)}")
    return inputs


def _expand(argument: str, input_format: FileFormat | None, stdin: IO[bytes] | None) -> list[Input]:
    if argument == "-":
        return [_standard_input(input_format, stdin)]
    path = location(argument)
    if not is_local(path):
        return _remote(path, input_format)
    argument = str(path) if "://" in argument else argument
    if path.is_dir():
        return [_folder(argument, input_format)]
    if path.is_file():
        return [_file(argument, input_format)]
    if path.exists():  # a named pipe, such as <(...) in a shell
        require_utf8(argument)
        return [_stream(argument, argument, path.open("rb"), input_format)]
    if has_magic(argument):
        return _globbed(argument, input_format)
    raise DataError(f"{argument}: there is no such file{near_name(path)}")


def _remote(path: RemotePath, input_format: FileFormat | None) -> list[Input]:
    """Return the inputs that a URL names: a file, a folder (a prefix of names), or a pattern."""
    name = path.shown
    try:
        if path.has_magic:
            matches = path.glob_files()
            if not matches:
                raise DataError(f"{name}: no file matches this pattern")
            return [_remote_file(match, mark_of_status(status), input_format) for match, status in matches]
        if path.is_file():
            return [_remote_file(path, mark_of_status(path.stat()), input_format)]
        files = path.files(recursive=True)
        if not files:
            where = "" if path.has_bucket() else f": there is no {str(path.top)!r}"
            raise DataError(f"{name}: there is no such file or folder{where}")
    except OSError as error:
        raise DataError(f"{name}: can't be read: {error.strerror or error}") from error
    entries = [(entry, PurePosixPath(*steps), mark_of_status(status)) for entry, steps, status in files]
    return [replace(_of_parts(name, entries, input_format), url=path)]


def _remote_file(path: RemotePath, mark: Mark, input_format: FileFormat | None) -> Input:
    format = input_format or format_of_path(path.name)
    part = Part(name=path.shown, format=format, path=path, mark=mark)
    return Input(name=path.shown, parts=(part,), url=path)


def _file(name: str, input_format: FileFormat | None) -> Input:
    return Input(name=name, parts=(_part(name, input_format or format_of_path(name), Path(name)),))


def _part(name: str, format: FileFormat, path: Path) -> Part:
    require_utf8(name)
    return Part(name=name, format=format, path=path, mark=mark_of(path))


def _folder(name: str, input_format: FileFormat | None) -> Input:
    loops: list[str] = []
    files = [(path, PurePosixPath(path.relative_to(name).as_posix()), None) for path in _files_below(Path(name), loops)]
    given = _of_parts(name, files, input_format)
    return replace(given, remarks=(*given.remarks, *(f"{loop}: links to a folder that it is in" for loop in loops)))


def _files_below(folder: Path, loops: list[str], above: frozenset[tuple[int, int]] = frozenset()) -> Iterator[Path]:
    """Yield the files in a folder and its subfolders, linked ones too; links to a folder ``above`` go to ``loops``."""
    status = folder.stat()
    identity = status.st_dev, status.st_ino
    if identity in above:
        loops.append(str(folder))
        return
    for path in folder.iterdir():
        if path.is_dir():
            if not _is_hidden(path.name):
                yield from _files_below(path, loops, above | {identity})
        elif path.is_file():
            yield path


def _of_parts(
    name: str, files: Sequence[tuple[Location, PurePosixPath, Mark | None]], input_format: FileFormat | None
) -> Input:
    """Return the input of a folder with these files, each with its path below the folder, and its mark if known."""
    parts, others = [], Counter[str]()
    for path, relative, mark in sorted(files, key=lambda file: str(file[1])):
        known = known_format_of_path(path.name)
        if any(map(_is_hidden, relative.parts)):
            continue
        if known is None:
            others[relative.suffix or "no ending"] += not path.name.endswith("scene.toml")
            continue
        require_utf8(str(path))
        shown = str(path) if is_local(path) else path.shown
        part = Part(name=shown, format=input_format or known, path=path, mark=mark or mark_of(path))
        parts.append(replace(part, keys=_keys(relative.parts[:-1])))
    left_out = ", ".join(f"{count} {ending}" for ending, count in sorted((+others).items()))
    if not parts:
        also = f"; it has other files: {left_out}" if left_out else ""
        raise DataError(f"{name}: no table file in the folder (.parquet, .csv, .tsv, .arrow, .arrows, .jsonl){also}")
    remarks = (f"{name}: files with other endings are left out: {left_out}",) if left_out else ()
    return Input(name=name, parts=tuple(parts), remarks=remarks)


def _keys(folders: Sequence[str]) -> tuple[tuple[str, str | None], ...]:
    """Return the columns in the names of folders (``key=value``), as Hive and Spark write them."""
    pairs = [folder.partition("=") for folder in folders if "=" in folder.lstrip("=")]
    return tuple((unquote(key), None if value == _HIVE_NULL else unquote(value)) for key, _, value in pairs)


def _is_hidden(name: str) -> bool:
    return name.startswith((".", "_"))


def _globbed(pattern: str, input_format: FileFormat | None) -> list[Input]:
    paths = glob(pattern, recursive=True)  # noqa: PTH207 - absolute patterns too, and names stay as given
    matches = sorted(path for path in paths if Path(path).is_file())
    if not matches:
        raise DataError(f"{pattern}: no file matches this pattern")
    return [_file(match, input_format) for match in matches]


def _standard_input(input_format: FileFormat | None, stdin: IO[bytes] | None) -> Input:
    if stdin is None and sys.stdin is None:
        raise DataError("standard input is closed; name a file, or open it again")
    return _stream("-", "stdin", stdin if stdin is not None else sys.stdin.buffer, input_format)


def _stream(input_name: str, name: str, source: IO[bytes], input_format: FileFormat | None) -> Input:
    head = source.read(_HEAD_BYTES)  # waits for a slow writer
    detected = format_of_bytes(head)
    if input_format is None and detected.compression in ("zst", "bz2"):
        head, content = _first_content(head, source, detected.compression)
        is_json = format_of_bytes(content) is FileFormat.JSON_LINES
        detected = FileFormat(f"jsonl.{detected.compression}") if is_json else detected
    format = input_format or detected
    if format is FileFormat.ARROW and detected is FileFormat.ARROW_STREAM:
        format = detected
    buffered: Any = io.BufferedReader(_Replayed(head, source, owned=input_name != "-"))
    stream = _spool(buffered) if format.needs_seeking else buffered
    return Input(name=input_name, parts=(Part(name=name, format=format, stream=stream),))


def _first_content(head: bytes, source: IO[bytes], compression: str) -> tuple[bytes, bytes]:
    """Return the beginning of a compressed stream, read on to the end of its first block, and that of its content.

    The content is empty if the stream is corrupted, which its reader will report.
    """
    while True:
        with suppress(OSError, EOFError):
            if compression == "bz2":
                content = bz2.BZ2Decompressor().decompress(head, _HEAD_BYTES)
            else:
                content = pa.CompressedInputStream(pa.BufferReader(head), "zstd").read(_HEAD_BYTES)
            if content.strip():
                return head, content
        more = source.read(_BLOCK_BYTES) if len(head) < _LONGEST_BLOCK else b""
        if not more:
            return head, b""
        head += more


class _Replayed(io.RawIOBase):
    """A stream from its beginning although its ``head`` has been read; closing it closes an ``owned`` stream too."""

    def __init__(self, head: bytes, rest: IO[bytes], *, owned: bool) -> None:
        self._head, self._rest, self._owned = head, rest, owned

    def close(self) -> None:
        super().close()
        if self._owned:
            self._rest.close()

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: Any) -> int:
        if self._head:
            got, self._head = self._head[: len(buffer)], self._head[len(buffer) :]
        else:
            read: Any = getattr(self._rest, "read1", self._rest.read)
            got = read(len(buffer))
        buffer[: len(got)] = got
        return len(got)


def _spool(stream: IO[bytes]) -> IO[bytes]:
    spooled = tempfile.SpooledTemporaryFile(max_size=_SPOOL_IN_MEMORY_BYTES)  # noqa: SIM115 - the reader closes it
    shutil.copyfileobj(stream, spooled)
    stream.close()
    spooled.seek(0)
    return spooled
