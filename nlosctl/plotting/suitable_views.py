"""The views that the columns of some files allow, the default view first."""

from __future__ import annotations

from collections.abc import Sequence

from nlosctl.contract.tables import has_states
from nlosctl.io.results.plot_inputs import PlotInput

__all__ = ["suitable_views"]

_TRUTH = {"truth_x_m", "truth_y_m"}


def suitable_views(files: Sequence[PlotInput], *, one_snapshot: bool = False) -> list[str]:
    """Return the views that suit the files, the default first; with ``one_snapshot``, those of one snapshot first."""
    contents = {file.content for file in files}
    views = _views(files, contents)
    if one_snapshot:
        views.sort(key=lambda view: view not in ("scene", "echoes", "triplets"))
    return views


def _views(files: Sequence[PlotInput], contents: set[str]) -> list[str]:
    names = [set(file.names) for file in files]
    swept = any(name.startswith("sweep_") for columns in names for name in columns)
    if "calibration" in contents:
        return _views_of_calibrations(files)
    if contents <= {"scores", "bound"} and "scores" in contents:
        return ["sweep"]
    if contents == {"bound"}:
        return ["map"] if len(files) == 1 and "snapshot" not in names[0] else []
    if contents == {"bound", "measurements"} and len(files) == 2:
        return ["map"] if all(_belongs_to_a_map(file) for file in files) else []
    if "posterior" in contents:
        one_each = len(contents) == len(files) <= 2 and contents <= {"posterior", "measurements"}
        return (
            ["posterior"]
            if one_each and all(file.kind != "triplets" or file.content == "posterior" for file in files)
            else []
        )
    if contents <= {"estimates", "bound"} and "estimates" in contents:
        has_truth = all(
            columns >= _TRUTH for columns, file in zip(names, files, strict=True) if file.content == "estimates"
        )
        by_error = (["sweep"] if swept and has_truth else []) + (["cdf"] if has_truth else [])
        if "bound" in contents:
            return by_error[:1] if swept else []
        tracks = ["tracks"] if len(files) == 1 and has_states(names[0]) else []
        if swept:
            return [*by_error[:1], "estimates", *by_error[1:], "scene"]
        return [*tracks, "estimates", *by_error, "scene"]
    if contents == {"flags"}:
        return _views_of_flags(files, names, swept)
    if contents <= {"measurements", "flags", "estimates"} and len(contents) <= 2:
        return _views_of_measurements(files)
    return []


def _views_of_calibrations(files: Sequence[PlotInput]) -> list[str]:
    """Return the view of one calibration, beside it flags, or one file of measurements, with estimates or without."""
    number = {word: sum(file.content == word for file in files) for word in ("calibration", "measurements", "flags")}
    others = {file.content for file in files} - {"calibration", "measurements", "flags", "estimates"}
    mixed = number["measurements"] + min(number["flags"], 1) > 1
    return [] if others or mixed or number["calibration"] > 1 else ["calibration"]


def _belongs_to_a_map(file: PlotInput) -> bool:
    """Return whether a file is a map of the bound, or has measurements whose sensors made it."""
    return "snapshot" not in file.names if file.content == "bound" else file.kind != "triplets"


def _views_of_flags(files: Sequence[PlotInput], names: Sequence[set[str]], swept: bool) -> list[str]:
    """Return the views of flags alone: against their truth, if present, and as measurements."""
    has_truth = any(all(columns >= {flag, f"truth_{flag}"} for columns in names) for flag in ("ip", "los"))
    scored = (["sweep"] if swept else []) + ["roc"] if has_truth else []
    measured = _views_of_measurements(files) if len(files) == 1 else []
    scores_first = swept or all("ip" in columns for columns in names)
    return [*scored, *measured] if scores_first else [*measured, *scored]


def _views_of_measurements(files: Sequence[PlotInput]) -> list[str]:
    measured = [file for file in files if file.content in ("measurements", "flags")]
    if len(measured) != 1:
        return []
    if measured[0].kind == "triplets":
        return ["triplets"]
    if {"target", "los"} <= set(measured[0].names) and measured[0].kind in ("ranges", "bearings"):
        return ["echoes", "scene"]
    return ["scene"]
