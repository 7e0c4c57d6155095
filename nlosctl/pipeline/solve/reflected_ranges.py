"""Ranges that name a reflector: refused for methods that can't use it, and for slant ranges by a circle."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from nlosctl import registry
from nlosctl.contract.scene import CircleReflector, Scene
from nlosctl.errors import UsageError
from nlosctl.io.measurements.reader import Chunk
from nlosctl.pipeline.solve.method_runs import MethodRun

__all__ = ["refuse_reflected_ranges"]


def refuse_reflected_ranges(chunk: Chunk, scene: Scene, runs: Sequence[MethodRun]) -> None:
    """Raise UsageError, naming the first such row, if rows that take part need what a method can't do.

    ``chunk`` has the column ``sensor_height_m`` if its ranges are slant ranges.
    """
    reflector = np.where(chunk.left_out, -1, chunk.columns["reflector"])
    reflected = np.flatnonzero(reflector >= 0)
    unable = [run.spec.name for run in runs if "reflector" not in run.spec.reads]
    if reflected.size and unable:
        able = ", ".join(_methods_that_can())
        raise UsageError(
            f"{_cell(chunk, int(reflected[0]), scene)}, but {', '.join(dict.fromkeys(unable))} takes every range as "
            f"direct; localize by {able}, or leave such rows out (los false)"
        )
    if "sensor_height_m" in chunk.columns:
        by_circle = np.array([isinstance(part, CircleReflector) for part in scene.reflectors], dtype=bool)
        bent = reflected[by_circle[reflector[reflected]] & (chunk.columns["sensor_height_m"][reflected] != 0.0)]
        if bent.size:
            raise UsageError(
                f"{_cell(chunk, int(bent[0]), scene)}, a circle, but with `target_z_m` the range is a slant range, and "
                "circles reflect within the plane; leave `target_z_m` out, or such rows (los false)"
            )


def _cell(chunk: Chunk, row: int, scene: Scene) -> str:
    snapshot = chunk.snapshot_ids()[int(np.searchsorted(chunk.offsets, row, side="right")) - 1]
    name = scene.reflectors[int(chunk.columns["reflector"][row])].name
    return f"{chunk.source}, snapshot {snapshot}, column 'reflector': got {name!r}"


def _methods_that_can() -> list[str]:
    specs = [registry.load(entry) for entry in registry.entries() if entry.kind == "ranges"]
    return [spec.name for spec in specs if "reflector" in spec.reads]
