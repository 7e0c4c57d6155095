"""One output as bytes: a file that appears whole or not at all, a device written through, or standard output."""

from __future__ import annotations

import errno
import filecmp
import os
import secrets
import stat
import sys
import tempfile
import weakref
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from types import TracebackType
from typing import IO

from nlosctl.errors import DataError
from nlosctl.io.paths.locations import is_local, location

flock: Callable[[int, int], None] | None
try:
    from fcntl import LOCK_EX, LOCK_NB, flock
except ImportError:  # Windows
    flock = None

__all__ = ["AtomicFile", "ByteOutput", "is_written_through", "try_lock", "write_bytes", "write_text", "writing"]


class ByteOutput:
    """Context manager of one output; ``sink`` takes the bytes of ``target``: a path, or ``-`` for standard output.

    A file appears under its name when the block ends without an exception; after a failure nothing is left. Check the
    target first with `check_targets`. Raises DataError if the target can't be written, or without ``overwrite`` if
    there is a file of this name by then; with ``repeats``, only if its content differs.
    """

    def __init__(self, target: str, stdout: IO[bytes] | None = None, *, overwrite: bool, repeats: bool = False) -> None:
        self.target, self._stdout, self._overwrite, self._repeats = target, stdout, overwrite, repeats
        self._new: AtomicFile | None = None
        self.sink: IO[bytes]

    def __enter__(self) -> ByteOutput:
        with writing(self.target):
            if self.target == "-":
                self.sink = self._standard_output()
            elif is_written_through(self.target):
                self.sink = location(self.target).open("wb")
            else:
                self._new = AtomicFile(self.target, overwrite=self._overwrite, repeats=self._repeats)
                self.sink = self._new.sink
        return self

    @property
    def passes_on(self) -> bool:
        """Whether written bytes can't be taken back: standard output, a pipe, a device."""
        return self._new is None

    def complete(self) -> None:
        """Write all bytes out; only the renaming to the final name is left."""
        with writing(self.target):
            if self._new is not None:
                self._new.complete()
            elif self.target == "-":
                self.sink.flush()
            else:
                self.sink.close()

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.end(kind, self.complete)

    def end(self, kind: type[BaseException] | None, complete: Callable[[], None]) -> None:
        """Complete and rename the output; after an exception, raised here or earlier (``kind``), remove it."""
        if kind is not None:
            self._discard()
            return
        try:
            complete()
            if self._new is not None:
                with writing(self.target):
                    self._new.keep()
                self._new = None
        except BaseException:
            self._discard()
            raise

    def _discard(self) -> None:
        if self._new is not None:
            self._new.discard()
            self._new = None
        elif self.target != "-":
            with suppress(OSError):
                self.sink.close()

    def _standard_output(self) -> IO[bytes]:
        if self._stdout is not None:
            return self._stdout
        if sys.stdout is None:
            raise DataError("standard output is closed; name a file with -o")
        return sys.stdout.buffer


def write_text(target: str, text: str, *, overwrite: bool) -> None:
    """Write a small text file atomically; check the target first with `check_targets`."""
    write_bytes(target, text.encode("utf-8"), overwrite=overwrite)


def write_bytes(target: str, content: bytes, *, overwrite: bool) -> None:
    """Write a small file atomically; check the target first with `check_targets`."""
    with writing(target), ByteOutput(target, overwrite=overwrite) as output:
        output.sink.write(content)


class AtomicFile:
    """Writes the file ``target`` under a temporary name: ``sink`` takes the bytes, `keep` renames it.

    The temporary file is in the same folder, for a URL in the system's temporary folder. It is locked while this
    process runs, so that others can recognize one that was left behind. It is removed with this object at the latest,
    also if the run is interrupted. ``overwrite`` and ``repeats`` as in `ByteOutput`. Raises OSError if it can't be
    created, FileExistsError if the name is taken.
    """

    def __init__(self, target: str, *, overwrite: bool, repeats: bool = False) -> None:
        self._target, self._overwrite, self._repeats = location(target).resolve(), overwrite, repeats
        folder = Path(tempfile.gettempdir()) if not is_local(self._target) else self._target.parent
        token = secrets.token_hex(8)
        self._temporary: Path = folder / f".{self._target.name[:100]}.{token}.part"
        self._remove_temporary = weakref.finalize(self, _remove, self._temporary, os.getpid())
        unlocked = folder / f".{token}.part"
        try:
            self.sink: IO[bytes] = unlocked.open("xb")
            try_lock(self.sink.fileno())
            unlocked.rename(self._temporary)  # under this name it is locked from the first moment
        except BaseException:
            unlocked.unlink(missing_ok=True)
            if hasattr(self, "sink"):
                self.discard()
            raise

    def complete(self) -> None:
        """Flush all bytes to the disk; the temporary file stays open, because it is locked until it is closed."""
        self.sink.flush()
        os.fsync(self.sink.fileno())
        if not self._overwrite and self._target.exists() and not self._is_repeated():
            raise self._taken()

    def keep(self) -> None:
        """Rename the complete file to its final name; a file that may be replaced passes its mode on."""
        self.complete()
        if not is_local(self._target):
            self._target.take(self._temporary)
            self._remove_temporary()
        elif self._overwrite:
            with suppress(FileNotFoundError):
                self._temporary.chmod(stat.S_IMODE(self._target.stat().st_mode))
            self._temporary.replace(self._target)
        else:
            self._rename(self._temporary, self._target)
        self.sink.close()

    def discard(self) -> None:
        """Remove the temporary file."""
        with suppress(OSError):  # on a full disk the buffered bytes can't be flushed; the file is dropped anyway
            self.sink.close()
        self._remove_temporary()

    def _rename(self, temporary: Path, target: Path) -> None:
        """Rename a file, but never to a name that exists, however recently it was made."""
        try:
            try:
                target.hardlink_to(temporary)
            except FileExistsError:
                raise
            except OSError:  # a file system without hard links: reserve the name, then replace the reserved file
                target.open("xb").close()
                temporary.replace(target)
        except FileExistsError:
            if not self._is_repeated():
                raise self._taken() from None
        self._remove_temporary()

    def _is_repeated(self) -> bool:
        """Return whether the file that has the name by now is this one, written twice."""
        if not self._repeats or not is_local(self._target):
            return self._repeats
        return filecmp.cmp(self._temporary, self._target, shallow=False)

    def _taken(self) -> FileExistsError:
        return FileExistsError(errno.EEXIST, "a file of this name was made during the run; `overwrite` replaces it")


@contextmanager
def writing(target: str) -> Iterator[None]:
    """Convert OSError into a DataError that names the output; BrokenPipeError passes unchanged."""
    try:
        yield
    except BrokenPipeError:
        raise
    except OSError as error:
        name = "standard output" if target == "-" else target
        raise DataError(f"{name}: can't be written: {error.strerror or error}") from error


def is_written_through(target: str) -> bool:
    """Return whether the target exists and is not a regular file: a pipe or device, which is written directly."""
    path = location(target)
    return is_local(path) and path.exists() and not path.is_file() and not path.is_dir()


def try_lock(descriptor: int) -> bool | None:
    """Lock an open file until it is closed everywhere; False if it is locked already, None without locks (some NFS)."""
    if flock is None:
        return None
    try:
        flock(descriptor, LOCK_EX | LOCK_NB)
    except (BlockingIOError, PermissionError):
        return False
    except OSError:
        return None
    return True


def _remove(path: Path, creator: int) -> None:
    if os.getpid() == creator:  # a forked process must not remove the file of its parent
        with suppress(OSError):
            path.unlink()
