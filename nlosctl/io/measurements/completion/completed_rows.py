"""What the columns of some files imply: in three dimensions, and of arrival times."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from nlosctl.contract.calibration import Calibration
from nlosctl.contract.run_options import InputOptions
from nlosctl.contract.scene import Scene
from nlosctl.errors import UsageError
from nlosctl.io.measurements.column_mapping import ColumnPlan
from nlosctl.io.measurements.completion.array_deviations import with_headings
from nlosctl.io.measurements.completion.calibrated_rows import calibrated_chunk
from nlosctl.io.measurements.completion.exact_numbers import REST
from nlosctl.io.measurements.completion.geometry_stds import add_geometry_stds
from nlosctl.io.measurements.completion.references import arrival_plan, check_arrivals, resolve_references
from nlosctl.io.measurements.dimensions import check_space, complete_directions, refuse_several_heights
from nlosctl.io.measurements.row_checks import Fault, ReadReport
from nlosctl.io.measurements.scene_columns import SceneColumns

if TYPE_CHECKING:
    from nlosctl.io.measurements.reader import Chunk

__all__ = ["complete_columns", "completed_chunk", "completed_plan"]


def completed_plan(plan: ColumnPlan, header: Sequence[str], file: str, options: InputOptions) -> ColumnPlan:
    """Return the plan with the speed of arrival times; raise DataError for columns that need others.

    Raises UsageError for the std of a speed where there are no arrivals.
    """
    if plan.table.dimension == 3:
        check_space(plan, header, file)
    if plan.table.name == "arrivals":
        return arrival_plan(plan, file, options.speed_m_s)
    if options.speed_std_m_s:
        raise UsageError(f"`speed_std_m_s` is for arrivals, and {file} has {plan.table.name}; leave it out")
    return plan


def complete_columns(
    plan: ColumnPlan, scene: SceneColumns, batch: Any, columns: dict[str, npt.NDArray[Any]], faults: list[Fault]
) -> None:
    """Add the columns (N,) that others imply, and the faults of rows that lack something."""
    if plan.table.dimension == 3:
        complete_directions(plan, columns, faults)
    if REST in columns:
        check_arrivals(plan, scene, batch, columns, faults)
    if scene.has_stds:
        add_geometry_stds(plan, scene, columns, faults)


def completed_chunk(
    chunk: Chunk, names: Sequence[str], scene: Scene, options: InputOptions, report: ReadReport
) -> Chunk:
    """Return the chunk with the references of its differences, after a calibration.

    ``speed_std`` (N,) is the std of the speed of arrivals as a share of it, if that is uncertain. Sensors that the
    calibration lacks go to the report. Raises DataError where a snapshot's rows disagree.
    """
    refuse_several_heights(chunk)
    if options.speed_std_m_s:
        share = np.full(int(chunk.offsets[-1]), options.speed_std_m_s / options.speed_m_s)
        chunk = replace(chunk, columns={**chunk.columns, "speed_std": share})
    chunk = resolve_references(chunk, names) if "reference" in chunk.columns else chunk
    if isinstance(options.calibration, Calibration):
        if options.calibration.harmonics:
            chunk = with_headings(chunk, scene, options.calibration)
        if not options.calibration.entries:
            return chunk
        chunk, lacking = calibrated_chunk(chunk, options.calibration)
        report.uncalibrated.update(" ".join(key) for key in lacking)
    return chunk
