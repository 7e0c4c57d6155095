"""The note of a run whose fixes leave out more rows than `alpha` expects."""

from __future__ import annotations

from typing import Any

import numpy as np
import pyarrow as pa
import pytest

import nlosctl

SNAPSHOTS, SENSORS = 100, 8


def world(outliers: float, *, ranges: bool = False, sensors: int = SENSORS, seed: int = 5) -> dict[str, Any]:
    """Return bearings (or ranges) of sources in a ring of sensors, a share of the rows with a uniform value."""
    generator = np.random.default_rng(seed)
    angle = 2.0 * np.pi * np.arange(sensors) / sensors
    sensor = 100.0 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    offset = generator.uniform(-50.0, 50.0, (SNAPSHOTS, 1, 2)) - sensor
    wrong = generator.random((SNAPSHOTS, sensors)) < outliers
    noise = generator.standard_normal(wrong.shape)
    columns: dict[str, Any] = {
        "snapshot": np.repeat(np.arange(SNAPSHOTS), sensors),
        "sensor": np.tile(np.arange(sensors), SNAPSHOTS),
        "sensor_x_m": np.tile(sensor[:, 0], SNAPSHOTS),
        "sensor_y_m": np.tile(sensor[:, 1], SNAPSHOTS),
    }
    if ranges:
        late = np.where(wrong, generator.uniform(20.0, 200.0, wrong.shape), 0.0)
        columns["range_m"] = (np.hypot(offset[..., 0], offset[..., 1]) + noise + late).ravel()
        columns["range_std_m"] = np.ones(wrong.size)
    else:
        bearing = np.arctan2(offset[..., 1], offset[..., 0]) + 0.03 * noise
        columns["bearing_rad"] = np.where(wrong, generator.uniform(-np.pi, np.pi, wrong.shape), bearing).ravel()
        columns["bearing_std_rad"] = np.full(wrong.size, 0.03)
    return columns


def notes(columns: dict[str, Any], method: str, alpha: float, **options: Any) -> list[str]:
    """Return the notes on the share of rows that are not used."""
    report = nlosctl.localize(pa.table(columns), method=method, alpha=alpha, **options).report
    return [note for note in report.notes if "alpha expects" in note]


METHODS = pytest.mark.parametrize(
    ("method", "ranges"), [("mixture-ml", False), ("suppress", False), ("mixture-ml", True)]
)


@METHODS
def test_too_small_an_alpha_is_noted(method: str, ranges: bool) -> None:
    """With 30 % outliers `alpha` 0.05 gets a note with the share not used, and the share as `alpha` gets none."""
    columns = world(0.3, ranges=ranges)
    (note,) = notes(columns, method, 0.05)
    estimates = nlosctl.localize(pa.table(columns), method=method, alpha=0.05).estimates.to_pylist()
    fixes = [row for row in estimates if row["status"] in {"ok", "ambiguous", "infeasible", "boundary"}]
    unused = 1.0 - sum(row["n_used"] for row in fixes) / (SENSORS * len(fixes))
    assert 0.15 < unused < 0.3
    assert note.startswith(f"{method}: {100.0 * unused:.3g} % of the rows")
    assert f"than the 5 % that alpha expects; set `parameters` alpha={unused:.2g}" in note
    assert notes(columns, method, 0.3) == []


@METHODS
def test_no_note_without_outliers(method: str, ranges: bool) -> None:
    """Rows without outliers get no note, neither by the default nor by a small `alpha`."""
    assert [notes(world(0.0, ranges=ranges), method, alpha) for alpha in (0.25, 0.05)] == [[], []]


def test_no_note_from_few_rows() -> None:
    """Twelve snapshots of eight rows are too few to judge."""
    columns = {name: values[: 12 * SENSORS] for name, values in world(0.3).items()}
    assert notes(columns, "mixture-ml", 0.05) == []
    assert notes(world(0.3), "mixture-ml", 0.05)


def test_rows_that_compete_are_not_counted() -> None:
    """Further paths of a sensor are left out anyway: no note, unless an earlier step flagged them."""
    columns = world(0.0)
    doubled = {name: np.repeat(values, 2) for name, values in columns.items()}
    second = np.arange(doubled["snapshot"].size) % 2 == 1
    doubled["path"] = second.astype(np.int64)
    doubled["bearing_rad"] = doubled["bearing_rad"] + np.where(second, 1.5, 0.0)
    assert notes(doubled, "mixture-ml", 0.05, ambiguous_rows=0) == []
    outliers = world(0.3)
    doubled["bearing_rad"] = np.repeat(outliers["bearing_rad"], 2)
    assert notes({**doubled, "los": ~second}, "mixture-ml", 0.05) == notes(outliers, "mixture-ml", 0.05) != []


@pytest.mark.process
@pytest.mark.usefixtures("small_chunks")
def test_the_note_does_not_depend_on_the_chunks(monkeypatch: pytest.MonkeyPatch) -> None:
    """Chunks of a few snapshots, solved by one process or two, have the note of one chunk."""
    parts = [notes(world(0.3), "mixture-ml", 0.05, jobs=jobs) for jobs in (1, 2)]
    monkeypatch.delenv("NLOSCTL_CHUNK_ROWS")
    whole = notes(world(0.3), "mixture-ml", 0.05)
    assert len(whole) == 1
    assert parts == [whole, whole]
