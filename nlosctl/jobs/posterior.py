"""Job: the posterior of the position on a grid of cells."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any, Literal

from nlosctl.contract.options import parse_options
from nlosctl.contract.run_options import InputOptions, OutputOptions, SolveOptions
from nlosctl.errors import UsageError
from nlosctl.io.measurements.reader import MeasurementReader
from nlosctl.io.paths.inputs import Input
from nlosctl.io.writers.output_set import is_folder_target
from nlosctl.jobs.files import Destination, naming_importer, open_inputs, open_measurements
from nlosctl.jobs.solve import Execution, input_passes, readable_again
from nlosctl.pipeline.posterior.posterior_run import PosteriorOptions, PosteriorRun
from nlosctl.pipeline.solve.method_runs import MethodRun, leaves_options_open, method_runs
from nlosctl.solvers.sequential.priors import PRIOR_NAMES, PriorOptions, check_prior

__all__ = ["posterior", "posterior_options"]


def posterior_options(
    *, snapshot: str | None, all: bool, combine: bool, cell: float | None, max_cells: int
) -> PosteriorOptions:
    """Return the maps that are wanted; raises UsageError unless exactly one kind is."""
    if (snapshot is not None) + all + combine != 1:
        raise UsageError(
            "set one of `snapshot` ID (the map of one snapshot), `all` (a map of each) and `combine` (one map of all)"
        )
    if cell is not None and not 0.0 < cell < float("inf"):
        raise UsageError(f"`cell` must be a finite number of metres above 0. Got {cell:g} instead.")
    if max_cells < 1:
        raise UsageError(f"`max_cells` must be an int of at least 1. Got {max_cells} instead.")
    of: Literal["snapshot", "all", "combine"] = "all" if all else "combine" if combine else "snapshot"
    return PosteriorOptions(of=of, snapshot=snapshot, cell_m=cell, max_cells=max_cells)


def posterior(
    inputs: Sequence[str] | Sequence[Input],
    maps: PosteriorOptions,
    read: InputOptions,
    options: SolveOptions,
    write: OutputOptions,
    destination: Destination,
) -> PosteriorRun:
    """Write posterior maps of measurements; return the run with its report.

    The parameters of a prior are among those of the method. Raises DataError for faults of the data, UsageError for
    options that don't suit them, or a method without a likelihood of positions.
    """
    if any(is_folder_target(target) for target in destination.wanted.values()):
        raise UsageError("maps are one table, not one per part of the input; set `output` to a file")
    options = dataclasses.replace(options, jobs=1)
    with naming_importer(inputs):
        given = open_inputs(inputs, read.input_format)
    with (
        readable_again(given, read, options) as sources,
        open_measurements(sources, read, write, destination) as opened,
    ):
        run, prior = _method_run(opened.reader, options)
        again = input_passes(opened, options, write).reader
        start = partial(PosteriorRun, run=run, prior=prior, options=options, maps=maps, open_again=again)
        made = start(opened.reader)
        Execution("posterior", made, start, opened, options, write, destination).complete()
    return made


def _method_run(reader: MeasurementReader, options: SolveOptions) -> tuple[MethodRun, PriorOptions]:
    """Return the method with its options, and the prior."""
    own = {name: value for name, value in options.parameters.items() if name not in PRIOR_NAMES}
    if len(options.method) != 1:
        raise UsageError("a posterior is that of one method; set `method` once")
    if leaves_options_open(own):
        raise UsageError("a posterior takes parameters as they are given; estimate them by localize first")
    own = _together(reader.kind, own)
    (run,) = method_runs(options.method, reader.kind, "localize", own)
    if run.spec.cost_at is None:
        raise UsageError(
            f"method {run.spec.name!r} has no likelihood of positions for a posterior; set `method` to ml"
            + ("" if reader.kind == "triplets" else " or mixture-ml")
        )
    prior = parse_options(PriorOptions, _prior(options.parameters), owner="the prior")
    check_prior(prior)
    return run, prior


def _together(kind: str, own: Mapping[str, Any]) -> dict[str, Any]:
    """Return the parameters, with all paths of a snapshot of triplets together."""
    if kind != "triplets":
        return dict(own)
    if str(own.get("joint", "true")).lower() != "true":
        raise UsageError("a map of triplets is that of all paths of a snapshot together; leave out joint=false")
    return {**own, "joint": True}


def _prior(parameters: Mapping[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in parameters.items() if name in PRIOR_NAMES}
