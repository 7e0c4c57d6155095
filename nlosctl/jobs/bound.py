"""Job: the Cramér-Rao bound of each snapshot, or over a map."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from functools import partial

from nlosctl.contract.options import parse_options
from nlosctl.contract.run_options import InputOptions, OutputOptions, SolveOptions
from nlosctl.errors import UsageError
from nlosctl.io.paths.inputs import Input
from nlosctl.io.writers.output_set import is_folder_target
from nlosctl.jobs.files import Destination, open_measurements
from nlosctl.jobs.solve import Execution
from nlosctl.pipeline.bound.bound_run import BoundRun
from nlosctl.pipeline.bound.map_grid import parse_map
from nlosctl.pipeline.bound.moving_bound import BoundParameters

__all__ = ["bound"]


def bound(
    inputs: Sequence[str] | Sequence[Input],
    map: str | None,
    read: InputOptions,
    options: SolveOptions,
    write: OutputOptions,
    destination: Destination,
) -> BoundRun:
    """Write the bound of each snapshot at its true position, or over the grid ``map``; return the run with its report.

    ``map`` is xmin,xmax,ymin,ymax,step in metres. Raises DataError for faults of the data, UsageError for an invalid
    map.
    """
    grid = None if map is None else parse_map(map)
    if grid is not None and any(is_folder_target(target) for target in destination.wanted.values()):
        raise UsageError("`map` makes one table, not one per part of the input; set `output` to a file")
    moves = parse_options(BoundParameters, options.parameters, "bound").motion == "velocity"
    if moves and grid is not None:
        raise UsageError("`map` has no motion: leave out one of it and motion=velocity")
    read = dataclasses.replace(read, keep_times="motion" if moves else "")
    options = dataclasses.replace(options, jobs=1)
    start = partial(BoundRun, options=options, grid=grid, map=map)
    with open_measurements(inputs, read, write, destination) as opened:
        run = start(opened.reader)
        Execution("bound", run, start, opened, options, write, destination).complete()
    return run
