"""Lenth 1981: fixes of bearings without standard deviations, and the coverage of their ellipses."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from nlosctl.api import localize
from nlosctl.arrays import FloatArray
from nlosctl.contract.scene import Scene
from nlosctl.evaluation.consistency import squared_mahalanobis
from nlosctl.geometry.ellipses import ellipse_threshold
from nlosctl.io.results.tables import measurement_table
from nlosctl.plotting.panels import LinesPanel, Panel
from nlosctl.reproduce.experiment import Chunk, Claim, Experiment
from nlosctl.reproduce.lenth.paper import PAPER, example_figures
from nlosctl.reproduce.panels import curve
from nlosctl.reproduce.samples import Condition, Results, Samples, at, conditions, rms_of, share, share_of
from nlosctl.reproduce.verdicts import Expected, about, at_most, between, printed
from nlosctl.scenarios.bearing_rows import bearing_columns

__all__ = ["EXPERIMENT"]

_PROBABILITY = 0.95
_SIDE_M = 1000.0
_RELATIVE_STDS = (0.5, 1.0, 2.0)
_POOLS = ("snapshot", "file")
_ROWS = (3, 4, 5, 6, 7, 8)
_FIT = "independent fit"


def _sample(condition: Condition, chunk: Chunk) -> Samples:
    """Return whether the 95 % ellipse contains the source, and the factor of the standard deviations over its truth."""
    generator, rows = chunk.generator(), int(condition["rows"])
    source = generator.uniform(0.0, _SIDE_M, (chunk.size, 2))
    columns = bearing_columns(
        scene=Scene(),
        generator=generator,
        names=tuple(f"s{number}" for number in range(rows)),
        sensor_xy_m=generator.uniform(0.0, _SIDE_M, (chunk.size, rows, 2)),
        source_xy_m=source,
        bearing_std_rad=np.tile(
            np.radians(float(condition["bearing_std_deg"])) * np.resize(_RELATIVE_STDS, rows), (chunk.size, 1)
        ),
    )
    table = measurement_table("bearings", columns)
    estimates = localize(table, method="ml", kind="bearings", estimate_std=str(condition["estimate_std"])).estimates

    def numbers(*names: str) -> FloatArray:
        values = [estimates.column(name).to_numpy(zero_copy_only=False).astype(float) for name in names]
        return np.stack(values, axis=-1)

    degrees, factor = numbers("std_dof", "std_factor").T
    squared = squared_mahalanobis(numbers("x_m", "y_m") - source, numbers("cov_xx_m2", "cov_xy_m2", "cov_yy_m2"))
    covered = np.where(np.isfinite(squared), squared <= ellipse_threshold(_PROBABILITY, degrees), np.nan)
    return {"covered": covered, "located": np.isfinite(squared).astype(float), "factor": factor}


def _coverage(samples: Samples) -> float:
    """Return the share of the ellipses that contain the source."""
    return share(samples["covered"][np.isfinite(samples["covered"])])


def _panels(results: Results) -> Sequence[Panel]:
    lines = tuple(curve(results, "rows", pool, _coverage, estimate_std=pool) for pool in _POOLS)
    return [LinesPanel(x_label="bearings [-]", y_label="95 % ellipses with the source [-]", lines=lines)]


def _example(example: str, law: str, figure: str, text: str, expected: Expected) -> Claim:
    return Claim(
        text=f"{example}, {law}: {text}",
        where="example" if law == "vonmises" and figure in ("x", "y") else _FIT,
        ours=lambda results: example_figures(example, law)[figure],
        expected=expected,
        unit="deg" if figure == "std_deg" else "",
    )


def _position(example: str, law: str, x: str, y: str) -> list[Claim]:
    return [_example(example, law, name, name, printed(value)) for name, value in (("x", x), ("y", y))]


def _distance(law: str, x: float, y: float) -> Claim:
    def ours(results: Results) -> float:
        fix = example_figures("question 33352", law)
        return math.hypot(fix["x"] - x, fix["y"] - y)

    text = f"question 33352, {law}: distance from ({x:.2f}, {y:.2f})"
    return Claim(text=text, where=_FIT, ours=ours, expected=at_most(0.01, "0"), unit="m")


def _spread(example: str, law: str, std: str, error_x: str, error_y: str) -> list[Claim]:
    return [
        _example(example, law, "std_deg", "std", printed(std)),
        *(
            _example(example, law, f"error_{name}", f"standard error of {name}", about(float(value), 0.03, value))
            for name, value in (("x", error_x), ("y", error_y))
        ),
    ]


_EXAMPLES = (
    *_position("seven bearings", "vonmises", "7.23", "1.98"),
    *_spread("seven bearings", "vonmises", "3.41", "0.1823", "0.1816"),
    *_position("seven bearings", "gaussian", "7.2286", "1.9809"),
    *_spread("seven bearings", "gaussian", "3.41", "0.1823", "0.1815"),
    *_position("eight bearings", "vonmises", "5.87", "1.13"),
    *_spread("eight bearings", "vonmises", "28.2", "1.660", "2.026"),
    *_position("eight bearings", "gaussian", "5.5247", "1.0029"),
    *_spread("eight bearings", "gaussian", "31.0", "1.739", "2.167"),
    _distance("vonmises", 553455.14, 2814130.72),
    *_spread("question 33352", "vonmises", "6.51", "34.5", "26.6"),
    _distance("gaussian", 553455.15, 2814130.74),
    *_spread("question 33352", "gaussian", "6.53", "34.5", "26.6"),
    _example("question 33352", "vonmises", "radius", "95 % radius in standard errors", printed("20.0")),
)

EXPERIMENT = Experiment(
    name="lenth-coverage",
    paper=PAPER,
    title="Fixes without std, and the coverage of their ellipses",
    conditions=conditions(estimate_std=_POOLS, rows=_ROWS, bearing_std_deg=(2.0,)),
    sample=_sample,
    quantities={"coverage_95": _coverage, "share_located": share_of("located"), "rms_std_factor": rms_of("factor")},
    claims=(
        *_EXAMPLES,
        *(
            Claim(
                text=f"Share of the 95 % ellipses with the source, std by {pool}, {rows} bearings",
                where="nominal coverage",
                ours=at(_coverage, estimate_std=pool, rows=rows),
                expected=between(0.93, 0.97, "0.95"),
            )
            for pool in _POOLS
            for rows in _ROWS
        ),
    ),
    panels=_panels,
    trials=4000,
    quick_trials=400,
    chunk_trials=500,
)
