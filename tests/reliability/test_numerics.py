"""Any geometry at any size and position: correct status, calibrated or null covariance, no dependence on the frame."""

from __future__ import annotations

import dataclasses
import warnings
from typing import Any

import numpy as np
import pytest
from geometries import drawn, moved, nearly, scaled, scaled_options
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from method_options import BUILT_IN, options_of

from nlosctl import registry
from nlosctl.contract.batches import BearingBatch
from nlosctl.contract.result_checks import contract_violation
from nlosctl.contract.statuses import Status
from nlosctl.testing.draws import DRAWS, bearing_batch
from nlosctl.testing.moves import copy_batch

pytestmark = pytest.mark.extensive

METHODS = pytest.mark.parametrize("entry", BUILT_IN, ids=lambda entry: entry.full_name)
SPANS = st.floats(-3.0, 7.0)
OFFSETS = st.one_of(st.just(-np.inf), st.floats(0.0, 8.0))
SEEDS = st.integers(0, 2**32 - 1)


def solved(entry: registry.MethodEntry, batch: Any, *, factor: float = 1.0, **changes: Any) -> Any:
    """Run a method on a batch; any warning is a failure."""
    spec = registry.load(entry)
    options = dataclasses.replace(scaled_options(options_of(entry), factor), **changes)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return spec.solve(copy_batch(batch, writeable=False), options)


def assert_keeps_the_contract(
    entry: registry.MethodEntry,
    seed: int,
    span: float,
    offset: float,
    measurements: int,
    fault: str | None,
    near: float,
) -> None:
    """Draw, make nearly degenerate, move, solve, and check the solution against the contract."""
    spec = registry.load(entry)
    draw: dict[str, Any] = {"size_m": 10.0**span, "offset_m": 10.0**offset}
    trial, motion = drawn(spec, seed=seed, snapshots=4, measurements=measurements, fault=fault, **draw)
    batch = trial.batch
    if fault is not None:
        ordinary, _ = drawn(spec, seed=seed + 1, snapshots=4, measurements=measurements, fault=None, **draw)
        batch = nearly(batch, ordinary.batch, 10.0**near)
    batch = moved(spec, batch, motion)
    solution = solved(entry, batch)
    assert contract_violation(solution, (4, measurements)) == ""


def assert_any_geometry_keeps_the_contract(entry: registry.MethodEntry, examples: int) -> None:
    """Try a method on random geometry of any kind."""
    spec = registry.load(entry)
    faults = st.sampled_from([None, *DRAWS[spec.kind, spec.job].faults])
    counts = st.one_of(st.integers(max(2, spec.minimum_measurements), 12), st.sampled_from([30, 100]))
    nearness = st.one_of(st.just(-np.inf), st.floats(-16.0, -1.0))

    @settings(
        max_examples=examples, deadline=None, derandomize=True, database=None, suppress_health_check=list(HealthCheck)
    )
    @given(seed=SEEDS, span=SPANS, offset=OFFSETS, measurements=counts, fault=faults, near=nearness)
    def hold(seed: int, span: float, offset: float, measurements: int, fault: str | None, near: float) -> None:
        assert_keeps_the_contract(entry, seed, span, offset, measurements, fault, near)

    hold()


@METHODS
def test_any_geometry_keeps_the_contract(entry: registry.MethodEntry) -> None:
    """1 mm to 10,000 km, up to 1e8 m away, 2 to 100 rows, nearly degenerate: values agree with the status."""
    assert_any_geometry_keeps_the_contract(entry, 12)


@pytest.mark.slow
@METHODS
def test_a_thousand_geometries_keep_the_contract(entry: registry.MethodEntry) -> None:
    """The same for a thousand draws of each method."""
    assert_any_geometry_keeps_the_contract(entry, 1000)


def test_echoes_of_nearly_coincident_sensors() -> None:
    """A hundred echoes of sensors 1e-16 of their spread apart, which gave zero times infinity."""
    entry = next(entry for entry in BUILT_IN if entry.full_name == "ranges.assignment")
    assert_keeps_the_contract(entry, 121947022, 0.0, 0.0, 100, "one point", -16.0)


def assert_keeps_its_frame(
    entry: registry.MethodEntry, seed: int, span: float, offset: float, measurements: int
) -> None:
    """Solve a scene of 1 m, and the same scaled, rotated and moved, and compare the estimates."""
    spec = registry.load(entry)
    size_m, offset_m = 10.0**span, min(10.0 ** (span + offset), 1e8)
    trial, motion = drawn(
        spec, seed=seed, snapshots=4, measurements=measurements, fault=None, size_m=1.0, offset_m=offset_m
    )
    plain = solved(entry, trial.batch, factor=1.0 / 1000.0).estimates
    other = solved(entry, moved(spec, scaled(trial.batch, size_m), motion), factor=size_m / 1000.0).estimates
    assert plain.status.tolist() == other.status.tolist()
    expected = motion.points(plain.position_m * size_m)
    off = np.hypot(*(expected - other.position_m).T)
    std_m = size_m * np.sqrt(np.nan_to_num(plain.covariance_m2[:, 0] + plain.covariance_m2[:, 2]))
    allowed = 1e-9 * max(size_m, offset_m) + 1e-7 * std_m
    worst = int(np.nanargmax(np.append(off / allowed, 0.0)))
    assert worst == off.size or off[worst] <= allowed[worst], (off[worst], allowed[worst])


def assert_any_frame_is_kept(entry: registry.MethodEntry, examples: int) -> None:
    """Check that estimates of a method move, rotate and scale with the scene."""
    counts = st.integers(max(6, registry.load(entry).minimum_measurements + 2), 12)

    @settings(
        max_examples=examples, deadline=None, derandomize=True, database=None, suppress_health_check=list(HealthCheck)
    )
    @given(seed=SEEDS, span=SPANS, offset=st.floats(-1.0, 4.0), measurements=counts)
    def hold(seed: int, span: float, offset: float, measurements: int) -> None:
        assert_keeps_its_frame(entry, seed, span, offset, measurements)

    hold()


FRAMED = [entry for entry in BUILT_IN if "frame" not in registry.load(entry).exempt_from]


@pytest.mark.parametrize("entry", FRAMED, ids=lambda entry: entry.full_name)
def test_fixes_do_not_depend_on_frame_or_unit(entry: registry.MethodEntry) -> None:
    """Rotated, scaled and moved up to 1e8 m away, the fix is the same to 1e-9 of the scene or the offset.

    In addition the stopping rule of an iteration may leave 1e-7 of the standard deviation of the fix.
    """
    assert_any_frame_is_kept(entry, 8)


@pytest.mark.slow
@pytest.mark.parametrize("entry", FRAMED, ids=lambda entry: entry.full_name)
def test_many_frames_and_units(entry: registry.MethodEntry) -> None:
    """The same for 300 draws of each method."""
    assert_any_frame_is_kept(entry, 300)


def test_a_path_that_proposes_a_station_as_the_target() -> None:
    """The best fit of an indirect path is 1e-17 m from a station; the volume of its peak was 1/0 there."""
    assert_keeps_its_frame(next(entry for entry in BUILT_IN if entry.full_name == "triplets.joint"), 60760, 0.0, 0.0, 6)


def ring_of_bearings(generator: np.random.Generator, snapshots: int, size_m: float, offset_m: float) -> tuple[Any, Any]:
    """Return bearings of 8 sensors around sources, with errors of 0.3 degree, and the sources (B, 2)."""
    shape = (snapshots, 8)
    angle = generator.uniform(-np.pi, np.pi, shape)
    sensor_xy = size_m * np.stack([np.cos(angle), np.sin(angle)], axis=-1) + offset_m
    source_xy = size_m * generator.uniform(-0.5, 0.5, (snapshots, 1, 2)) + offset_m
    std = np.full(shape, np.radians(0.3))
    toward = source_xy - sensor_xy
    bearing = np.arctan2(toward[..., 1], toward[..., 0]) + std * generator.normal(size=shape)
    sensor = np.tile(np.arange(8), (snapshots, 1))
    from nlosctl.contract.scene import Scene

    batch: BearingBatch = bearing_batch(
        generator, Scene(), sensor, sensor_xy, bearing, std, np.full(shape, -1, dtype=np.int64)
    )
    return batch, source_xy[:, 0]


@pytest.mark.parametrize("size_m", [1e-3, 1.0, 1e4, 1e7])
@pytest.mark.parametrize("offset_m", [0.0, 1e6, 1e8])
@pytest.mark.parametrize("method", ["ls", "stansfield", "ml"])
def test_covariances_are_calibrated_at_any_size(method: str, size_m: float, offset_m: float) -> None:
    """The mean NEES is 2 at any size and position that float64 can resolve."""
    if offset_m > 1e10 * size_m:
        pytest.skip("float64 cannot resolve positions of such a scene so far from the origin")
    entry = next(entry for entry in BUILT_IN if entry.full_name == f"bearings.{method}")
    batch, source_xy = ring_of_bearings(np.random.default_rng(5), 2000, size_m, offset_m)
    estimates = solved(entry, batch).estimates
    assert (estimates.status == Status.OK).all()
    x, y = (estimates.position_m - source_xy).T
    xx, xy, yy = estimates.covariance_m2.T
    nees = (yy * x * x - 2.0 * xy * x * y + xx * y * y) / (xx * yy - xy * xy)
    assert abs(nees.mean() - 2.0) < 5.0 * 2.0 / np.sqrt(2000)
    assert nees.max() < 100.0


@pytest.mark.parametrize("size_m", [1e-3, 1.0, 1e7])
@pytest.mark.parametrize(
    ("fault", "words"),
    [("parallel", {"degenerate", "behind"}), ("one point", {"degenerate"}), ("behind", {"behind", "degenerate"})],
)
@pytest.mark.parametrize("method", ["ls", "stansfield", "ml"])
def test_degenerate_bearings_have_no_fix(method: str, fault: str, words: set[str], size_m: float) -> None:
    """Parallel lines, coincident sensors and crossings behind have their status at any size and position."""
    entry = next(entry for entry in BUILT_IN if entry.full_name == f"bearings.{method}")
    spec = registry.load(entry)
    for seed in range(20):
        trial, motion = drawn(
            spec, seed=seed, snapshots=10, measurements=6, fault=fault, size_m=size_m, offset_m=1e3 * size_m
        )
        found = {Status(int(word)).word for word in solved(entry, moved(spec, trial.batch, motion)).estimates.status}
        assert found <= words


def on_a_sensor(method: str, size_m: float, measurements: int = 6, **options: Any) -> Any:
    """Yield estimates of sources exactly on their first sensor, and those positions (B, 2)."""
    entry = next(entry for entry in BUILT_IN if entry.full_name == f"bearings.{method}")
    spec = registry.load(entry)
    for seed in range(20):
        trial, motion = drawn(
            spec,
            seed=seed,
            snapshots=10,
            measurements=measurements,
            fault="on a sensor",
            size_m=size_m,
            offset_m=1e3 * size_m,
        )
        batch = moved(spec, trial.batch, motion)
        yield solved(entry, batch, **options).estimates, batch.sensor_xy_m[:, 0]


NO_ANSWER = {"degenerate", "not_converged", "behind"}


@pytest.mark.parametrize("size_m", [1e-3, 1.0, 1e7])
@pytest.mark.parametrize(
    ("method", "words"),
    [("ls", {"degenerate"}), ("stansfield", {"degenerate"}), ("ml", NO_ANSWER), ("sequential", NO_ANSWER)],
)
def test_sources_on_a_sensor_have_no_fix(method: str, words: set[str], size_m: float) -> None:
    """A method that must use the bearing of a sensor at the source has no fix and no numbers."""
    for estimates, _ in on_a_sensor(method, size_m):
        assert {Status(int(word)).word for word in estimates.status} <= words
        assert np.isnan(estimates.position_m).all()
        assert np.isnan(estimates.covariance_m2).all()


@pytest.mark.parametrize("size_m", [1e-3, 1.0, 1e7])
@pytest.mark.parametrize("measurements", [2, 6, 12])
def test_ml_is_degenerate_on_a_sensor(measurements: int, size_m: float) -> None:
    """A likelihood that rises up to a sensor is degenerate, not not_converged."""
    words = [
        Status(int(word)).word for estimates, _ in on_a_sensor("ml", size_m, measurements) for word in estimates.status
    ]
    assert words.count("not_converged") <= 0.02 * len(words)
    assert words.count("degenerate") >= 0.95 * len(words)


@pytest.mark.parametrize("size_m", [1e-3, 1.0, 1e7])
@pytest.mark.parametrize(("method", "share"), [("mixture-ml", 0.9), ("suppress", 0.1)])
def test_robust_methods_reject_the_row_at_the_source(method: str, share: float, size_m: float) -> None:
    """If the row of the sensor at the source is rejected, the others give an exact fix, of however few rows."""
    answered = 0
    options = {"least_evidence": -1000.0} if method == "mixture-ml" else {}
    for estimates, source_xy in on_a_sensor(method, size_m, **options):
        ok = estimates.status == Status.OK
        answered += int(ok.sum())
        assert (np.hypot(*(estimates.position_m - source_xy)[ok].T) <= 1e-9 * 1e3 * size_m).all()
        assert (estimates.covariance_m2[ok][:, [0, 2]] > 0.0).all()
    assert answered >= share * 200
