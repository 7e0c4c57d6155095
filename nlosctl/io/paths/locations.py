"""Names of files: local paths or URLs (``s3://bucket/key``), which readers use alike, and the format of a file.

Local paths import nothing.
"""

from __future__ import annotations

import re
import zlib
from collections.abc import Sequence
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit
from urllib.request import url2pathname

from nlosctl.errors import DataError, UsageError, did_you_mean
from nlosctl.io.paths.remote_path import HTTP, RemotePath

if TYPE_CHECKING:
    from typing_extensions import TypeIs

__all__ = [
    "FileFormat",
    "Location",
    "Mark",
    "RemotePath",
    "format_named",
    "format_of_bytes",
    "format_of_path",
    "is_local",
    "is_remote",
    "known_extension",
    "known_format_of_path",
    "location",
    "mark_of",
    "mark_of_status",
    "names_folder",
    "near_name",
    "pyarrow_source",
    "require_utf8",
]

_URL = re.compile(r"([A-Za-z][A-Za-z0-9+.-]+)://([^?]*)(\?.*)?", re.DOTALL)
_SETTING = re.compile(r"\?[\w.~%$-]+=")

Location = Path | RemotePath
Mark = tuple[int, int, int]


def _url_of(name: str) -> tuple[str, str, str] | None:
    """Return scheme, name and query (with its question mark) of a URL; None for a path.

    The query of a store is settings, ``?KEY=VALUE``: another question mark belongs to a name.
    """
    match = _URL.fullmatch(name)
    if match is None:
        return None
    scheme, rest, query = match[1], match[2], match[3] or ""
    is_url = not query or scheme.lower() in HTTP or _SETTING.match(query)
    return (scheme, rest, query) if is_url else None


def is_remote(name: str) -> bool:
    """Return whether a name is a URL of another scheme than ``file``."""
    url = _url_of(name)
    return url is not None and url[0].lower() != "file"


def is_local(path: Location) -> TypeIs[Path]:
    """Return whether a location is on this machine."""
    return isinstance(path, Path)


def names_folder(name: str) -> bool:
    """Return whether a path or URL ends with a slash (before its ``?region=...``)."""
    url = _url_of(name)
    return (name if url is None else url[1]).endswith("/")


def location(name: str) -> Location:
    """Return the location that a path or URL names; ``file://`` URLs are local paths.

    Raises UsageError for an empty name, or one with a zero byte or a password in it.
    """
    if not name or "\0" in name:
        raise UsageError(f"{name!r} is not the name of a file; expected a path or a URL")
    url = _url_of(name)
    if url is None:
        return Path(name)
    scheme, rest, query = url
    if scheme.lower() == "file":
        split = urlsplit(name)
        if split.netloc not in ("", "localhost"):
            raise UsageError(f"{name}: expected file:///FOLDER/NAME, a local path")
        return Path(url2pathname(split.path))
    if ":" in rest.split("/")[0].rpartition("@")[0]:
        raise UsageError(
            f"{scheme}://...@{rest.split('/')[0].rpartition('@')[2]}: a password in a name is recorded in results and "
            f"logs; give it in the environment or the store's own configuration file"
        )
    return RemotePath(f"{scheme}://{rest.rstrip('/')}", query)


def require_utf8(name: str) -> None:
    """Raise DataError if the name of an input is not UTF-8: it can't be recorded in results."""
    try:
        name.encode("utf-8")
    except UnicodeEncodeError:
        raise DataError(
            f"{name}: the name is not UTF-8, and results record the names of their inputs; rename it"
        ) from None


def near_name(path: Location) -> str:
    """Return `` (did you mean ...?)`` with the most similar name in the same local folder, or an empty text."""
    if not is_local(path) or not path.parent.is_dir():
        return ""
    return did_you_mean(path.name, [entry.name for entry in path.parent.iterdir()])


def pyarrow_source(path: Location) -> Any:
    """Return the argument for pyarrow's readers: the name of a local file, else the open file."""
    return str(path) if is_local(path) else path.open_native()


def mark_of(path: Location) -> Mark | None:
    """Return a value that changes with the file: inode, size and time; None if it does not exist."""
    try:
        return mark_of_status(path.stat())
    except OSError:
        return None


def mark_of_status(status: Any) -> Mark:
    """Return the value of `mark_of` for the result of ``stat``."""
    return status.st_ino, status.st_size, status.st_mtime_ns


class FileFormat(Enum):
    """A file format; its value is its name for users."""

    PARQUET = "parquet"
    CSV = "csv"
    CSV_GZ = "csv.gz"
    CSV_ZST = "csv.zst"
    CSV_BZ2 = "csv.bz2"
    TSV = "tsv"
    TSV_GZ = "tsv.gz"
    TSV_ZST = "tsv.zst"
    TSV_BZ2 = "tsv.bz2"
    ARROW = "arrow"
    ARROW_STREAM = "arrows"
    JSON_LINES = "jsonl"
    JSON_LINES_GZ = "jsonl.gz"
    JSON_LINES_ZST = "jsonl.zst"
    JSON_LINES_BZ2 = "jsonl.bz2"

    @property
    def title(self) -> str:
        """The name for messages."""
        title = _TITLES[self.uncompressed]
        return f"{_COMPRESSED[self.compression]} {title}" if self.compression else title

    @property
    def uncompressed(self) -> FileFormat:
        """The format of the content."""
        return FileFormat(self.value.partition(".")[0])

    @property
    def compression(self) -> str:
        """The compression of text, as in the extension: ``gz``, ``zst``, ``bz2``, or empty."""
        return self.value.partition(".")[2]

    @property
    def is_delimited(self) -> bool:
        """Whether the content has a line per row, with cells between separators."""
        return self.uncompressed in (FileFormat.CSV, FileFormat.TSV)

    @property
    def needs_seeking(self) -> bool:
        """Whether a reader needs random access, so that a pipe has to be spooled first."""
        return self in (FileFormat.PARQUET, FileFormat.ARROW)

    @property
    def carries_metadata(self) -> bool:
        """Whether the file can contain a scene and provenance."""
        return self in (FileFormat.PARQUET, FileFormat.ARROW, FileFormat.ARROW_STREAM)


_TITLES = {
    FileFormat.PARQUET: "Parquet",
    FileFormat.CSV: "CSV",
    FileFormat.TSV: "TSV",
    FileFormat.ARROW: "an Arrow file",
    FileFormat.ARROW_STREAM: "an Arrow stream",
    FileFormat.JSON_LINES: "JSON Lines",
}

_COMPRESSED = {"gz": "gzipped", "zst": "zstd-compressed", "bz2": "bzip2-compressed"}

_EXTENSIONS = {
    **{f".{format.value}": format for format in FileFormat},
    ".pq": FileFormat.PARQUET,
    ".feather": FileFormat.ARROW,
    ".ipc": FileFormat.ARROW,
    **{
        f".{format.value.replace('jsonl', 'ndjson')}": format
        for format in FileFormat
        if format.uncompressed is FileFormat.JSON_LINES
    },
}


def format_of_path(path: str, further: Sequence[str] = ()) -> FileFormat:
    """Return the format by the extension of ``path``; raise UsageError with the known and ``further`` ones."""
    format = known_format_of_path(path)
    if format is None:
        raise UsageError(
            f"{path}: unknown file extension; known: {' '.join([*_EXTENSIONS, *further])} "
            f"(or name the format: `input_format` for an input, `format` for the output)"
        )
    return format


def known_format_of_path(path: str) -> FileFormat | None:
    """Return the format by the extension of ``path``, or None if it is unknown."""
    extension = known_extension(path)
    return _EXTENSIONS[extension.lower()] if extension else None


def known_extension(path: str) -> str:
    """Return the longest known extension at the end of ``path``, as it is written there, or an empty text."""
    matches = [extension for extension in _EXTENSIONS if path.lower().endswith(extension)]
    return path[-max(map(len, matches)) :] if matches else ""


def format_named(name: str) -> FileFormat:
    """Return the format called ``name``; raise UsageError with the nearest name if it is unknown."""
    names = [known.value for known in FileFormat]
    if name.lower() not in names:
        raise UsageError(f"no format {name!r}{did_you_mean(name.lower(), names)}; there are: {', '.join(names)}")
    return FileFormat(name.lower())


def format_of_bytes(head: bytes) -> FileFormat:
    """Return the format by the first bytes of a file (some hundred, for gzip); text that is not JSON is CSV.

    The content of the other compressions can't be read from their first bytes alone: they are CSV too.
    """
    if head.startswith(b"PAR1"):
        return FileFormat.PARQUET
    if head.startswith(b"ARROW1"):
        return FileFormat.ARROW
    if head.startswith(b"\xff\xff\xff\xff"):
        return FileFormat.ARROW_STREAM
    for compression, magic in _MAGIC.items():
        if head.startswith(magic):
            content = FileFormat.JSON_LINES if compression == "gz" and _is_json(_unzipped(head)) else FileFormat.CSV
            return FileFormat(f"{content.value}.{compression}")
    return FileFormat.JSON_LINES if _is_json(head) else FileFormat.CSV


_MAGIC = {"gz": b"\x1f\x8b", "zst": b"\x28\xb5\x2f\xfd", "bz2": b"BZh"}


def _is_json(head: bytes) -> bool:
    return head.removeprefix(b"\xef\xbb\xbf").lstrip().startswith((b"{", b"["))


def _unzipped(head: bytes) -> bytes:
    try:
        return zlib.decompressobj(wbits=31).decompress(head, 64)
    except zlib.error:
        return b""
