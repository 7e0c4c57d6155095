"""Functions that read, check, convert, simulate, evaluate and plot."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from os import PathLike, fspath
from pathlib import Path
from typing import Any

from nlosctl.api.tables import BadRows, SceneLike, TableSink, input_options, inputs_of, row_options, set_aside
from nlosctl.contract.flags import parse_speed
from nlosctl.contract.run_options import InputOptions, OutputOptions, SolveOptions
from nlosctl.contract.scene import Scene
from nlosctl.errors import UsageError
from nlosctl.jobs import convert as convert_job
from nlosctl.jobs import describe as describe_job
from nlosctl.jobs import evaluate as evaluate_job
from nlosctl.jobs import simulate as simulate_job
from nlosctl.jobs import validate as validate_job
from nlosctl.jobs.convert import ConversionReport
from nlosctl.pipeline.evaluate.groups import Evaluation

__all__ = ["Plot", "convert", "describe", "evaluate", "plot", "read", "simulate", "validate"]


def read(
    source: str | PathLike[str] | Sequence[str | PathLike[str]],
    *,
    importer: str | None = None,
    scene: str | PathLike[str] | None = None,
    crs: str | None = None,
    origin: tuple[float, float] | None = None,
    bad_rows: str | PathLike[str] | None = None,
    **parameters: Any,
) -> Any:
    """Return a file or folder as a pyarrow Table with the contract's types; the scene is in its metadata.

    Without ``importer`` it is a table in any format that the command line reads; with it (such as ``kraken-csv``, see
    ``nlosctl convert``; ``auto`` recognizes it) it is the file of another program, or several. ``parameters`` are those
    of the importer, or ``wide``, ``missing``, ``where`` and ``declination_deg`` of `localize`. ``bad_rows`` is the name
    of a file for bad rows; without it they are an error.

    Raises DataError for faults of the data, UsageError for an unknown importer or parameter.
    """
    whole = TableSink()
    _convert(
        source, OutputOptions(bad_rows=_path(bad_rows)), scene, crs, origin, importer, None, parameters, whole.start
    )
    return whole.table()


def convert(
    source: Any,
    output: str | PathLike[str],
    *,
    importer: str | None = None,
    exporter: str | None = None,
    scene: str | PathLike[str] | None = None,
    crs: str | None = None,
    origin: tuple[float, float] | None = None,
    overwrite: bool = False,
    bad_rows: str | PathLike[str] | None = None,
    **parameters: Any,
) -> ConversionReport:
    """Write a table or file as the file ``output``, whose extension selects the format: see ``nlosctl convert``.

    ``parameters`` are those of the exporter (of estimates to a map, such as ``fixes.geojson``) or of the importer, or
    ``wide``, ``missing``, ``where`` and ``declination_deg`` of `localize`.
    Raises DataError for faults of the data or an existing file, UsageError for options that do not apply.
    """
    write = OutputOptions(output=fspath(output), overwrite=overwrite, bad_rows=_path(bad_rows))
    return _convert(source, write, scene, crs, origin, importer, exporter, parameters, None)


def _convert(
    source: Any,
    write: OutputOptions,
    scene: str | PathLike[str] | None,
    crs: str | None,
    origin: tuple[float, float] | None,
    importer: str | None,
    exporter: str | None,
    parameters: Mapping[str, Any],
    receiver: Callable[[Any, dict[str, str]], Any] | None,
) -> ConversionReport:
    names = source if importer is not None and isinstance(source, list | tuple) else [source]
    are_names = bool(names) and all(isinstance(name, str | PathLike) for name in names)
    parameters = dict(parameters)
    rows = row_options(parameters)
    if importer is not None and not are_names:
        raise UsageError("an importer reads files; give their paths")
    return convert_job.convert(
        [fspath(name) for name in names] if are_names else inputs_of(source),
        InputOptions(scene=_path(scene), crs=crs, origin=origin, **rows),
        write,
        importer=importer,
        exporter=exporter,
        parameters=parameters,
        receiver=receiver,
    )


def validate(
    table: Any,
    *,
    scene: SceneLike = None,
    kind: str | None = None,
    columns: Mapping[str, str] | None = None,
    constants: Mapping[str, float] | None = None,
    bad_rows: BadRows = None,
    **stds: Any,
) -> dict[str, Any]:
    """Check measurements as ``nlosctl validate`` does; return the kind, counts, columns and remarks.

    The arguments are those of `localize`. With ``bad_rows`` the bad rows are counted in ``bad_rows`` (with True, the
    table of them is in ``bad_row_table``); without it they raise DataError, which names row, column, value and cure.
    """
    read = input_options(columns, constants, scene, stds, kind=kind)
    _refuse_more(stds, "validate")
    with set_aside(bad_rows) as aside:
        result = validate_job.validate(inputs_of(table), read, OutputOptions(**aside.options))
        return {**result, **{f"{name[:-1]}_table": value for name, value in aside.tables().items()}}


def describe(
    table: Any,
    *,
    scene: SceneLike = None,
    kind: str | None = None,
    columns: Mapping[str, str] | None = None,
    constants: Mapping[str, float] | None = None,
    **stds: Any,
) -> dict[str, Any]:
    """Describe measurements, or a log of another program, as ``nlosctl describe --json`` does.

    The arguments are those of `localize`. Raises DataError for a file that is neither.
    """
    read = input_options(columns, constants, scene, stds, kind=kind)
    _refuse_more(stds, "describe")
    given = [fspath(table)] if isinstance(table, str | PathLike) else inputs_of(table)
    return describe_job.describe(given, read)


def simulate(
    scenario: str,
    *,
    trials: int = 1000,
    seed: int = 0,
    scene: SceneLike = None,
    sweep: Mapping[str, Sequence[Any]] | None = None,
    **parameters: Any,
) -> Any:
    """Draw a table of measurements with ground truth; its metadata contain the scene.

    ``scene`` is a Scene or the path of a scene file, for the scenarios ``bearings`` and ``ranges``. ``sweep`` runs
    parameters through several values, with ``trials`` snapshots each; see ``nlosctl simulate``. Raises
    UsageError for an unknown scenario or parameter.
    """
    options = SolveOptions(parameters=parameters, sweep=sweep or {}, seed=seed)
    drawn = TableSink()
    own = scene if scene is None or isinstance(scene, Scene) else fspath(scene)
    simulate_job.simulate(scenario, trials, options, OutputOptions(), scene=own, sink=drawn.start)
    return drawn.table()


def evaluate(
    table: Any,
    *,
    truth: Any | None = None,
    best_alternative: bool = False,
    estimates: Any | None = None,
    ospa_order: float = 2.0,
    ospa_cutoff_m: float = 20.0,
    by: Sequence[str] = (),
    speed_m_s: float | str = "light",
) -> Evaluation:
    """Compare estimates (or flags) with the ground truth in them, by method; see ``nlosctl evaluate``.

    Each value of the columns ``by`` has figures of its own: those of flags are then of their residuals over their
    standard deviations, without a truth. ``speed_m_s`` makes lengths of standard deviations of arrival times.

    ``truth`` is a table with the true positions of the snapshots, in place of the truth in the estimates. With
    ``estimates``, the table is the flags of `identify_los` that belong to them. All are tables or paths. Raises
    DataError if the table is neither estimates nor flags, or has no ground truth.
    """
    evaluation, _ = evaluate_job.evaluate(
        inputs_of(table),
        InputOptions(speed_m_s=parse_speed(str(speed_m_s))),
        OutputOptions(),
        truth=None if truth is None else inputs_of(truth),
        estimates=None if estimates is None else _one(estimates),
        ospa_order=ospa_order,
        ospa_cutoff_m=ospa_cutoff_m,
        best_alternative=best_alternative,
        by=by,
    )
    return evaluation


@dataclass(frozen=True, kw_only=True)
class Plot:
    """A figure of matplotlib, which a notebook shows, the name of its view, and notes, such as rows left out."""

    figure: Any
    view: str
    notes: Sequence[str]

    def save(self, path: str | PathLike[str], *, overwrite: bool = False) -> None:
        """Write the figure as PNG, SVG or PDF, by the extension; raises DataError for an existing file."""
        from nlosctl.plotting.figures import save_figure

        save_figure(self.figure, Path(path), overwrite=overwrite)

    def _repr_png_(self) -> bytes:
        from nlosctl.plotting.figures import figure_bytes

        return figure_bytes(self.figure, "png")


def plot(
    *tables: Any,
    view: str | None = None,
    snapshot: Any | None = None,
    scene: SceneLike = None,
    kind: str | None = None,
    columns: Mapping[str, str] | None = None,
    target_z_m: float | None = None,
    x: str | None = None,
    y: str | None = None,
    linear: bool = False,
    title: str | None = None,
    size_in: tuple[float, float] | None = None,
    **rows: Any,
) -> Plot:
    """Plot measurements, flags, estimates or bounds (tables or paths), or the path of a calibration.

    Their contents select the view.

    The arguments are those of ``nlosctl plot``; ``rows`` are ``wide``, ``missing``, ``where``, ``declination_deg``,
    ``dimensions``, ``speed_m_s`` and standard deviations of `localize`. Raises MissingExtraError without matplotlib,
    UsageError for a view that does not suit the tables.
    """
    from contextlib import ExitStack

    from nlosctl.io.results.calibration_input import open_calibration
    from nlosctl.io.results.plot_inputs import open_plot_input
    from nlosctl.plotting.plot_request import PlotRequest
    from nlosctl.plotting.views.pictures import choose_view, draw_picture

    read = input_options(columns, None, scene, rows, kind=kind)
    _refuse_more(rows, "plot")
    with ExitStack() as stack:
        files = [open_calibration(str(table)) for table in tables if _is_calibration(table)]
        for given in (given for table in tables if not _is_calibration(table) for given in inputs_of(table)):
            files.append(open_plot_input(given, read))
            stack.callback(files[-1].close)
        if not files:
            raise UsageError("nothing to plot; give a table or the path of a file")
        name = choose_view(files, view, one_snapshot=snapshot is not None)
        wanted = None if snapshot is None else str(snapshot)
        request = PlotRequest(
            files=files,
            read=read,
            snapshot=wanted,
            target_z_m=target_z_m,
            by=read.by[0] if read.by and read.window is None else None,
            x=x,
            y=y,
            linear=linear,
            title=title,
            size_in=size_in,
        )
        picture = draw_picture(request, name)
    return Plot(figure=picture.figure, view=name, notes=tuple(picture.notes))


def _is_calibration(table: Any) -> bool:
    from nlosctl.io.results.calibration_input import is_calibration

    return isinstance(table, str | PathLike) and is_calibration(fspath(table))


def _one(table: Any) -> Any:
    """Return a table or path as its only input; raises UsageError for several."""
    given = inputs_of(table)
    if len(given) > 1:
        raise UsageError(f"got {len(given)} files, expected one table, or one folder")
    return given[0]


def _path(path: str | PathLike[str] | None) -> str | None:
    return None if path is None else fspath(path)


def _refuse_more(keywords: Mapping[str, Any], function: str) -> None:
    for name in keywords:
        raise UsageError(f"{function} takes no argument {name!r}; standard deviations are such as bearing_std_deg=2.0")
