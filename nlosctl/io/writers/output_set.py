"""All-or-nothing set of the output files of one run, and the checks of their targets before any work is done."""

from __future__ import annotations

import os
from collections.abc import Sequence
from contextlib import ExitStack
from types import TracebackType
from typing import Any, Protocol, TypeVar

from nlosctl.errors import DataError, UsageError
from nlosctl.io.paths.locations import (
    Location,
    RemotePath,
    is_local,
    is_remote,
    known_format_of_path,
    location,
    names_folder,
)
from nlosctl.io.writers.byte_output import ByteOutput, is_written_through, writing

__all__ = ["OutputSet", "check_targets", "is_folder_target"]


def is_folder_target(target: str | None) -> bool:
    """Return whether an output is a folder: its name ends with a slash, or is a folder's without a file extension."""
    if target is None or target == "-":
        return False
    return names_folder(target) or (
        not is_remote(target) and location(target).is_dir() and known_format_of_path(target) is None
    )


def check_targets(
    targets: Sequence[str | None], *, overwrite: bool, inputs: Sequence[Location], tables: Sequence[str | None] = ()
) -> None:
    """Raise an error for outputs that can't be written or would overwrite something.

    ``-`` is standard output, None an output that is not wanted. ``tables`` may be folders, whose content
    `nlosctl.io.parts.run_folder` checks. Raises UsageError if two outputs are the same file, DataError if a file exists
    (without ``overwrite``), is an input, or can't be written.
    """
    wanted = [target for target in [*tables, *targets] if target is not None]
    paths = [target if target == "-" else str(_resolved(target)) for target in wanted]
    for number, path in enumerate(paths):
        if path in paths[:number]:
            raise UsageError(f"{wanted[paths.index(path)]} and {wanted[number]} are the same output; give two names")
    for target in wanted:
        if target in tables and is_folder_target(target):
            _check_folder(target, inputs)
        elif target != "-":
            _check_target(target, overwrite, inputs)


def _resolved(target: str) -> Location:
    try:
        return location(target).resolve()
    except RuntimeError as error:  # until Python 3.13
        raise DataError(f"{target}: can't be written: its symbolic links lead in a circle") from error


def _check_folder(target: str, inputs: Sequence[Location]) -> None:
    folder = location(target).resolve()
    for source in (source.resolve() for source in inputs if isinstance(source, type(folder))):
        if folder == source or folder in source.parents or (source in folder.parents and source.is_dir()):
            raise DataError(f"{target}: the output folder and the input are nested; write to another folder")


def _check_target(target: str, overwrite: bool, inputs: Sequence[Location]) -> None:
    path = location(target).resolve()
    if not is_local(path):
        _check_remote(target, path, overwrite, inputs)
        return
    if path.is_dir():
        raise DataError(f"{target}: is a folder, expected the name of a file")
    if not path.parent.is_dir():
        raise DataError(f"{target}: there is no folder {str(location(target).parent)!r}; make it first")
    if is_written_through(target):
        return
    for source in filter(is_local, inputs):
        if path.exists() and source.exists() and source.samefile(path):
            raise DataError(f"{target}: is the input; write to another file")
        if source.is_dir() and source.resolve() in path.parents:
            raise DataError(f"{target}: is inside the input folder {str(source)!r}; write to another folder")
    if path.exists() and not overwrite:
        raise DataError(f"{target}: exists already; `overwrite` replaces it")
    if not os.access(path.parent, os.W_OK):
        raise DataError(f"{target}: can't be written: no permission in the folder")


def _check_remote(target: str, path: RemotePath, overwrite: bool, inputs: Sequence[Location]) -> None:
    for source in (source for source in inputs if not is_local(source)):
        if source == path:
            raise DataError(f"{target}: is the input; write to another file")
        if source in path.parents:
            raise DataError(f"{target}: is inside the input folder {str(source)!r}; write to another folder")
    try:
        if path.is_dir():
            raise DataError(f"{target}: is a folder, expected the name of a file")
        if path.is_file() and not overwrite:
            raise DataError(f"{target}: exists already; `overwrite` replaces it")
        if not path.has_bucket():
            raise DataError(f"{target}: there is no {str(path.top)!r}; make it first")
    except OSError as error:
        raise DataError(f"{target}: can't be written: {error.strerror or error}") from error


class _Output(Protocol):
    @property
    def passes_on(self) -> bool: ...

    def complete(self) -> None: ...

    def __enter__(self) -> Any: ...

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None: ...


OutputT = TypeVar("OutputT", bound=_Output)


class OutputSet:
    """Context manager that completes all outputs before any of them gets its final name.

    On a full disk none of the files exists, instead of some. Standard output and devices are completed last, because
    what was written to them can't be taken back.
    """

    def __init__(self) -> None:
        self._stack = ExitStack()
        self._outputs: list[_Output] = []

    def __enter__(self) -> OutputSet:
        return self

    def take(self, output: OutputT) -> OutputT:
        """Open an output (such as a `TableWriter`) as a member of the set."""
        self._stack.enter_context(output)
        self._outputs.append(output)
        return output

    def write_text(self, target: str, text: str, *, overwrite: bool) -> None:
        """Write a small text file as a member of the set; check the target first with `check_targets`."""
        with writing(target):
            self.take(ByteOutput(target, overwrite=overwrite)).sink.write(text.encode("utf-8"))

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        with self._stack:  # an exception raised here leaves no file either
            if kind is not None:
                self._stack.__exit__(kind, error, trace)
                return
            for output in sorted(self._outputs, key=lambda output: output.passes_on):
                output.complete()
