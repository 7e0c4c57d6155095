"""Which views there are of a user's files. Imports neither numpy nor matplotlib."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["MEASUREMENTS", "VIEWS", "View"]

MEASUREMENTS = ("bearings", "ranges", "triplets")


@dataclass(frozen=True, kw_only=True)
class View:
    """A kind of picture: what it shows, and the files that it ``takes`` (in words, for the list of views)."""

    name: str
    shows: str
    takes: str


VIEWS: dict[str, View] = {
    view.name: view
    for view in (
        View(
            name="scene",
            shows="one snapshot: sensors, mirrors, bearings with +-1 std, reflected rays, ranges, estimates with 95 % "
            "ellipses, truth",
            takes="measurements or flags (bearings, ranges), estimates, or both",
        ),
        View(
            name="estimates",
            shows="all estimates over the scene, by method; their density where they are many",
            takes="estimates",
        ),
        View(name="cdf", shows="distribution of the position error, by method and sweep", takes="estimates with truth"),
        View(
            name="sweep",
            shows="a figure of 'evaluate' (--y, the RMSE unless told) against a sweep column, by method, with +-1 "
            "standard error",
            takes="scores, or estimates or flags with truth; bounds per snapshot beside them",
        ),
        View(
            name="roc",
            shows="P_d over P_fa as the threshold moves, and how well p-values or probabilities are calibrated",
            takes="flags with ip and truth_ip, or with los and truth_los",
        ),
        View(name="map", shows="Cramer-Rao bound over the plane", takes="a map of 'bound --map'"),
        View(
            name="echoes",
            shows="one snapshot of ranges as circles about their sensors, by the target that they are given to",
            takes="flags of identify-los, and its estimates",
        ),
        View(
            name="triplets",
            shows="one snapshot of triplets: rays, ellipses of equal path length, and the three points of each path",
            takes="triplets or their flags, and estimates",
        ),
    )
}
