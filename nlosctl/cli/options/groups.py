"""Options that go together: a command that has a group as a parameter takes all of its options, in its place."""

from __future__ import annotations

import dataclasses
import functools
import inspect
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any, get_type_hints

from nlosctl.cli.options.declarations import (
    Add,
    AllRows,
    BadRows,
    BlockSize,
    Carry,
    Columns,
    ConfigFile,
    Crs,
    Debug,
    Ellipse,
    Engine,
    Format,
    Hash,
    InputFormat,
    Jobs,
    MaxSnapshotRows,
    Origin,
    Output,
    Overwrite,
    Params,
    Quiet,
    Report,
    Resume,
    Scheduler,
    Seed,
    Sweeps,
    Verbose,
)

__all__ = ["SolvingOptions", "takes_groups"]


@dataclass(frozen=True, kw_only=True)
class SolvingOptions:
    """What every command takes that solves measurements by methods."""

    param: Params = field(default_factory=list)
    sweep: Sweeps = field(default_factory=list)
    output: Output = "-"
    crs: Crs = None
    origin: Origin = None
    column: Columns = field(default_factory=list)
    all_rows: AllRows = False
    ellipse: Ellipse = None
    add: Add = ""
    carry: Carry = field(default_factory=list)
    bad_rows: BadRows = None
    format: Format = None
    input_format: InputFormat = None
    overwrite: Overwrite = False
    resume: Resume = False
    engine: Engine = "local"
    scheduler: Scheduler = None
    seed: Seed = 0
    jobs: Jobs = 0
    block_size: BlockSize = 8192
    max_snapshot_rows: MaxSnapshotRows = 1_000_000
    report: Report = None
    hash: Hash = False
    quiet: Quiet = False
    verbose: Verbose = False
    debug: Debug = False
    config: ConfigFile = None


def takes_groups(command: Callable[..., Any]) -> Callable[..., Any]:
    """Return a command to the parser: parameters annotated with a dataclass become the options that are its fields."""
    hints = get_type_hints(command, include_extras=True)
    groups = {name: hint for name, hint in hints.items() if dataclasses.is_dataclass(hint) and isinstance(hint, type)}

    @functools.wraps(command)
    def call(**words: Any) -> Any:
        made = {
            name: group(**{option.name: words.pop(option.name) for option in dataclasses.fields(group)})
            for name, group in groups.items()
        }
        return command(**words, **made)

    parameters = [
        option
        for parameter in inspect.signature(command).parameters.values()
        for option in (
            _options(groups[parameter.name])
            if parameter.name in groups
            else [parameter.replace(annotation=hints[parameter.name], kind=inspect.Parameter.KEYWORD_ONLY)]
        )
    ]
    call.__signature__ = inspect.Signature(parameters, return_annotation=hints["return"])  # type: ignore[attr-defined]
    call.__annotations__ = {option.name: option.annotation for option in parameters} | {"return": hints["return"]}
    return call


def _options(group: type) -> Iterator[inspect.Parameter]:
    hints = get_type_hints(group, include_extras=True)
    for option in dataclasses.fields(group):
        default = option.default if option.default_factory is dataclasses.MISSING else option.default_factory()
        yield inspect.Parameter(
            option.name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=hints[option.name]
        )
