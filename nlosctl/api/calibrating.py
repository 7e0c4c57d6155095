"""The function that calibrates sensors."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from os import PathLike, fspath
from typing import Any

from nlosctl.api.tables import BadRows, SceneLike, input_options, inputs_of, set_aside
from nlosctl.contract.calibration import Calibration
from nlosctl.contract.fields import parse_field
from nlosctl.contract.run_options import OutputOptions, SolveOptions
from nlosctl.io.results.tables import calibration_table
from nlosctl.io.writers.output_set import OutputSet, check_targets
from nlosctl.jobs import calibrate as calibrate_job
from nlosctl.jobs.files import Destination
from nlosctl.pipeline.calibrate.calibration_report import CalibrationReport
from nlosctl.pipeline.calibrate.known_positions import OWN_COLUMNS

__all__ = ["SensorCalibration", "calibrate"]


@dataclass(frozen=True, kw_only=True, repr=False)
class SensorCalibration:
    """Offsets of sensors, and the report of how they were estimated.

    ``bad_rows`` is a table of the rows that were set aside, if that was asked for.
    """

    report: CalibrationReport
    bad_rows: Any | None = None

    def __repr__(self) -> str:
        return "\n".join(self.report.lines())

    @property
    def calibration(self) -> Calibration:
        """The offsets with their covariance, and the factors of standard deviations."""
        return self.report.calibration

    @property
    def table(self) -> Any:
        """An Arrow table with a row per sensor, as ``--table-out`` writes it."""
        return calibration_table(self.calibration)

    def save(self, path: str | PathLike[str], *, overwrite: bool = False) -> None:
        """Write the calibration as TOML, as ``nlosctl calibrate`` does; raises DataError for an existing file."""
        check_targets([fspath(path)], overwrite=overwrite, inputs=[])
        with OutputSet() as outputs:
            outputs.write_text(fspath(path), self.report.toml(), overwrite=overwrite)


def calibrate(
    table: Any,
    *,
    method: str = "ml",
    truth: Any | None = None,
    offset_prior_m: float | None = None,
    offset_prior_deg: float | None = None,
    harmonics: int = 0,
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
    seed: int = 0,
    jobs: int = 1,
    block_size: int = 8192,
    **parameters: Any,
) -> SensorCalibration:
    """Estimate the offset of each sensor, and the factor of its standard deviations; see ``nlosctl calibrate``.

    ``truth`` is a table of true positions (or its path), or ``columns``: those of the measurements themselves; without
    it the positions are estimated too. ``offset_prior_m`` or ``offset_prior_deg`` is the standard deviation of a prior
    of mean zero. ``by`` names columns for whose values offsets are separate. With ``harmonics`` bearings have
    deviations that depend on the direction relative to the heading, up to that order. The other arguments are those of
    `localize`, ``parameters`` those of the method, ``ml`` or ``mixture-ml``.

    Raises DataError for faults of the data, UsageError for an unknown method or parameter.
    """
    read = input_options(columns, constants, scene, parameters, kind=kind, all_rows=all_rows, crs=crs, origin=origin)
    options = SolveOptions(
        method=(method,),
        parameters=parameters,
        field=parse_field(field),
        target_z_m=target_z_m,
        seed=seed,
        jobs=jobs,
        block_size=block_size,
    )
    known = truth if truth is None or (isinstance(truth, str) and truth == OWN_COLUMNS) else inputs_of(truth)
    prior = calibrate_job.Prior(offset_prior_m=offset_prior_m, offset_prior_deg=offset_prior_deg)
    with set_aside(bad_rows) as aside:
        write = OutputOptions(**aside.options)
        report = calibrate_job.calibrate(
            inputs_of(table), read, options, write, Destination(), truth=known, prior=prior, harmonics=harmonics
        )
        return SensorCalibration(report=report, **aside.tables())
