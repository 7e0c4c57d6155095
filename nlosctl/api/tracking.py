"""The function that finds the paths of moving sources."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from nlosctl.api.tables import BadRows, SceneLike, TableSink, input_options, inputs_of, names_of, set_aside
from nlosctl.contract.fields import parse_field
from nlosctl.contract.run_options import OutputOptions, SolveOptions
from nlosctl.jobs import track as track_job
from nlosctl.jobs.files import Destination
from nlosctl.pipeline.solve.report import RunReport

__all__ = ["Tracks", "track"]


@dataclass(frozen=True, kw_only=True)
class Tracks:
    """The states of tracks as an Arrow table, as the command line writes them, and the report of the run.

    ``flags`` are those of measurements, None if they were not asked for. ``bad_rows`` is a table of the rows that were
    set aside, if that was asked for.
    """

    estimates: Any
    report: RunReport
    flags: Any | None = None
    bad_rows: Any | None = None


def track(
    table: Any,
    *,
    acceleration_psd: float | None = None,
    estimate_acceleration: bool = False,
    gap: str | None = None,
    causal: bool = False,
    associate: bool = False,
    flags: bool = False,
    method: str | Sequence[str] = "ml",
    scene: SceneLike = None,
    crs: str | None = None,
    origin: tuple[float, float] | None = None,
    kind: str | None = None,
    field: str = "sensors:1",
    target_z_m: float | None = None,
    columns: Mapping[str, str] | None = None,
    constants: Mapping[str, float] | None = None,
    all_rows: bool = False,
    bad_rows: BadRows = None,
    carry: str | Sequence[str] = (),
    seed: int = 0,
    jobs: int = 1,
    block_size: int = 8192,
    **parameters: Any,
) -> Tracks:
    """Find the paths of moving sources from estimates or measurements at times; see ``nlosctl track``.

    ``acceleration_psd`` is the density of the acceleration in m2/s3, unless ``estimate_acceleration``. ``gap`` is the
    longest time within a track, such as ``60s``; with ``causal`` each state is given the rows until then. With
    ``associate`` the targets of each snapshot are assigned to tracks. ``flags``
    asks for those of measurements. ``by`` names columns that separate tracks. The other arguments are those of
    `localize`, ``parameters`` those of the method.

    Raises DataError for faults of the data, UsageError for an unknown method or parameter.
    """
    read = input_options(columns, constants, scene, parameters, kind=kind, all_rows=all_rows, crs=crs, origin=origin)
    density = {} if acceleration_psd is None else {"acceleration_psd": acceleration_psd}
    options = SolveOptions(
        method=names_of(method),
        parameters={**parameters, **density},
        field=parse_field(field),
        target_z_m=target_z_m,
        seed=seed,
        jobs=jobs,
        block_size=block_size,
    )
    sinks = {name: TableSink() for name in ("estimates", *(["flags"] if flags else []))}
    destination = Destination(sinks={name: sink.start for name, sink in sinks.items()})
    motion = track_job.Motion(gap=gap, causal=causal, estimate_acceleration=estimate_acceleration, associate=associate)
    with set_aside(bad_rows) as aside:
        write = OutputOptions(carry=names_of(carry), **aside.options)
        run = track_job.track(inputs_of(table), read, options, write, destination, motion)
        return Tracks(**{name: sink.table() for name, sink in sinks.items()}, **aside.tables(), report=run.report)
