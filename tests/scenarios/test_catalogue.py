"""The list of scenarios and rules for every scenario."""

from __future__ import annotations

import re
import subprocess
import sys

import numpy as np
import pytest

from nlosctl.contract.options import describe_options
from nlosctl.contract.tables import KINDS
from nlosctl.errors import UsageError
from nlosctl.scenarios.catalogue import find_scenario, scenarios

NAMES = list(scenarios())


def generate(name, snapshots=300, seed=4, **options):
    """Return spec, options and columns of one call."""
    spec = scenarios()[name]
    chosen = spec.options(**options)
    return spec, chosen, spec.generate(chosen, np.random.default_rng(seed), snapshots)


@pytest.mark.process
def test_listing_imports_no_numpy():
    """Listing the names does not import numpy."""
    code = (
        "import sys; from nlosctl.scenarios.catalogue import scenarios; print(*scenarios());"
        "assert 'song-flat' in scenarios(); assert 'numpy' not in sys.modules"
    )
    done = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    assert {"random", "ring", "song-flat"} <= set(done.stdout.split())


def test_unknown_scenarios_suggest_the_nearest():
    """A misspelt name is a usage error that suggests the nearest."""
    with pytest.raises(UsageError, match=re.escape("no scenario 'song-flap' (did you mean 'song-flat'?)")):
        find_scenario("song-flap")


@pytest.mark.parametrize("name", NAMES)
def test_names_and_kinds_agree_with_the_specification(name):
    """The name in the list is that of the specification, and its kind exists."""
    spec = find_scenario(name)
    assert spec.name == name
    assert spec.kind in KINDS
    assert all(entry["meaning"] for entry in describe_options(spec.options))


@pytest.mark.parametrize("name", NAMES)
def test_columns_are_valid_measurements(name):
    """All required columns and none unknown but the stated further ones, of equal length, finite and within bounds."""
    spec, options, columns = generate(name)
    table = KINDS[spec.kind]
    names = [column.name for column in table.all_columns]
    standard = [column for column in columns if column not in spec.further]
    assert {column.name for column in table.required} <= set(standard) <= set(names)
    assert [column for column in names if column in standard] == standard
    assert len({len(values) for values in columns.values()}) == 1
    for values in columns.values():
        if values.dtype == np.float64:
            assert np.isfinite(values).all()
    np.testing.assert_array_equal(np.unique(columns["snapshot"]), np.arange(300))
    assert (np.diff(columns["snapshot"]) >= 0).all()
    if "reflector" in columns:
        assert set(columns["reflector"]) - {None} <= set(spec.scene(options).reflector_names)


@pytest.mark.parametrize("name", NAMES)
def test_row_keys_are_unique(name):
    """Within a snapshot the key of the rows is unique, for kinds that have one, if rows are of one source."""
    spec, _, columns = generate(name)
    if not KINDS[spec.kind].row_key or "truth_target" in columns:
        return
    key = ["snapshot", *(column for column in KINDS[spec.kind].row_key if column in columns)]
    rows = list(zip(*(columns[column] for column in key), strict=True))
    assert len(set(rows)) == len(rows)


@pytest.mark.parametrize("name", NAMES)
def test_sensor_positions_agree_with_the_scene(name):
    """Rows of a sensor in the scene have its position."""
    spec, options, columns = generate(name)
    if "sensor" not in columns:
        return
    at = {sensor.name: sensor.position for sensor in spec.scene(options).sensors}
    known = [place for place, sensor in enumerate(columns.get("sensor", ())) if sensor in at]
    assert bool(known) == bool(at)
    if not at:
        return
    expected = np.array([at[columns["sensor"][place]] for place in known]).reshape(-1, 2)
    np.testing.assert_array_equal(columns["sensor_x_m"][known], expected[:, 0])
    np.testing.assert_array_equal(columns["sensor_y_m"][known], expected[:, 1])
