"""Where outputs go: what would destroy something, or can't be written, is refused before any work is done."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

from nlosctl.errors import DataError, UsageError
from nlosctl.io.paths.file_format import known_format_of_path
from nlosctl.io.paths.locations import Location, RemotePath, is_remote, location, names_folder

__all__ = ["check_targets", "is_folder_target", "takes_bytes_as_they_come"]


def is_folder_target(target: str | None) -> bool:
    """Return whether an output is meant to be a folder: its name ends with a slash, or it is one not called a file."""
    if target is None or target == "-":
        return False
    return names_folder(target) or (
        not is_remote(target) and location(target).is_dir() and known_format_of_path(target) is None
    )


def check_targets(
    targets: Sequence[str | None], *, overwrite: bool, inputs: Sequence[Location], tables: Sequence[str | None] = ()
) -> None:
    """Refuse outputs that can't be written or would destroy something, before any work is done.

    ``-`` is standard output, None stands for an output that is not wanted; ``tables`` may be folders, which
    `nlosctl.io.parts.run_folder` looks into. Raises UsageError where two outputs are one file, DataError where a file
    exists (without ``overwrite``), is an input, or can't be written.
    """
    wanted = [target for target in [*tables, *targets] if target is not None]
    places = [target if target == "-" else str(_resolved(target)) for target in wanted]
    for number, place in enumerate(places):
        if place in places[:number]:
            raise UsageError(f"{wanted[places.index(place)]} and {wanted[number]} are one output; give two names")
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
    for given in (given.resolve() for given in inputs if isinstance(given, type(folder))):
        if folder == given or folder in given.parents or (given in folder.parents and given.is_dir()):
            raise DataError(f"{target}: the folder and the input lie in each other; write to another folder")


def _check_target(target: str, overwrite: bool, inputs: Sequence[Location]) -> None:
    path = location(target).resolve()
    if isinstance(path, RemotePath):
        _check_remote(target, path, overwrite, inputs)
        return
    if path.is_dir():
        raise DataError(f"{target}: is a folder, expected the name of a file")
    if not path.parent.is_dir():
        raise DataError(f"{target}: there is no folder {str(location(target).parent)!r}; make it first")
    if takes_bytes_as_they_come(target):
        return
    for given in (given for given in inputs if isinstance(given, Path)):
        if path.exists() and given.exists() and given.samefile(path):
            raise DataError(f"{target}: is the input; write to another file")
        if given.is_dir() and given.resolve() in path.parents:
            raise DataError(f"{target}: lies in the input folder {str(given)!r}; write to another folder")
    if path.exists() and not overwrite:
        raise DataError(f"{target}: exists already; --overwrite replaces it")
    if not os.access(path.parent, os.W_OK):
        raise DataError(f"{target}: can't be written: no permission in the folder")


def _check_remote(target: str, path: RemotePath, overwrite: bool, inputs: Sequence[Location]) -> None:
    for given in (given for given in inputs if isinstance(given, RemotePath)):
        if given == path:
            raise DataError(f"{target}: is the input; write to another file")
        if given in path.parents:
            raise DataError(f"{target}: lies in the input folder {str(given)!r}; write to another folder")
    try:
        if path.is_dir():
            raise DataError(f"{target}: is a folder, expected the name of a file")
        if path.is_file() and not overwrite:
            raise DataError(f"{target}: exists already; --overwrite replaces it")
        if not path.has_bucket():
            raise DataError(f"{target}: there is no {str(path.top)!r}; make it first")
    except OSError as error:
        raise DataError(f"{target}: can't be written: {error.strerror or error}") from error


def takes_bytes_as_they_come(target: str) -> bool:
    """Whether the target is there and no regular file: a pipe or device, which is written through."""
    path = location(target)
    return isinstance(path, Path) and path.exists() and not path.is_file() and not path.is_dir()
