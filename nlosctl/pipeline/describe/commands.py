"""The command lines that read a file as its description does."""

from __future__ import annotations

import dataclasses
import math
import shlex
from collections.abc import Collection, Sequence
from pathlib import PurePath

from nlosctl.contract.run_options import InputOptions, flags_of
from nlosctl.contract.scene import Scene
from nlosctl.pipeline.describe.description import Description

__all__ = ["estimates_std", "log_commands", "table_commands"]

_METHODS = {
    "bearings": ("localize", "ml"),
    "ranges": ("localize", "ml"),
    "arrivals": ("localize", "ml"),
    "triplets": ("detect-ip", "chi2"),
}
_OPTIONS_OF_CONVERT = ("wide", "missing", "where", "declination_deg", "crs", "origin", "scene", "window", "by")
_OPTIONS_OF_SOLVING = ("constants", "dimensions", "speed_m_s")


def estimates_std(found: Description) -> bool:
    """Return whether the proposed command can estimate unknown standard deviations: a snapshot has spare rows."""
    return _method(found) == ("localize", "ml") and found.largest > found.dimension + (found.kind == "arrivals")


def table_commands(name: str, read: InputOptions, found: Description, assumed: Collection[str] = ()) -> list[str]:
    """Return the commands that check and solve a table; none for one without a good row.

    The constants ``assumed`` of ``read`` are estimated where that is possible.
    """
    if found.bad_rows >= found.rows:
        return []
    command, method = _method(found)
    aside = ["--bad-rows", f"{PurePath(name).name}.bad_rows.csv", "--overwrite"] if found.bad_rows else []
    solved, estimating = read, []
    if assumed and estimates_std(found):
        kept = {key: value for key, value in read.constants.items() if key not in assumed}
        pool = "snapshot" if found.kind == "arrivals" else "file"
        solved, estimating = dataclasses.replace(read, constants=kept), ["--estimate-std", pool]
    solving = ["nlosctl", command, "-m", method, name, *read_words(solved, command), *estimating, *aside]
    checking = [] if aside else [shlex.join(["nlosctl", "validate", name, *read_words(read, "validate")])]
    return [*checking, shlex.join(solving)]


def _method(found: Description) -> tuple[str, str]:
    if found.kind in ("ranges", "bearings") and found.repeats:
        return "identify-los", "assignment"
    return _METHODS[found.kind]


def log_commands(
    name: str, importer: str, table: str, read: InputOptions, found: Description | None, assumed: Collection[str] = ()
) -> list[str]:
    """Return the commands that convert a log to the file ``table`` and, if it can be solved, solve that."""
    options = InputOptions(**{key: getattr(read, key) for key in _OPTIONS_OF_CONVERT})
    words = [
        "nlosctl",
        "convert",
        name,
        "--from",
        importer,
        *read_words(options, "convert"),
        "-o",
        table,
        "--overwrite",
    ]
    rest = InputOptions(**{key: getattr(read, key) for key in _OPTIONS_OF_SOLVING})
    solved = [] if found is None else table_commands(table, rest, found, assumed)
    return [shlex.join(words), *solved]


def read_words(read: InputOptions, command: str) -> list[str]:
    """Return the flags of ``command`` that set the options of reading."""
    words: list[str] = []
    plain = InputOptions()
    for option, flag in flags_of(InputOptions):
        value = getattr(read, option.name)
        if command not in flag.commands.split() or value == getattr(plain, option.name):
            continue
        if flag.key:
            if flag.key in value and flag.name != "--toa-std-ns":
                degrees = flag.name.endswith("-deg")
                number = math.degrees(value[flag.key]) if degrees else value[flag.key]
                words += [flag.name, f"{number:.12g}"]
        elif isinstance(value, dict):
            words += [word for key, header in value.items() for word in (flag.name, f"{key}={header}")]
        elif isinstance(value, bool):
            words += [flag.name] if value else []
        elif isinstance(value, Sequence) and not isinstance(value, str) and option.name != "origin":
            words += [word for item in value for word in (flag.name, str(item))]
        elif value is not None and not isinstance(value, Scene):
            words += [flag.name, value if isinstance(value, str) else _number_text(value)]
    return words


def _number_text(value: object) -> str:
    return ",".join(map(repr, value)) if isinstance(value, tuple) else str(value)
