"""Flags against their truth: ROC curve with the operating point of the flags, and calibration."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, ignoring_invalid
from nlosctl.errors import DataError
from nlosctl.evaluation.calibration import reliability
from nlosctl.evaluation.detection import RocCurve, kolmogorov_smirnov, roc_curve
from nlosctl.io.results.plot_inputs import PlotInput, read_sampled
from nlosctl.plotting.figures import axis_label, figure_style, series_style
from nlosctl.plotting.library import Axes
from nlosctl.plotting.panels import Series
from nlosctl.plotting.plot_request import Picture, PlotRequest
from nlosctl.plotting.series import draw_series
from nlosctl.plotting.views.estimates import thinning_note
from nlosctl.plotting.views.snapshot_rows import labels_of_rows

__all__ = ["draw_detection_view"]

_CURVE_POINTS = 2000


@dataclass(frozen=True, kw_only=True)
class _Detector:
    """Flags of one method: rows flagged positive, true positives, and scores (low: positive; NaN: unknown)."""

    label: str
    flagged: BoolArray
    positive: BoolArray
    score: FloatArray

    @property
    def point(self) -> tuple[float, float]:
        """P_fa and P_d of the flags; NaN without such rows."""
        with ignoring_invalid():
            return tuple(  # type: ignore[return-value]
                float(np.divide(np.count_nonzero(self.flagged & rows), np.count_nonzero(rows)))
                for rows in (~self.positive, self.positive)
            )

    @property
    def curve(self) -> RocCurve:
        """The ROC curve over all thresholds, empty without scores."""
        if np.isnan(self.score).all():
            return RocCurve(np.empty(0), np.empty(0))
        return roc_curve(self.score, self.positive)


@figure_style()
def draw_detection_view(request: PlotRequest) -> Picture:
    """Draw ROC and calibration of indirect-path flags (ip, p_value) or line-of-sight flags (los, los_probability)."""
    detectors, notes = [], []
    files = request.of("flags")
    of_paths = all({"ip", "truth_ip"} <= set(file.names) for file in files)
    for file in files:
        own, own_notes = _detectors(file, of_paths, file.name if len(files) > 1 else "", request.max_rows)
        detectors += own
        notes += own_notes
    with_scores = any(detector.curve.p_fa.size for detector in detectors)
    figure, panels = request.figure(1, 2 if with_scores else 1, size_in=(9.4 if with_scores else 5.2, 4.4))
    _draw_curves(panels[0], detectors, of_paths)
    if with_scores:
        draw = _draw_p_values if of_paths else _draw_reliability
        draw(panels[1], [detector for detector in detectors if detector.curve.p_fa.size])
    else:
        notes.append(f"no ROC curve, no calibration: the flags have no {'p_value' if of_paths else 'los_probability'}")
    return Picture(figure=figure, notes=notes)


def _detectors(file: PlotInput, of_paths: bool, prefix: str, limit: int) -> tuple[list[_Detector], list[str]]:
    flag, truth, score = ("ip", "truth_ip", "p_value") if of_paths else ("los", "truth_los", "los_probability")
    rows = read_sampled(file, (flag, truth, score, "method", "source", "sweep_*"), limit)
    columns = rows.columns
    judged = np.flatnonzero((columns[flag] >= 0) & (columns[truth] >= 0))
    if not judged.size:
        raise DataError(f"{file.name}: no row has both {flag} and {truth}")
    columns = {name: values[judged] for name, values in columns.items()}
    scores = columns.get(score, np.full(judged.size, np.nan))
    labels = np.array(labels_of_rows(columns, judged.size, prefix))
    detectors = [
        _Detector(
            label=str(label),
            flagged=columns[flag][own] == 1,
            positive=columns[truth][own] == 1,
            score=scores[own] if of_paths else 1.0 - scores[own],
        )
        for label in dict.fromkeys(labels.tolist())
        for own in [labels == label]
    ]
    return detectors, thinning_note(file, rows)


def _unit_square(axes: Axes, x_label: str, y_label: str) -> None:
    """Draw the diagonal, and set limits and labels of axes from 0 to 1."""
    axes.plot([0.0, 1.0], [0.0, 1.0], color="#b0b0b0", linewidth=0.8, linestyle=":")
    axes.set_aspect("equal")
    axes.set_xlim(-0.02, 1.02)
    axes.set_ylim(-0.02, 1.02)
    axes.set_xlabel(axis_label(x_label, ""))
    axes.set_ylabel(axis_label(y_label, ""))


def _draw_curves(axes: Axes, detectors: list[_Detector], of_paths: bool) -> None:
    negatives, positives = (
        ("direct paths called indirect", "indirect paths called so")
        if of_paths
        else ("other rows called line of sight", "line-of-sight rows called so")
    )
    _unit_square(axes, f"$P_{{fa}}$: {negatives}", f"$P_d$: {positives}")
    for index, detector in enumerate(detectors):
        look = series_style(index)
        curve = detector.curve
        area = f"AUC {curve.area:.3f}" if curve.p_fa.size else ""
        label = ": ".join(filter(None, (detector.label, area)))
        if curve.p_fa.size:
            shown = np.unique(np.linspace(0, curve.p_fa.size - 1, _CURVE_POINTS).astype(np.int64))
            axes.plot(curve.p_fa[shown], curve.p_d[shown], color=look.color, linestyle=look.line, label=label)
        axes.plot(
            *detector.point,
            linestyle="none",
            marker=look.marker,
            markersize=6.5,
            color=look.color,
            markerfacecolor=look.color if look.filled else "white",
            label=f"{detector.label} as flagged".strip() if curve.p_fa.size else f"{label or 'as'} flagged",
            zorder=3.0,
        )
    axes.legend(loc="lower right")


def _draw_p_values(axes: Axes, detectors: list[_Detector]) -> None:
    """Draw the distribution of the direct paths' p-values, which is the diagonal if they are calibrated."""
    _unit_square(axes, "p-value", "share of the direct paths below")
    for index, detector in enumerate(detectors):
        values = np.sort(detector.score[~detector.positive & ~np.isnan(detector.score)])
        if not values.size:
            continue
        distance, chance = kolmogorov_smirnov(values)
        shown = np.unique(np.linspace(0, values.size - 1, min(values.size, _CURVE_POINTS)).astype(np.int64))
        look = series_style(index)
        label = ": ".join(filter(None, (detector.label, f"KS {distance:.3f}, by chance {chance:.2g}")))
        axes.plot(
            values[shown],
            (shown + 1) / values.size,
            drawstyle="steps-post",
            color=look.color,
            linestyle=look.line,
            label=label,
        )
    axes.legend(loc="lower right")


def _draw_reliability(axes: Axes, detectors: list[_Detector]) -> None:
    """Draw the share of rows in line of sight over their stated probability."""
    _unit_square(axes, "stated probability of line of sight", "share in line of sight")
    series = []
    for detector in detectors:
        bins = reliability(1.0 - detector.score, detector.positive)
        series.append(Series(label=detector.label or "flags", x=bins.stated, y=bins.share, error=bins.std_error))
    draw_series(axes, series)
