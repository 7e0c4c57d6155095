"""Toy methods, each with one fault: least squares with its input or output tampered with."""

from __future__ import annotations

import dataclasses
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from nlosctl.contract.batches import BearingBatch
from nlosctl.contract.methods import CONTRACT_VERSION, MethodSpec
from nlosctl.contract.options import option
from nlosctl.contract.results import Estimates, Flags, Solution
from nlosctl.contract.statuses import Status
from nlosctl.methods import bearings_stansfield

SOUND = bearings_stansfield.METHOD

Solve = Callable[[BearingBatch, Any], Solution]


def _changed(solution: Solution, **changes: Any) -> Solution:
    return dataclasses.replace(solution, estimates=dataclasses.replace(solution.estimates, **changes))


def narrow_counts(batch: BearingBatch, options: Any) -> Solution:
    """Counts of 32 bits."""
    solution = SOUND.solve(batch, options)
    return _changed(solution, n_used=solution.estimates.n_used.astype(np.int32))


def backwards(batch: BearingBatch, options: Any) -> Solution:
    """The last snapshot first."""
    solution = SOUND.solve(batch, options)
    names = ("row", "target", "alternative", "position_m", "covariance_m2", "cost", "n_used", "status")
    names += ("chi_square", "degrees_of_freedom")
    return _changed(solution, **{name: getattr(solution.estimates, name)[::-1] for name in names})


def made_up_numbers(batch: BearingBatch, options: Any) -> Solution:
    """Zeros instead of nothing."""
    solution = SOUND.solve(batch, options)
    return _changed(solution, position_m=np.nan_to_num(solution.estimates.position_m))


def negative_covariance(batch: BearingBatch, options: Any) -> Solution:
    """A covariance of the wrong sign."""
    solution = SOUND.solve(batch, options)
    return _changed(solution, covariance_m2=-solution.estimates.covariance_m2)


def undeclared_flag(batch: BearingBatch, options: Any) -> Solution:
    """A column of flags that the specification does not have."""
    solution = SOUND.solve(batch, options)
    if solution.flags is None:
        return solution
    columns = {**solution.flags.columns, "extra": solution.flags.used}
    return dataclasses.replace(solution, flags=Flags(used=solution.flags.used, columns=columns))


def more_flags_for_few(batch: BearingBatch, options: Any) -> Solution:
    """A column of flags that only small batches have."""
    return undeclared_flag(batch, options) if batch.size < 9 else SOUND.solve(batch, options)


def writes_its_input(batch: BearingBatch, options: Any) -> Solution:
    """Writes to its input arrays."""
    solution = SOUND.solve(batch, options)
    batch.bearing_std_rad[...] *= 2.0
    return solution


def warns(batch: BearingBatch, options: Any) -> Solution:
    """A numpy warning on standard error."""
    warnings.warn("divide by zero encountered", RuntimeWarning, stacklevel=1)
    return SOUND.solve(batch, options)


def prints(batch: BearingBatch, options: Any) -> Solution:
    """Prints to standard output."""
    print("solving")  # noqa: T201
    return SOUND.solve(batch, options)


def needs_a_snapshot(batch: BearingBatch, options: Any) -> Solution:
    """Reads the first snapshot of a batch that may be empty."""
    assert batch.seed[0] >= 0
    return SOUND.solve(batch, options)


def needs_two(batch: BearingBatch, options: Any) -> Solution:
    """Reads a second measurement that may not exist."""
    assert batch.bearing_rad[:, 1].shape == batch.seed.shape
    return SOUND.solve(batch, options)


def starts_where_it_was() -> Solve:
    """Remembers earlier solutions (a warm start)."""
    seen: set[bytes] = set()

    def solve(batch: BearingBatch, options: Any) -> Solution:
        solution = SOUND.solve(batch, options)
        key = batch.bearing_rad.tobytes() + batch.seed.tobytes() + bytes([batch.want_flags])
        again = key in seen
        seen.add(key)
        return _changed(solution, cost=np.nextafter(solution.estimates.cost, np.inf)) if again else solution

    return solve


def undeclared_chance(batch: BearingBatch, options: Any) -> Solution:
    """Uses the seeds but is not declared randomized."""
    solution = SOUND.solve(batch, options)
    luck = 1.0 + 1e-12 * (batch.seed % np.uint64(7)).astype(float)
    return _changed(solution, cost=solution.estimates.cost * luck)


def sum_in_pairs(batch: BearingBatch, options: Any) -> Solution:
    """Last bits depend on the number of snapshots."""
    solution = SOUND.solve(batch, options)
    return _changed(solution, cost=solution.estimates.cost * (1.0 + 1e-12 * min(batch.size, 2)))


def one_singular_fails_all(batch: BearingBatch, options: Any) -> Solution:
    """One snapshot of parallel lines leaves all others without an answer."""
    solution = SOUND.solve(batch, options)
    estimates = solution.estimates
    parallel = (batch.reflector == -1).all(axis=1) & (np.ptp(np.mod(batch.bearing_rad, np.pi), axis=1) < 1e-9)
    if batch.measurements < 2 or not parallel.any():
        return solution
    return _changed(solution, cost=estimates.cost + 1.0)


def trusts_the_first(batch: BearingBatch, options: Any) -> Solution:
    """A fix biased towards the sensor of the first measurement."""
    solution = SOUND.solve(batch, options)
    position = solution.estimates.position_m
    return _changed(solution, position_m=position + 1e-4 * (batch.sensor_xy_m[:, 0] - position))


def knows_north(batch: BearingBatch, options: Any) -> Solution:
    """A fix biased towards the origin of the frame."""
    solution = SOUND.solve(batch, options)
    return _changed(solution, position_m=solution.estimates.position_m * (1.0 + 1e-5))


def gives_up(batch: BearingBatch, options: Any) -> Solution:
    """No answer for any snapshot."""
    solution = SOUND.solve(batch, options)
    status = np.maximum(solution.estimates.status, np.uint8(Status.TOO_FEW))
    nan = np.full((batch.size, 3), np.nan)
    used = np.zeros(batch.bearing_rad.shape, dtype=bool)
    flags = Flags(used=used, columns={"residual_rad": np.full(used.shape, np.nan)})
    silent = dataclasses.replace(solution, flags=flags)
    zero = np.zeros(batch.size, dtype=np.int64)
    return _changed(silent, status=status, position_m=nan[:, :2], covariance_m2=nan, cost=nan[:, 0], n_used=zero)


def other_flags(change: Callable[[Flags], Flags | None]) -> Solve:
    """Return a method with other flags, if flags are requested."""

    def solve(batch: BearingBatch, options: Any) -> Solution:
        solution = SOUND.solve(batch, options)
        return solution if solution.flags is None else dataclasses.replace(solution, flags=change(solution.flags))

    return solve


def other_estimates(change: Callable[[Estimates], dict[str, Any]], *, without_flags: bool = False) -> Solve:
    """Return a method with other estimates; with ``without_flags`` only if no flags are requested."""

    def solve(batch: BearingBatch, options: Any) -> Solution:
        solution = SOUND.solve(batch, options)
        changed = not (without_flags and batch.want_flags)
        return _changed(solution, **change(solution.estimates)) if changed else solution

    return solve


@dataclass(frozen=True)
class BareOptions:
    """Options, one of them undeclared."""

    speed: float = 3.0


@dataclass(frozen=True, kw_only=True)
class WildOptions:
    """Options with an invalid default."""

    share: float = option(2.0, maximum=1.0, meaning="a share")


@dataclass
class ThawedOptions:
    """Mutable options."""


def toy(solve: Solve | None = None, **changes: Any) -> MethodSpec:
    """Return the faultless method with another ``solve`` or other fields."""
    if solve is not None:
        changes["solve"] = solve
    return dataclasses.replace(
        SOUND, **{"name": "toy", "minimum_measurements": 2, "contract_version": CONTRACT_VERSION, **changes}
    )
