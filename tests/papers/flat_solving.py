"""Solving a drawn bearings scenario at array level, for the tests of the papers' figures."""

from __future__ import annotations

import numpy as np

from nlosctl.contract.batches import BearingBatch
from nlosctl.evaluation.estimates import EstimateRows, EstimateScores
from nlosctl.methods import bearings_ls, bearings_ml, bearings_stansfield
from nlosctl.scenarios.catalogue import find_scenario
from nlosctl.scenarios.spec import draw_snapshots

METHODS = {module.METHOD.name: module.METHOD for module in (bearings_ls, bearings_stansfield, bearings_ml)}


def dense_batch(scene, columns):
    """Return the batch of columns in which every snapshot has the same sensors."""
    sensors = int(np.count_nonzero(columns["snapshot"] == columns["snapshot"][0]))
    place = {name: number for number, name in enumerate(scene.reflector_names)} | {None: -1}
    rows = len(columns["snapshot"])
    reflector = np.array([place[name] for name in columns.get("reflector", [None] * rows)])

    def dense(*names):
        parts = [columns[name].reshape(-1, sensors) for name in names]
        return np.asfortranarray(parts[0] if len(parts) == 1 else np.stack(parts, axis=-1))

    snapshots = rows // sensors
    return BearingBatch(
        scene=scene,
        seed=np.zeros(snapshots, dtype=np.uint64),
        sensor=np.asfortranarray(np.tile(np.arange(sensors), (snapshots, 1))),
        sensor_xy_m=dense("sensor_x_m", "sensor_y_m"),
        bearing_rad=dense("bearing_rad"),
        bearing_std_rad=dense("bearing_std_rad"),
        path=np.full((snapshots, sensors), -1, order="F"),
        reflector=np.asfortranarray(reflector.reshape(snapshots, sensors)),
        want_flags=True,
    )


def bearings_batch(scene, sensors, bearings, sigmas, reflectors):
    """Return the batch of snapshots (B, K) from nested lists."""
    shape = np.shape(bearings)
    return BearingBatch(
        scene=scene,
        seed=np.zeros(shape[0], dtype=np.uint64),
        sensor=np.asfortranarray(np.broadcast_to(np.arange(shape[1]), shape)),
        sensor_xy_m=np.asfortranarray(np.broadcast_to(np.asarray(sensors, dtype=float), (*shape, 2))),
        bearing_rad=np.asfortranarray(np.asarray(bearings, dtype=float)),
        bearing_std_rad=np.asfortranarray(np.broadcast_to(np.asarray(sigmas, dtype=float), shape)),
        path=np.full(shape, -1, order="F"),
        reflector=np.asfortranarray(np.broadcast_to(np.asarray(reflectors), shape)),
        want_flags=True,
    )


def solve(name, batch):
    """Return the solution of a batch by a built-in method with its defaults."""
    spec = METHODS[name]
    return spec.solve(batch, spec.options())


def solved_rows(scenario, trials, seed, **options):
    """Return, by method, the estimates of all snapshots of a draw as `EstimateRows`."""
    spec = find_scenario(scenario)
    chosen = spec.options(**options)
    chunks = {name: [] for name in METHODS}
    for columns in draw_snapshots(spec, chosen, seed, trials):
        batch = dense_batch(spec.scene(chosen), columns)
        first = slice(None, None, batch.measurements)
        truth = np.stack([columns["truth_x_m"][first], columns["truth_y_m"][first]], axis=1)
        for name in METHODS:
            estimates = solve(name, batch).estimates
            chunks[name].append((estimates.position_m, estimates.covariance_m2, estimates.status, truth))
    return {name: _rows(*(np.concatenate(part) for part in zip(*parts, strict=True))) for name, parts in chunks.items()}


def _rows(position, covariance, status, truth):
    return EstimateRows(position_m=position, covariance_m2=covariance, status=status, truth_m=truth)


def summaries(rows_by_method):
    """Return the summary of each method's rows."""
    scores = EstimateScores()
    for name, rows in rows_by_method.items():
        scores.add(rows, keys=(name,))
    return scores.result()
