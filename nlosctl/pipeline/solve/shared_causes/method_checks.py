"""What a run refuses or remarks if its sensors and reflectors are not exactly known."""

from __future__ import annotations

from collections.abc import Sequence

from nlosctl.contract.methods import LEAST_HALF_CHI_SQUARE, MethodSpec
from nlosctl.contract.run_options import SolveOptions
from nlosctl.errors import UsageError
from nlosctl.io.measurements.completion.geometry_stds import SENSOR_STD, offset_std_name
from nlosctl.io.measurements.reader import MeasurementReader
from nlosctl.models.shared_causes.causes import uncertain_reflectors
from nlosctl.pipeline.solve.method_runs import MethodRun

__all__ = ["refuse_uncertain", "uncertain_remarks"]


def refuse_uncertain(reader: MeasurementReader, options: SolveOptions) -> None:
    """Raise UsageError for a geometry that is not exactly known if the run has no model of it."""
    known = _uncertain(reader)
    if known and reader.kind == "triplets":
        raise UsageError(
            f"triplets take {known} as exactly known; leave out the standard deviations of positions in the scene"
        )
    if known and options.estimate_std is not None:
        raise UsageError(
            "`estimate_std` takes sensors and reflectors as exactly known; leave it out, or the standard deviations "
            f"of {known}"
        )


def uncertain_remarks(reader: MeasurementReader, runs: Sequence[MethodRun]) -> list[str]:
    """Return a line on methods whose weights ignore what rows share, if there are any."""
    known = _uncertain(reader)
    names = ", ".join(dict.fromkeys(run.spec.name for run in runs if not _weighs(run.spec)))
    if known and names:
        able = {"bearings": "ml, stansfield and mixture-ml", "ranges": "r-ls and mixture-ml"}.get(reader.kind, "ml")
        return [
            f"{names}: not exactly known: {known}; its weights add the variance to that of each row alone, and {able} "
            "weigh the errors that rows share"
        ]
    return []


def _weighs(spec: MethodSpec) -> bool:
    return spec.cost == LEAST_HALF_CHI_SQUARE or spec.direct_rows is not None or spec.line_rows is not None


def _uncertain(reader: MeasurementReader) -> str:
    """Return what of the geometry is not exactly known, as text; empty if everything is."""
    names = ["position_std_m", *([] if reader.kind == "triplets" else [offset_std_name(reader.kind)])]
    sensors = [known.name for known in reader.scene.sensors if any(getattr(known, name) for name in names)]
    if reader.kind != "triplets":
        sensors += uncertain_reflectors(reader.scene) if "reflector" in reader.schema.names else []
        sensors += [f"the column {SENSOR_STD!r}"] if SENSOR_STD in reader.schema.names else []
    more = len(sensors) - 3
    return ", ".join(sensors[:3]) + (f" and {more} more" if more > 0 else "")
