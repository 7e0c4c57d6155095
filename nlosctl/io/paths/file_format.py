"""The formats of table files: told by extension, by name, or by the first bytes."""

from __future__ import annotations

import zlib
from enum import Enum

from nlosctl.errors import UsageError, did_you_mean

__all__ = ["FileFormat", "format_named", "format_of_bytes", "format_of_path", "known_extension"]


class FileFormat(Enum):
    """A format; its value is the name on the command line."""

    PARQUET = "parquet"
    CSV = "csv"
    CSV_GZ = "csv.gz"
    ARROW = "arrow"
    ARROW_STREAM = "arrows"
    JSON_LINES = "jsonl"
    JSON_LINES_GZ = "jsonl.gz"

    @property
    def title(self) -> str:
        """The name in a sentence."""
        return _TITLES[self]

    @property
    def compressed(self) -> bool:
        """Whether the text is gzipped."""
        return self in (FileFormat.CSV_GZ, FileFormat.JSON_LINES_GZ)

    @property
    def needs_seeking(self) -> bool:
        """Whether a reader must jump about in the file, so that a pipe has to be spooled first."""
        return self in (FileFormat.PARQUET, FileFormat.ARROW)

    @property
    def carries_metadata(self) -> bool:
        """Whether the file has room for a scene and provenance."""
        return self in (FileFormat.PARQUET, FileFormat.ARROW, FileFormat.ARROW_STREAM)


_TITLES = {
    FileFormat.PARQUET: "Parquet",
    FileFormat.CSV: "CSV",
    FileFormat.CSV_GZ: "gzipped CSV",
    FileFormat.ARROW: "an Arrow file",
    FileFormat.ARROW_STREAM: "an Arrow stream",
    FileFormat.JSON_LINES: "JSON Lines",
    FileFormat.JSON_LINES_GZ: "gzipped JSON Lines",
}

_EXTENSIONS = {
    ".parquet": FileFormat.PARQUET,
    ".pq": FileFormat.PARQUET,
    ".csv": FileFormat.CSV,
    ".csv.gz": FileFormat.CSV_GZ,
    ".arrow": FileFormat.ARROW,
    ".feather": FileFormat.ARROW,
    ".ipc": FileFormat.ARROW,
    ".arrows": FileFormat.ARROW_STREAM,
    ".jsonl": FileFormat.JSON_LINES,
    ".ndjson": FileFormat.JSON_LINES,
    ".jsonl.gz": FileFormat.JSON_LINES_GZ,
    ".ndjson.gz": FileFormat.JSON_LINES_GZ,
}


def format_of_path(path: str) -> FileFormat:
    """Return the format that the extension of ``path`` tells; raise UsageError listing the known ones."""
    found = known_format_of_path(path)
    if found is None:
        raise UsageError(
            f"{path}: the extension tells no format; known: {' '.join(_EXTENSIONS)} "
            f"(or name the format: --input-format for an input, --format for the output)"
        )
    return found


def known_format_of_path(path: str) -> FileFormat | None:
    """Return the format that the extension tells, or None."""
    extension = known_extension(path)
    return _EXTENSIONS[extension.lower()] if extension else None


def known_extension(path: str) -> str:
    """Return the end of ``path`` that tells a format, as it is written, or an empty text."""
    matches = [extension for extension in _EXTENSIONS if path.lower().endswith(extension)]
    return path[-max(map(len, matches)) :] if matches else ""


def format_named(name: str) -> FileFormat:
    """Return the format called ``name``; raise UsageError with the nearest name where there is none."""
    names = [known.value for known in FileFormat]
    if name.lower() not in names:
        raise UsageError(f"no format {name!r}{did_you_mean(name.lower(), names)}; there are: {', '.join(names)}")
    return FileFormat(name.lower())


def format_of_bytes(head: bytes) -> FileFormat:
    """Return the format that the first bytes tell (some hundred, for gzip); text that is not JSON is CSV."""
    if head.startswith(b"PAR1"):
        return FileFormat.PARQUET
    if head.startswith(b"ARROW1"):
        return FileFormat.ARROW
    if head.startswith(b"\xff\xff\xff\xff"):
        return FileFormat.ARROW_STREAM
    if head.startswith(b"\x1f\x8b"):
        return FileFormat.JSON_LINES_GZ if _is_json(_unzipped(head)) else FileFormat.CSV_GZ
    return FileFormat.JSON_LINES if _is_json(head) else FileFormat.CSV


def _is_json(head: bytes) -> bool:
    return head.removeprefix(b"\xef\xbb\xbf").lstrip().startswith((b"{", b"["))


def _unzipped(head: bytes) -> bytes:
    try:
        return zlib.decompressobj(wbits=31).decompress(head, 64)
    except zlib.error:
        return b""
