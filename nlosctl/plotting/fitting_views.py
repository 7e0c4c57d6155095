"""Which views the columns of some files allow, the one that is chosen unless told first."""

from __future__ import annotations

from collections.abc import Sequence

from nlosctl.io.results.plot_inputs import DrawnFile

__all__ = ["fitting_views"]

_TRUTH = {"truth_x_m", "truth_y_m"}


def fitting_views(files: Sequence[DrawnFile], *, one_snapshot: bool = False) -> list[str]:
    """Return the views that suit the files, best first; with ``one_snapshot`` those of a snapshot come first."""
    contents = {file.content for file in files}
    views = _views(files, contents)
    if one_snapshot:
        views.sort(key=lambda view: view not in ("scene", "echoes", "triplets"))
    return views


def _views(files: Sequence[DrawnFile], contents: set[str]) -> list[str]:
    names = [set(file.names) for file in files]
    swept = any(name.startswith("sweep_") for some in names for name in some)
    if contents <= {"scores", "bound"} and "scores" in contents:
        return ["sweep"]
    if contents == {"bound"}:
        return ["map"] if len(files) == 1 and "snapshot" not in names[0] else []
    if contents <= {"estimates", "bound"} and "estimates" in contents:
        has_truth = all(some >= _TRUTH for some, file in zip(names, files, strict=True) if file.content == "estimates")
        by_error = (["sweep"] if swept and has_truth else []) + (["cdf"] if has_truth else [])
        if "bound" in contents:
            return by_error[:1] if swept else []
        return [*by_error[:1], "estimates", *by_error[1:], "scene"] if swept else ["estimates", *by_error, "scene"]
    if contents == {"flags"}:
        return _views_of_flags(files, names, swept)
    if contents <= {"measurements", "flags", "estimates"} and len(contents) <= 2:
        return _views_of_measurements(files)
    return []


def _views_of_flags(files: Sequence[DrawnFile], names: Sequence[set[str]], swept: bool) -> list[str]:
    """Return the views of flags alone: against their truth if they have it, then as the measurements they are."""
    by_truth = all(some >= {"ip", "truth_ip"} for some in names) or all(some >= {"los", "truth_los"} for some in names)
    scored = (["sweep"] if swept else []) + ["roc"] if by_truth else []
    drawn = _views_of_measurements(files) if len(files) == 1 else []
    return [*scored, *drawn] if all("ip" in some for some in names) or swept else [*drawn, *scored]


def _views_of_measurements(files: Sequence[DrawnFile]) -> list[str]:
    measured = [file for file in files if file.content in ("measurements", "flags")]
    if len(measured) != 1:
        return []
    if measured[0].kind == "triplets":
        return ["triplets"]
    if {"target", "los"} <= set(measured[0].names) and measured[0].kind == "ranges":
        return ["echoes", "scene"]
    return ["scene"]
