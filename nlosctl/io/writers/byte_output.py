"""One output as bytes: a file that appears whole or not at all, a device as it takes them, or standard output."""

from __future__ import annotations

import sys
from collections.abc import Callable
from contextlib import suppress
from types import TracebackType
from typing import IO

from nlosctl.errors import DataError
from nlosctl.io.paths.locations import location
from nlosctl.io.writers.atomic_file import NewFile, writing
from nlosctl.io.writers.targets import takes_bytes_as_they_come

__all__ = ["ByteOutput", "write_bytes", "write_text"]


class ByteOutput:
    """A context manager whose ``sink`` takes the bytes of ``target``: a path, or ``-`` for standard output.

    A file appears under its name when the block ends well; of a failure nothing is left. Check the target first with
    `check_targets`. Raises DataError where it can't be written.
    """

    def __init__(self, target: str, stdout: IO[bytes] | None = None) -> None:
        self.target, self._stdout = target, stdout
        self._new: NewFile | None = None
        self.sink: IO[bytes]

    def __enter__(self) -> ByteOutput:
        with writing(self.target):
            if self.target == "-":
                self.sink = self._standard_output()
            elif takes_bytes_as_they_come(self.target):
                self.sink = location(self.target).open("wb")
            else:
                self._new = NewFile(self.target)
                self.sink = self._new.sink
        return self

    @property
    def passes_on(self) -> bool:
        """Whether bytes go where they can't be taken back from: standard output, a pipe, a device."""
        return self._new is None

    def complete(self) -> None:
        """See that all bytes are where they belong: nothing is left but to take the name."""
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
        """Complete the output and take its name; after an exception, here or (``kind``) before, nothing is left."""
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


def write_text(target: str, text: str) -> None:
    """Write a small text file, whole or not at all; check the target first with `check_targets`."""
    write_bytes(target, text.encode("utf-8"))


def write_bytes(target: str, content: bytes) -> None:
    """Write a small file, whole or not at all; check the target first with `check_targets`."""
    with writing(target), ByteOutput(target) as output:
        output.sink.write(content)
