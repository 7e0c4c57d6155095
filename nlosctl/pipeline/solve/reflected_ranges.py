"""Ranges that name a reflector: refused if a method can't use it, and by a circle if slant or beside a bearing."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from nlosctl import registry
from nlosctl.contract.scene import CircleReflector, Scene
from nlosctl.errors import UsageError
from nlosctl.io.measurements.reader import Chunk
from nlosctl.pipeline.solve.method_runs import MethodRun

__all__ = ["refuse_circle_ranges", "refuse_reflected_ranges"]


def refuse_reflected_ranges(chunk: Chunk, kind: str, scene: Scene, runs: Sequence[MethodRun]) -> None:
    """Raise UsageError, naming the first such row, if ranges in rows that take part need what a method can't do.

    ``chunk`` has the column ``sensor_height_m`` if its ranges are slant ranges.
    """
    if kind != "ranges":
        if any("range_m" in run.spec.reads and getattr(run.options, "use_ranges", True) for run in runs):
            refuse_circle_ranges(chunk, scene)
        return
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


def refuse_circle_ranges(chunk: Chunk, scene: Scene) -> None:
    """Raise UsageError, naming the first such row, if a bearing by a circle has a range: its path is not unfolded."""
    if not {"range_m", "range_std_m"} <= chunk.columns.keys():
        return
    reflector = np.where(chunk.left_out, -1, chunk.columns["reflector"])
    by_circle = np.array([isinstance(part, CircleReflector) for part in scene.reflectors], dtype=bool)
    ranged = np.isfinite(chunk.columns["range_m"]) & np.isfinite(chunk.columns["range_std_m"])
    bent = np.flatnonzero((reflector >= 0) & by_circle[reflector] & ranged)
    if bent.size:
        raise UsageError(
            f"{_cell(chunk, int(bent[0]), scene)}, a circle, and the row has a range beside its bearing; empty range_m "
            "in such rows, or leave the ranges out (use_ranges=false); ranges alone are a file of ranges"
        )


def _cell(chunk: Chunk, row: int, scene: Scene) -> str:
    snapshot = chunk.snapshot_ids()[int(np.searchsorted(chunk.offsets, row, side="right")) - 1]
    name = scene.reflectors[int(chunk.columns["reflector"][row])].name
    return f"{chunk.source}, snapshot {snapshot}, column 'reflector': got {name!r}"


def _methods_that_can() -> list[str]:
    specs = [registry.load(entry) for entry in registry.entries() if entry.kind == "ranges"]
    return [spec.name for spec in specs if "reflector" in spec.reads]
