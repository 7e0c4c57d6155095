"""The fixtures of space and of arrival times: good ones are solved, and each bad one has its message."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest
from cli_support import FIXTURES, Outcome

Cli = Callable[..., Outcome]

SPACE = ("--dimensions", "3")
SOUND = ("--speed-m-s", "sound")
REJECTED = {
    "space/bad_circle.csv": ["reflector 'ground' is a circle", "kind = 'sphere'"],
    "space/bad_zero_normal.csv": ["reflector[0].normal", "got [0, 0, 0]", "except zero"],
    "space/bad_outside_sphere.csv": ["row 5 (line 6)", "'sensor_x_m'", "6371012 m from the centre", "6371010 m"],
    "space/bad_under_blocker.csv": ["row 5 (line 6)", "'sensor_x_m'", "radius of its blocker, 6372000 m"],
    "space/bad_two_numbers_among_three.csv": ["sensor[2].position", "[380.0, 390.0]", "expected 3 numbers"],
    "space/bad_elevation_in_degrees.csv": ["'elevation_rad'", "7 of 12", "rename the column to elevation_deg"],
    "space/bad_elevation_beyond_zenith.csv": ["row 5 (line 6)", "'elevation_deg'", "got 95", "-90 to 90 deg"],
    "space/bad_elevation_without_std.csv": ["'elevation_std_rad'", "elevation_std_deg", "--elevation-std-deg"],
    "space/bad_std_without_elevation.csv": ["'elevation_std_deg' needs 'elevation_rad'"],
    "space/bad_elevation_std_zero.csv": ["row 5 (line 6)", "'elevation_std_deg'", "got 0", "larger than 0"],
    "space/bad_height_of_sensor_absent.csv": ["missing column 'sensor_z_m'", "scene with its sensors"],
    "space/bad_height_of_sensor_empty.csv": ["row 5 (line 6)", "'sensor_z_m'", "empty cell"],
    "space/bad_height_std_without_height.csv": ["'target_z_std_m' needs 'target_z_m'"],
    "space/bad_height_std_negative.csv": ["row 5 (line 6)", "'target_z_std_m'", "got -1", "at least 0"],
    "space/bad_heights_differ.csv": ["snapshot 0", "'target_z_m'", "got 1 beside 0", "one height"],
    "arrivals/bad_arrival_infinite.csv": ["row 5 (line 6)", "'arrival_s'", "got inf", "finite"],
    "arrivals/bad_arrival_text.csv": ["row 5 (line 6)", "'arrival_s'", "got 'late'", "a number"],
    "arrivals/bad_std_zero.csv": ["row 5 (line 6)", "'arrival_std_s'", "got 0", "larger than 0"],
    "arrivals/bad_std_negative.csv": ["row 5 (line 6)", "'arrival_std_s'", "got -0.0001", "larger than 0"],
    "arrivals/bad_std_missing.csv": ["missing column 'arrival_std_m'", "--arrival-std-m"],
    "arrivals/bad_two_units.csv": ["'arrival_s' and 'arrival_ms'", "the same quantity"],
    "arrivals/bad_duplicate.csv": ["row 5 (line 6)", "duplicate", "row 4"],
    "arrivals/bad_nanoseconds_as_floats.csv": ["row 1 (line 2)", "'arrival_ns'", "1.79600000", "integer"],
    "arrivals/bad_reference_missing.csv": ["'tdoa_s' needs 'reference'"],
    "arrivals/bad_reference_unknown.csv": ["snapshot 0", "'m1'", "reference_x_m", "scene"],
    "arrivals/bad_reference_not_zero.csv": ["row 1 (line 2)", "'tdoa_s'", "171.5 m", "expected 0"],
}
REPORTED = {
    "arrivals/bad_height_in_plane.csv": ["target_z_m, target_z_std_m are not used"],
    "arrivals/bad_std_larger_than_array.csv": ["2 degenerate", "no snapshot has a fix"],
}
GOOD = {
    "space/good_bearings.csv": [*SPACE, "-m", "ml", "-m", "mixture-ml"],
    "space/good_ranges.csv": [*SPACE, "-m", "ml", "-m", "mixture-ml"],
    "arrivals/good_sound.csv": [*SOUND, "-m", "ml", "-m", "srd-ls"],
    "arrivals/good_differences.csv": [*SOUND, "-m", "ml", "-m", "srd-ls"],
    "arrivals/good_aircraft.csv": [*SPACE, "-m", "ml", "-m", "srd-ls"],
}


def options(name: str) -> tuple[str, ...]:
    """Return the options with which a fixture is read."""
    return SPACE if name.startswith("space") else SOUND


def test_every_fixture_is_tested() -> None:
    """The tables above list all files of the two folders."""
    tables = [path for folder in ("space", "arrivals") for path in (FIXTURES / folder).glob("*.csv")]
    assert {f"{path.parent.name}/{path.name}" for path in tables} == {
        *REJECTED,
        *REPORTED,
        *GOOD,
        "space/good_triplets.csv",
    }


@pytest.mark.parametrize("command", ["localize", "validate"])
@pytest.mark.parametrize("name", REJECTED)
def test_a_bad_file_has_its_message(cli: Cli, tmp_path: Path, name: str, command: str) -> None:
    """Exit 1 with file, position, value and expectation, and no output file."""
    words = ["-m", "ml", "-o", "e.csv"] if command == "localize" else []
    outcome = cli(command, FIXTURES / name, *options(name), *words)
    assert outcome.code == 1
    assert name.partition(".")[0] in outcome.err
    assert [part for part in REJECTED[name] if part not in outcome.err] == []
    assert (outcome.out, list(tmp_path.iterdir())) == (b"", [])


@pytest.mark.parametrize("name", REPORTED)
def test_an_odd_file_is_reported(cli: Cli, name: str) -> None:
    """The file is solved, and a note names what is not used or not right."""
    outcome = cli("localize", "-m", "ml", FIXTURES / name, *options(name), "-o", "e.csv")
    assert outcome.code == 0
    assert [part for part in REPORTED[name] if part not in outcome.err] == []


@pytest.mark.parametrize("name", GOOD)
def test_a_good_file_is_solved(cli: Cli, name: str) -> None:
    """All snapshots are `ok`, and the mean NEES is within its 95 % interval."""
    outcome = cli("localize", FIXTURES / name, *GOOD[name], "-o", "e.csv")
    assert outcome.code == 0, outcome.err
    scores = scores_of(cli("evaluate", "e.csv", "--format", "jsonl"))
    assert len(scores) == GOOD[name].count("-m")
    for score in scores:
        assert score["fix_rate"] == 1.0
        assert score["nees_low"] <= score["nees"] <= score["nees_high"]


def test_good_triplets_are_judged(cli: Cli) -> None:
    """Every path by the floor is flagged, and at most two of the 31 direct ones at 5 %."""
    words = ["-m", "chi2", "-m", "joint", *SPACE]
    outcome = cli("detect-ip", FIXTURES / "space" / "good_triplets.csv", *words, "-o", "f.csv")
    assert outcome.code == 0, outcome.err
    for score in scores_of(cli("evaluate", "f.csv", "--format", "jsonl")):
        assert score["p_d"] == 1.0
        assert score["direct_called_indirect"] <= 2


def scores_of(outcome: Outcome) -> list[dict[str, float]]:
    """Return the rows of `evaluate`, without those over all methods."""
    return [score for line in outcome.out.splitlines() if (score := json.loads(line))["method"] != "overall"]
