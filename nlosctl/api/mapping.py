"""The function that maps the posterior of a position."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from nlosctl.api.tables import SceneLike, TableSink, input_options, inputs_of
from nlosctl.contract.fields import parse_field
from nlosctl.contract.run_options import OutputOptions, SolveOptions
from nlosctl.jobs import posterior as posterior_job
from nlosctl.jobs.files import Destination

__all__ = ["posterior"]


def posterior(
    table: Any,
    *,
    snapshot: Any = None,
    all: bool = False,
    combine: bool = False,
    cell: float | None = None,
    max_cells: int = 1_000_000,
    method: str = "ml",
    field: str = "sensors:1",
    scene: SceneLike = None,
    crs: str | None = None,
    origin: tuple[float, float] | None = None,
    kind: str | None = None,
    target_z_m: float | None = None,
    target_z_std_m: float | None = None,
    columns: Mapping[str, str] | None = None,
    constants: Mapping[str, float] | None = None,
    all_rows: bool = False,
    **parameters: Any,
) -> Any:
    """Return the posterior of the position on a grid of square cells as a table; see ``nlosctl posterior``.

    The map is of one ``snapshot``, of ``all`` (with a column ``snapshot``), or of one source that all of them measure
    (``combine``). Cells have sides of ``cell`` metres, by default about a hundredth of the search region ``field``;
    more than ``max_cells`` are an error. ``method`` is ml or mixture-ml, ``parameters`` are its own and those of a
    prior (``prior_x_m``, ``prior_y_m``, ``prior_std_m``). The other arguments are those of `localize`.

    Raises DataError for faults of the data and if there is nothing to show, UsageError for invalid options.
    """
    read = input_options(columns, constants, scene, parameters, kind=kind, all_rows=all_rows, crs=crs, origin=origin)
    heights: dict[str, Any] = {"target_z_m": target_z_m, "target_z_std_m": target_z_std_m}
    options = SolveOptions(method=(method,), parameters=parameters, field=parse_field(field), **heights)
    name = None if snapshot is None else str(snapshot)
    maps = posterior_job.posterior_options(snapshot=name, all=all, combine=combine, cell=cell, max_cells=max_cells)
    cells = TableSink()
    destination = Destination(sinks={"posterior": cells.start})
    posterior_job.posterior(inputs_of(table), maps, read, options, OutputOptions(), destination)
    return cells.table()
