"""Laws on how an answer depends on its input. Each is a generator of complaints; the first one counts."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator

import numpy as np

from nlosctl.arrays import IntArray
from nlosctl.contract.results import FORM, MISFIT_FORM, Flags, Solution
from nlosctl.contract.statuses import Status
from nlosctl.testing.bench import Bench
from nlosctl.testing.compare import close_solutions, estimates_of, same_bits
from nlosctl.testing.moves import Motion, move_batch, permute_measurements, replace_rows, take_rows

__all__ = ["answers", "any_number", "batches", "degenerate", "deterministic", "empty", "frame", "order", "seeds"]

_SNAPSHOTS = 17
_MOST_MEASUREMENTS = 12


def empty(bench: Bench) -> Iterator[str]:
    """A batch of no snapshots gives no estimates."""
    for measurements in bench.usual_measurements:
        nothing = take_rows(bench.ordinary(1, measurements).batch, np.empty(0, dtype=np.int64))
        solution = bench.solve(nothing)
        if solution.estimates.row.size:
            yield f"{solution.estimates.row.size} estimates of no snapshots"
        if solution.flags is not None and solution.flags.used.shape != (0, measurements):
            yield f"flags.used has shape {solution.flags.used.shape}, not {(0, measurements)}"


def batches(bench: Bench) -> Iterator[str]:
    """A batch is solved as its snapshots one by one, to the bit."""
    for measurements in (*bench.usual_measurements, _MOST_MEASUREMENTS):
        batch = bench.ordinary(_SNAPSHOTS, measurements).batch
        whole = bench.solve(batch)
        for rows in (*np.arange(_SNAPSHOTS)[:, None], np.arange(5), np.arange(5, _SNAPSHOTS)):
            part = bench.solve(take_rows(batch, rows))
            for difference in same_bits(estimates_of(whole, rows), estimates_of(part, np.arange(len(rows)))):
                yield f"of {_SNAPSHOTS} snapshots and of {len(rows)} alone, {difference}"


def any_number(bench: Bench) -> Iterator[str]:
    """Any number of measurements is taken; below ``minimum_measurements`` every status is too_few."""
    for measurements in range(1, _MOST_MEASUREMENTS + 1):
        estimates = bench.solve(bench.ordinary(4, measurements).batch).estimates
        if set(estimates.row.tolist()) != {0, 1, 2, 3}:
            yield f"with {measurements} measurements, estimates of snapshots {sorted(set(estimates.row.tolist()))} of 4"
        others = estimates.status[estimates.status != Status.TOO_FEW]
        if measurements < bench.spec.minimum_measurements and others.size:
            yield f"with {measurements} measurements, the status {Status(others[0]).word}"


def frame(bench: Bench) -> Iterator[str]:
    """Moving and turning the frame moves the answer; exempt: frame."""
    for measurements in (bench.plenty, bench.usual_measurements[1]):
        trial = bench.ordinary(_SNAPSHOTS, measurements)
        reach = trial.size_m * 10.0 ** bench.generator.uniform(-1.0, 3.0)
        shift = bench.generator.uniform(-reach, reach, 2)
        angle = bench.generator.uniform(-np.pi, np.pi)
        lift = bench.generator.uniform(-reach, reach) if trial.batch.dimension == 3 else 0.0
        motion = Motion(angle_rad=angle, shift_m=(shift[0], shift[1]), lift_m=lift)
        moved = bench.solve(move_batch(trial.batch, motion, bench.draw.directions))
        expected = _move_solution(bench.solve(trial.batch), motion)
        size_m = max(trial.size_m, float(np.hypot(*shift)), abs(lift))
        for difference in close_solutions(expected, moved, size_m):
            yield f"turned by {motion.angle_rad:.3f} rad and shifted by {np.hypot(*shift):.3g} m, {difference}"


def order(bench: Bench) -> Iterator[str]:
    """Permuting the measurements changes only the order of flags, and of estimates of single ones; exempt: order."""
    for measurements in (bench.plenty, bench.usual_measurements[1]):
        trial = bench.ordinary(_SNAPSHOTS, measurements)
        for permutation in (np.arange(measurements)[::-1], bench.generator.permutation(measurements)):
            permuted = bench.solve(permute_measurements(trial.batch, permutation))
            expected = _permute_single_estimates(_permute_flags(bench.solve(trial.batch), permutation), permutation)
            for difference in close_solutions(expected, permuted, trial.size_m):
                yield f"with the measurements in the order {permutation.tolist()}, {difference}"


def degenerate(bench: Bench) -> Iterator[str]:
    """A degenerate snapshot spoils no other, to the bit."""
    for measurements in bench.usual_measurements:
        batch = bench.ordinary(_SNAPSHOTS, measurements).batch
        before = bench.solve(batch)
        for fault in bench.draw.faults:
            faulty = bench.draw.trial(bench.generator, 1, measurements, fault).batch
            changed = int(bench.generator.integers(_SNAPSHOTS))
            others = np.delete(np.arange(_SNAPSHOTS), changed)
            after = bench.solve(replace_rows(batch, np.array([changed]), faulty))
            for difference in same_bits(estimates_of(before, others), estimates_of(after, others)):
                yield f"beside a degenerate snapshot ({fault}), {difference}"


def deterministic(bench: Bench) -> Iterator[str]:
    """The same batch twice gives the same, to the bit."""
    batch = bench.mixed(_SNAPSHOTS, bench.plenty)
    everything = np.arange(_SNAPSHOTS)
    first = estimates_of(bench.solve(batch), everything)
    for difference in same_bits(first, estimates_of(bench.solve(batch), everything)):
        yield f"the second time, {difference}"


def seeds(bench: Bench) -> Iterator[str]:
    """A method that is not declared ``randomized`` gives the same bits for any seeds."""
    if bench.spec.randomized:
        return
    batch = bench.mixed(_SNAPSHOTS, bench.plenty)
    other = dataclasses.replace(batch, seed=batch.seed + np.uint64(1))
    rows = np.arange(_SNAPSHOTS)
    for difference in same_bits(estimates_of(bench.solve(batch), rows), estimates_of(bench.solve(other), rows)):
        yield f"with other seeds, {difference}"


def answers(bench: Bench) -> Iterator[str]:
    """With plenty of measurements some ordinary snapshot gets a fix."""
    if not bench.spec.estimates:
        return
    status = bench.solve(bench.ordinary(4 * _SNAPSHOTS, bench.plenty).batch).estimates.status
    if not any(Status(word).is_fix for word in np.unique(status)):
        yield f"of {4 * _SNAPSHOTS} snapshots none, but {', '.join(Status(word).word for word in np.unique(status))}"


def _move_solution(solution: Solution, motion: Motion) -> Solution:
    estimates = dataclasses.replace(
        solution.estimates,
        position_m=motion.points(solution.estimates.position_m),
        covariance_m2=motion.covariances(solution.estimates.covariance_m2),
    )
    return dataclasses.replace(solution, estimates=estimates)


def _permute_single_estimates(solution: Solution, order: IntArray) -> Solution:
    """Return the solution with estimates that are each of one measurement in the measurements' new order."""
    estimates = solution.estimates
    if estimates.measurement is None:
        return solution
    where = np.argsort(order)[estimates.measurement]
    order = np.lexsort((estimates.alternative, where, estimates.row))
    names = FORM if estimates.chi_square is None else (*FORM, *MISFIT_FORM)
    permuted = {name: getattr(estimates, name)[order] for name in names}
    permuted |= {"target": where[order], "measurement": where[order]}
    return dataclasses.replace(solution, estimates=dataclasses.replace(estimates, **permuted))


def _permute_flags(solution: Solution, order: IntArray) -> Solution:
    if solution.flags is None:
        return solution
    columns = {name: column[:, order] for name, column in solution.flags.columns.items()}
    return dataclasses.replace(solution, flags=Flags(used=solution.flags.used[:, order], columns=columns))
