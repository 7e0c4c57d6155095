"""The views of `plot`. Imports neither NumPy nor matplotlib."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["VIEWS", "View"]


@dataclass(frozen=True, kw_only=True)
class View:
    """A kind of picture: what it shows and which files it takes, in words for the list of views.

    ``uses`` are the settings of a picture that change it, beside those of any picture.
    """

    name: str
    shows: str
    takes: str
    uses: tuple[str, ...] = ()


VIEWS: dict[str, View] = {
    view.name: view
    for view in (
        View(
            name="scene",
            shows="one snapshot: sensors, mirrors, bearings with +-1 std, reflected rays, ranges, hyperbolas of "
            "arrivals, estimates with 95 % ellipses, truth; in space as plan and elevation",
            takes="measurements or flags (bearings, ranges, arrivals), estimates, or both",
            uses=("snapshot", "target_z_m"),
        ),
        View(
            name="estimates",
            shows="all estimates over the scene, by method; a density map if there are many",
            takes="estimates",
            uses=("by",),
        ),
        View(
            name="tracks",
            shows="paths with 95 % ellipses at intervals, coordinates over time with bands of 95 %",
            takes="estimates of 'track'",
            uses=("by",),
        ),
        View(
            name="cdf",
            shows="distribution of the position error, by method and sweep",
            takes="estimates with truth",
            uses=("linear",),
        ),
        View(
            name="sweep",
            shows="a figure of 'evaluate' (--y; default: the RMSE) against a sweep column, by method, with +-1 "
            "standard error",
            takes="scores, or estimates or flags with truth; optionally bounds per snapshot",
            uses=("x", "y", "linear"),
        ),
        View(
            name="roc",
            shows="ROC curve (P_d over P_fa), and calibration of the p-values or probabilities",
            takes="flags with ip and truth_ip, or with los and truth_los",
        ),
        View(
            name="map",
            shows="Cramér-Rao bound over the plane",
            takes="a map of 'bound --map'; optionally the measurements, for their sensors",
            uses=("y", "linear"),
        ),
        View(
            name="posterior",
            shows="probability of the position over the plane, with the regions of 50, 90 and 95 %",
            takes="a map of 'posterior'; optionally the measurements, for their sensors",
            uses=("snapshot",),
        ),
        View(
            name="echoes",
            shows="one snapshot of ranges as circles about their sensors, or of bearings as rays, by assigned target",
            takes="flags of identify-los, with or without its estimates",
            uses=("snapshot", "target_z_m"),
        ),
        View(
            name="triplets",
            shows="one snapshot of triplets: rays, ellipses of equal path length, and the three points of each path",
            takes="triplets or their flags, with or without estimates",
            uses=("snapshot", "path"),
        ),
        View(
            name="calibration",
            shows="offset of each sensor with its std; residuals by sensor and by direction",
            takes="a calibration (TOML), optionally with flags before and after it, or with measurements",
        ),
    )
}
