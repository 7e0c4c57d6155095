"""Laws on the form of a method and of its result. Each is a generator of complaints; the first one counts."""

from __future__ import annotations

import contextlib
import dataclasses
import io
import re
import warnings
from collections.abc import Iterator
from typing import Any

import numpy as np

from nlosctl import registry
from nlosctl.contract.methods import contract_fault
from nlosctl.contract.options import parse_options
from nlosctl.contract.result_checks import form_faults, null_faults
from nlosctl.contract.results import Estimates, has_covariance, has_position
from nlosctl.contract.statuses import Status
from nlosctl.errors import UsageError
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.testing.bench import Bench
from nlosctl.testing.compare import estimates_of, same_bits
from nlosctl.testing.moves import copy_batch

__all__ = ["covariance", "flags", "null", "quiet", "read_only", "shapes", "sorted_estimates", "specification"]

_SNAPSHOTS = 24


def specification(bench: Bench) -> Iterator[str]:
    """The specification itself is sound: its name, its options and their defaults, what it declares."""
    spec = bench.spec
    if not re.fullmatch(r"[a-z][a-z0-9]*(-[a-z0-9]+)*", spec.name):
        yield f"the name {spec.name!r} is not lower-case words joined by hyphens"
    if not (spec.summary and spec.reference and spec.cost):
        yield "its summary, reference or cost is empty"
    fault = contract_fault(spec.contract_version)
    if fault and not registry.is_built_in(spec):
        yield f"it {fault}"
    if spec.minimum_measurements < 1:
        yield f"minimum_measurements is {spec.minimum_measurements}"
    if "used" in spec.flags or len(set(spec.flags)) != len(spec.flags):
        yield f"it declares the flags {spec.flags}: each once, 'used' not among them"
    if not spec.options.__dataclass_params__.frozen:
        yield f"{spec.options.__name__} is not frozen"
    for field in dataclasses.fields(spec.options):
        if "meaning" not in field.metadata:
            yield f"the option {field.name!r} is not declared with nlosctl.contract.options.option"
    try:
        parse_options(spec.options, dataclasses.asdict(bench.options), spec.full_name)
    except UsageError as error:
        yield f"a default is not allowed: {error}"


def shapes(bench: Bench) -> Iterator[str]:
    """All arrays of the result have the shapes and types of the contract."""
    for measurements in bench.usual_measurements:
        batch = bench.ordinary(_SNAPSHOTS, measurements).batch
        estimates = bench.solve(batch).estimates
        yield from form_faults(estimates, batch.dimension, exact_types=True)
        if (estimates.covariance_kind or "") not in (bench.spec.covariance_kinds or ("",)):
            yield f"covariance_kind is {estimates.covariance_kind!r}, declared are {bench.spec.covariance_kinds}"
        if not set(estimates.columns) <= set(bench.spec.estimate_columns):
            yield f"the columns are {sorted(estimates.columns)}, declared are {sorted(bench.spec.estimate_columns)}"
        strange = set(estimates.status.tolist()) - {int(status) for status in Status}
        if strange:
            yield f"a status is {strange.pop()}"


def sorted_estimates(bench: Bench) -> Iterator[str]:
    """Estimates are ordered by row, target and alternative, each counted from 0; every snapshot has one."""
    for measurements in bench.usual_measurements:
        estimates = bench.solve(bench.mixed(_SNAPSHOTS, measurements)).estimates
        previous = (-1, 0, 0)
        for index in zip(estimates.row, estimates.target, estimates.alternative, strict=True):
            here = tuple(int(number) for number in index)
            row, target, alternative = previous
            following = ((row + 1, 0, 0), (row, target + 1, 0), (row, target, alternative + 1))
            if here not in following or (row == -1 and here != (0, 0, 0)):
                yield f"(row, target, alternative) {here} follows {previous}"
            previous = here  # type: ignore[assignment]
        if previous[0] != _SNAPSHOTS - 1:
            yield f"the last estimate is of snapshot {previous[0]}, not of {_SNAPSHOTS - 1}"


def null(bench: Bench) -> Iterator[str]:
    """Position, cost and covariance are NaN, and n_used 0, exactly where the status requires it."""
    for measurements in bench.usual_measurements:
        estimates = bench.solve(bench.mixed(_SNAPSHOTS, measurements)).estimates
        status, used = estimates.status, estimates.n_used
        positioned = has_position(status)
        yield from null_faults("position", estimates.position_m, positioned, status)
        yield from null_faults("covariance", estimates.covariance_m2, has_covariance(status), status)
        yield from null_faults("cost", estimates.cost, positioned, status)
        for number in np.flatnonzero(~np.where(positioned, (used >= 1) & (used <= measurements), used == 0)):
            yield f"n_used is {used[number]} of {measurements} where the status is {Status(int(status[number])).word}"


def covariance(bench: Bench) -> Iterator[str]:
    """A covariance is that of an ellipse, or ellipsoid: all its eigenvalues are positive."""
    for measurements in bench.usual_measurements:
        estimates = bench.solve(bench.ordinary(4 * _SNAPSHOTS, measurements).batch).estimates
        for number in np.flatnonzero(~np.isnan(estimates.covariance_m2).any(axis=1)):
            xx, xy, yy, *upright = estimates.covariance_m2[number]
            if not (xx > 0.0 and yy > 0.0 and abs(xy) < np.sqrt(xx) * np.sqrt(yy)):
                yield f"xx, xy, yy are {estimates.covariance_m2[number]}"
            if upright and not np.isfinite(SymmetricMatrix(*estimates.covariance_m2[number]).determinant):
                yield f"xx, xy, yy, xz, yz, zz are {estimates.covariance_m2[number]}"


def flags(bench: Bench) -> Iterator[str]:
    """Flags have the columns that are declared, a value for each measurement, and do not change the estimates."""
    for measurements in bench.usual_measurements:
        batch = bench.mixed(_SNAPSHOTS, measurements)
        solution = bench.solve(batch)
        if solution.flags is None:
            yield "missing although the batch wants them"
            return
        declared = bench.spec.flag_columns(
            bench.options, batch.scene, _columns_of(batch), details=False, dimension=batch.dimension
        )
        if set(solution.flags.columns) != set(declared):
            yield f"columns {sorted(solution.flags.columns)}, declared are {sorted(declared)}"
        if solution.flags.used.dtype != np.bool_:
            yield f"used is {solution.flags.used.dtype}, not bool"
        for name, column in {"used": solution.flags.used, **solution.flags.columns}.items():
            if column.shape != (_SNAPSHOTS, measurements):
                yield f"{name} has shape {column.shape}, not {(_SNAPSHOTS, measurements)}"
        yield from _used_disagrees(solution.estimates, solution.flags.used)
        plain = dataclasses.replace(bench.solve(batch, want_flags=False), flags=None)
        rows = np.arange(_SNAPSHOTS)
        bare = dataclasses.replace(solution, flags=None)
        for difference in same_bits(estimates_of(bare, rows), estimates_of(plain, rows)):
            yield f"when the batch wants no flags, {difference}"


def _used_disagrees(estimates: Estimates, used: Any) -> Iterator[str]:
    """Yield the snapshots of one target whose ``used`` rows are not ``n_used`` in number."""
    best = (estimates.target == 0) & (estimates.alternative == 0)
    several = np.isin(estimates.row, estimates.row[estimates.target > 0])
    for number in np.flatnonzero(best & ~several):
        row = estimates.row[number]
        if used[row].sum() != estimates.n_used[number]:
            yield f"snapshot {row} has {used[row].sum()} rows used, but n_used is {estimates.n_used[number]}"


def read_only(bench: Bench) -> Iterator[str]:
    """The input is not changed: its arrays may be read-only."""
    for measurements in bench.usual_measurements:
        batch = bench.mixed(_SNAPSHOTS, measurements)
        for writeable in (True, False):
            given = copy_batch(batch, writeable=writeable)
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                bench.spec.solve(given, bench.options)
            for field in dataclasses.fields(batch):
                before, after = getattr(batch, field.name), getattr(given, field.name)
                if isinstance(before, np.ndarray) and not np.array_equal(before, after, equal_nan=True):
                    yield f"{field.name} was changed"


def quiet(bench: Bench) -> Iterator[str]:
    """It neither warns nor prints for any snapshots: standard output carries data only."""
    for measurements in bench.usual_measurements:
        batch = copy_batch(bench.mixed(_SNAPSHOTS, measurements), writeable=True)
        printed = io.StringIO()
        with warnings.catch_warnings(record=True) as caught, contextlib.redirect_stdout(printed):
            warnings.simplefilter("always")
            bench.spec.solve(batch, bench.options)
        for warning in caught:
            yield f"it warns: {warning.category.__name__}: {warning.message}"
        if printed.getvalue():
            yield f"it prints {printed.getvalue()[:60]!r}"


def _columns_of(batch: Any) -> frozenset[str]:
    """Return the input columns that the batch was made of."""
    made = (
        (name, parts)
        for name, parts in {**batch.SOURCES, **batch.SPACE_SOURCES}.items()
        if getattr(batch, name) is not None
    )
    return frozenset(part for _, parts in made for part in parts)
