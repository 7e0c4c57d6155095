"""What the columns of some files imply: in three dimensions, and of arrival times."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy.typing as npt

from nlosctl.io.measurements.column_mapping import ColumnPlan
from nlosctl.io.measurements.completion.exact_numbers import REST
from nlosctl.io.measurements.completion.references import arrival_plan, check_arrivals, resolve_references
from nlosctl.io.measurements.dimensions import check_space, complete_directions, refuse_several_heights
from nlosctl.io.measurements.row_checks import Fault
from nlosctl.io.measurements.scene_columns import SceneColumns

if TYPE_CHECKING:
    from nlosctl.io.measurements.reader import Chunk

__all__ = ["complete_columns", "completed_chunk", "completed_plan"]


def completed_plan(plan: ColumnPlan, header: Sequence[str], file: str, speed_m_s: float) -> ColumnPlan:
    """Return the plan with the speed of arrival times; raise DataError for columns that need others."""
    if plan.table.dimension == 3:
        check_space(plan, header, file)
    return arrival_plan(plan, file, speed_m_s) if plan.table.name == "arrivals" else plan


def complete_columns(
    plan: ColumnPlan, scene: SceneColumns, batch: Any, columns: dict[str, npt.NDArray[Any]], faults: list[Fault]
) -> None:
    """Add the columns (N,) that others imply, and the faults of rows that lack something."""
    if plan.table.dimension == 3:
        complete_directions(plan, columns, faults)
    if REST in columns:
        check_arrivals(plan, scene, batch, columns, faults)


def completed_chunk(chunk: Chunk, names: Sequence[str]) -> Chunk:
    """Return the chunk with the references of its differences; raise DataError where a snapshot's rows disagree."""
    refuse_several_heights(chunk)
    return resolve_references(chunk, names) if "reference" in chunk.columns else chunk
