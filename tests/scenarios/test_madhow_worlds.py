"""Scenarios of Ananthasubramaniam and Madhow."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import integrate, stats

from nlosctl.contract.scene import SegmentReflector
from nlosctl.errors import UsageError
from nlosctl.scenarios import madhow_ring, madhow_walls
from nlosctl.scenarios.bearing_rows import bearing_errors
from nlosctl.scenarios.madhow_ring import MadhowRingOptions
from nlosctl.scenarios.madhow_walls import MadhowWallsOptions, trace_paths


def test_erratum_constant_of_the_laplace_density() -> None:
    """Erratum: (2) integrates to one with 1 / (sqrt(2) s (1 - exp(-pi / (sqrt(2) s)))), not as printed."""
    std = 0.1

    def shape(angle: float) -> float:
        return math.exp(-math.sqrt(2.0) * abs(angle) / std)

    total = 2.0 * integrate.quad(shape, 0.0, math.pi / 2.0, limit=200)[0]
    corrected = 1.0 / (math.sqrt(2.0) * std * (1.0 - math.exp(-math.pi / (math.sqrt(2.0) * std))))
    printed = 1.0 / (2.0 * math.sqrt(2.0) * std * math.exp(-math.pi / (math.sqrt(2.0) * std)))
    assert corrected * total == pytest.approx(1.0)
    assert printed * total > 1e8


@pytest.mark.parametrize("model", ["gaussian", "laplace", "cauchy"])
def test_errors_follow_their_truncated_distribution(model: str) -> None:
    """Errors have the distribution of their model, truncated at a right angle on either side."""
    std = 0.6
    errors = bearing_errors(np.random.default_rng(1), model, np.full(4000, std))  # type: ignore[arg-type]
    laws = {
        "gaussian": stats.norm(scale=std),
        "laplace": stats.laplace(scale=std / math.sqrt(2.0)),
        "cauchy": stats.cauchy(scale=std),
    }
    law, edge = laws[model], math.pi / 2.0
    low, high = law.cdf(-edge), law.cdf(edge)
    assert np.abs(errors).max() <= edge
    assert stats.kstest(errors, lambda angle: (law.cdf(angle) - low) / (high - low)).pvalue > 1e-3


def test_the_requested_receivers_are_blocked() -> None:
    """``nlos_receivers`` of the receivers are outliers; in a resolved receiver all paths are."""
    options = MadhowRingOptions(nlos_receivers=3, paths=2)
    columns = madhow_ring.generate(options, np.random.default_rng(2), 50)
    direct = columns["truth_los"].reshape(50, 8, 2)
    assert np.array_equal(direct.sum(axis=2).sum(axis=1), np.full(50, 5))
    assert direct.sum(axis=2).max() == 1


def test_direct_rows_point_at_the_source_and_outliers_face_the_centre() -> None:
    """Direct bearings have small errors; outliers are within the span about the centre."""
    options = MadhowRingOptions(
        nlos_receivers=4, bearing_std_deg=0.1, nlos_span_deg=90.0, radius_m=20.0, sources="disc"
    )
    columns = madhow_ring.generate(options, np.random.default_rng(3), 200)
    true = np.arctan2(columns["truth_y_m"] - columns["sensor_y_m"], columns["truth_x_m"] - columns["sensor_x_m"])
    inward = np.arctan2(-columns["sensor_y_m"], -columns["sensor_x_m"])

    def off(angle: np.ndarray) -> np.ndarray:
        return np.degrees(np.abs((columns["bearing_rad"] - angle + np.pi) % (2.0 * np.pi) - np.pi))

    direct = columns["truth_los"]
    assert off(true)[direct].max() < 0.6
    assert off(inward)[~direct].max() <= 45.0
    assert off(inward)[~direct].max() > 40.0


def test_walls_of_figure_10() -> None:
    """A: R1 and R2 direct, R3 direct and reflected, R4 reflected only; B: none at R4; C: all direct; D as A."""
    world = madhow_walls.scene(MadhowWallsOptions())
    walls = [wall for wall in world.reflectors if isinstance(wall, SegmentReflector)]

    def seen(place: tuple[float, float]) -> list[list[str | None]]:
        return [[path.wall for path in trace_paths(place, sensor.position, walls)] for sensor in world.sensors]

    places = madhow_walls._SOURCES["10"]
    like_a = [[None], [None], [None, "reflecting"], ["reflecting"]]
    assert seen(places["A"]) == like_a
    assert seen(places["B"]) == [[None], [None], [None], []]
    assert seen(places["C"]) == [[None]] * 4
    assert seen(places["D"]) == like_a


def test_narrowband_bearings_are_between_their_paths() -> None:
    """The superposition of two paths has a bearing between them, nearer to the stronger."""
    options = {"figure": "11", "bearing_std_deg": 1e-6}
    wide, narrow = (
        madhow_walls.generate(MadhowWallsOptions(band=band, **options), np.random.default_rng(1), 1)  # type: ignore[arg-type]
        for band in ("wide", "narrow")
    )
    for k in range(4):
        direct, reflected = wide["bearing_rad"][2 * k : 2 * k + 2]
        assert wide["truth_los"][2 * k : 2 * k + 2].tolist() == [True, False]
        assert min(direct, reflected) < narrow["bearing_rad"][k] < max(direct, reflected)
        assert abs(narrow["bearing_rad"][k] - direct) < abs(narrow["bearing_rad"][k] - reflected)
        assert not narrow["truth_los"][k]


def test_contradicting_options_are_refused() -> None:
    """More blocked receivers than exist, or a source that a figure lacks, is a usage error."""
    with pytest.raises(UsageError, match="nlos_receivers"):
        MadhowRingOptions(sensors=4, nlos_receivers=5)
    with pytest.raises(UsageError, match="source"):
        MadhowWallsOptions(figure="11", source="B")
