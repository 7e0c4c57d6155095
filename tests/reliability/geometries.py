"""Snapshots of any size at any position: draws of the laws, scaled, moved, and made nearly degenerate."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from nlosctl.contract.fields import CircleField
from nlosctl.contract.scene import LineReflector, Scene
from nlosctl.testing.draws import DRAWS, Trial
from nlosctl.testing.moves import Motion, move_batch

__all__ = ["drawn", "moved", "nearly", "scaled", "scaled_options"]


def drawn(
    spec: Any, *, seed: int, snapshots: int, measurements: int, fault: str | None, size_m: float, offset_m: float
) -> tuple[Trial, Motion]:
    """Return a trial whose scene has the size ``size_m`` (to a factor of 3), at a distance of ``offset_m``."""
    generator = np.random.default_rng(seed)
    draw = DRAWS[spec.kind, spec.job]
    trial = draw.trial(generator, snapshots, measurements, fault)
    batch = scaled(trial.batch, size_m / trial.size_m)
    turn = float(generator.uniform(-np.pi, np.pi))
    away = float(generator.uniform(-np.pi, np.pi))
    motion = Motion(angle_rad=turn, shift_m=(offset_m * np.cos(away), offset_m * np.sin(away)))
    return Trial(batch=batch, size_m=size_m), motion


def moved(spec: Any, batch: Any, motion: Motion) -> Any:
    """Return the batch in the moved frame."""
    return move_batch(batch, motion, DRAWS[spec.kind, spec.job].directions)


def nearly(faulty: Any, ordinary: Any, share: float) -> Any:
    """Return ``faulty`` with each of its numbers moved by the fraction ``share`` towards those of ``ordinary``."""
    arrays = {
        name: np.asfortranarray(array + share * (getattr(ordinary, name) - array))
        for name, array in _arrays(faulty).items()
        if array.dtype.kind == "f" and name != "reflector"
    }
    return dataclasses.replace(faulty, **arrays)


def scaled(batch: Any, factor: float) -> Any:
    """Return the batch with all its lengths multiplied."""
    arrays = {name: np.asfortranarray(array * factor) for name, array in _arrays(batch).items() if name.endswith("_m")}
    reflectors = tuple(_scaled_line(line, factor) for line in batch.scene.reflectors)
    field = batch.field
    if isinstance(field, CircleField):
        field = CircleField(x_m=factor * field.x_m, y_m=factor * field.y_m, radius_m=factor * field.radius_m)
    return dataclasses.replace(batch, **arrays, scene=Scene(reflectors=reflectors), field=field)


def scaled_options(options: Any, factor: float) -> Any:
    """Return the options with all lengths multiplied."""
    lengths = {
        field.name: factor * getattr(options, field.name)
        for field in dataclasses.fields(options)
        if field.metadata.get("unit") == "m" and getattr(options, field.name) is not None
    }
    return dataclasses.replace(options, **lengths)


def _arrays(batch: Any) -> dict[str, Any]:
    fields = {field.name: getattr(batch, field.name) for field in dataclasses.fields(batch)}
    return {name: array for name, array in fields.items() if isinstance(array, np.ndarray)}


def _scaled_line(line: LineReflector, factor: float) -> LineReflector:
    return dataclasses.replace(line, point=(factor * line.point[0], factor * line.point[1]))
