"""Ananthasubramaniam, Madhow, Figure 2: the Cramér-Rao bound over the field of eight receivers."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from nlosctl.evaluation.bounds import bounds_of
from nlosctl.models.information import INFORMATION
from nlosctl.plotting.panels import MapPanel, Panel, Series
from nlosctl.reproduce.experiment import Chunk, Claim, Experiment
from nlosctl.reproduce.madhow.paper import PAPER, RECEIVERS, ring
from nlosctl.reproduce.panels import lattice_points, on_lattice
from nlosctl.reproduce.samples import Condition, Results, Samples, conditions
from nlosctl.reproduce.simulated import batch_of
from nlosctl.reproduce.verdicts import about, at_most, printed
from nlosctl.scenarios import madhow_ring

__all__ = ["EXPERIMENT"]

_RADIUS_M, _CENTER_M, _SIDE_M = 457.0, 250.0, 500.0
_STDS_DEG = (2.0, 4.0)
_EDGE = 0.98
"""Points within this share of the radius count: at a receiver itself the bound is 0 or infinite."""


def _sample(condition: Condition, chunk: Chunk) -> Samples:
    half = 0.5 * _SIDE_M if condition["area"] == "field" else _RADIUS_M  # half side of the lattice
    x, y = lattice_points(chunk, (-half, half), (-half, half))
    single = Chunk(seed=chunk.seed, number=0, first=0, size=1, total=1)
    batch = batch_of(ring(single, radius_m=_RADIUS_M, bearing_std_deg=condition["bearing_std_deg"]))
    model = INFORMATION["bearings"]
    rms = bounds_of(model.at(model.seen_from(batch, x, y), x, y).matrix).rms_m
    center = bounds_of(model.at(model.seen_from(batch, np.zeros(1), np.zeros(1)), np.zeros(1), np.zeros(1)).matrix)
    inside = (np.hypot(x, y) < _EDGE * _RADIUS_M) | (condition["area"] == "field")
    return {
        "x_m": x + _CENTER_M,
        "y_m": y + _CENTER_M,
        "rms_m": np.where(inside, rms, np.nan),
        "center_rms_m": np.full(x.shape, center.rms_m[0]),
    }


def _largest_over_center(results: Results, area: str, within: float = 1.0) -> float:
    samples = results.of(area=area, bearing_std_deg=4.0)
    radius = np.hypot(samples["x_m"] - _CENTER_M, samples["y_m"] - _CENTER_M) / _RADIUS_M
    return float(np.nanmax(samples["rms_m"][radius < within]) / samples["center_rms_m"][0])


def _center_over_printed(results: Results) -> float:
    """Return the trace of the bound at the centre divided by the printed (20)."""
    trace = float(results.of(area="field", bearing_std_deg=4.0)["center_rms_m"][0]) ** 2
    std_m = _RADIUS_M * float(np.radians(4.0))
    return trace / (2.0 * std_m * std_m / (np.pi**2 * (RECEIVERS - 1)))


def _panels(results: Results) -> Sequence[Panel]:
    panels = []
    for area, std_deg in (("field", 2.0), ("field", 4.0), ("disc", 4.0)):
        samples = results.of(area=area, bearing_std_deg=std_deg)
        x, y, rms = on_lattice(samples["x_m"], samples["y_m"], samples["rms_m"])
        world = madhow_ring.scene(madhow_ring.MadhowRingOptions(radius_m=_RADIUS_M))
        receivers = np.array([sensor.position for sensor in world.sensors]) + _CENTER_M
        points = (Series(label="receivers", x=receivers[:, 0], y=receivers[:, 1], style=1),) if area == "disc" else ()
        panels.append(
            MapPanel(
                x_label="x [m]",
                y_label="y [m]",
                title=f"{'the field' if area == 'field' else 'the whole disc'}, {std_deg:g} deg",
                equal_aspect=True,
                x=x,
                y=y,
                values=rms,
                label="rms bound [m]",
                points=points,
                contours=area == "field",
            )
        )
    return panels


EXPERIMENT = Experiment(
    name="madhow-fig2",
    paper=PAPER,
    title="Cramer-Rao bound over the field, 8 receivers around it",
    conditions=conditions(area=("field", "disc"), bearing_std_deg=_STDS_DEG),
    sample=_sample,
    quantities={
        "center_rms_m": lambda part: float(part["center_rms_m"][0]),
        "largest_rms_m": lambda part: float(np.nanmax(part["rms_m"])),
    },
    claims=(
        Claim(
            text="The bound is highest at the centre: largest rms bound in the figure's square over that at the centre",
            where="Section III-C, Fig. 2",
            ours=lambda results: _largest_over_center(results, "field"),
            expected=at_most(1.001, "1"),
        ),
        Claim(
            text="The centre of the disc is the worst position: largest rms bound in the disc over that at the centre",
            where="Section III-C",
            ours=lambda results: _largest_over_center(results, "disc"),
            expected=at_most(1.001, "1"),
            note="Near the rim, midway between two receivers, it is larger; the centre is worst up to about 0.8 radii.",
        ),
        Claim(
            text="... within 0.75 radii",
            where="Section III-C",
            ours=lambda results: _largest_over_center(results, "disc", 0.75),
            expected=at_most(1.001, "1"),
        ),
        Claim(
            text="At the centre it is about 2 R^2 s^2 / (pi^2 (N - 1)): trace of the bound over that",
            where="(20)",
            ours=_center_over_printed,
            expected=about(1.0, 0.2, "1"),
            note="It is 4 R^2 s^2 / N exactly; the pi^2 is spurious, and makes the rms 4.2 times too small.",
        ),
        Claim(
            text="The error grows linearly with the spread: rms bound at the centre, 4 deg over 2 deg",
            where="Section III-C",
            ours=lambda results: (
                results.of(area="field", bearing_std_deg=4.0)["center_rms_m"][0]
                / results.of(area="field", bearing_std_deg=2.0)["center_rms_m"][0]
            ),
            expected=printed("2.000"),
        ),
        Claim(
            text="rms bound at the centre, 4 deg",
            where="Fig. 2",
            ours=lambda results: float(results.of(area="field", bearing_std_deg=4.0)["center_rms_m"][0]),
            unit="m",
        ),
    ),
    panels=_panels,
    trials=10_000,
    quick_trials=2_500,
    chunk_trials=10_000,
    random=False,
)
