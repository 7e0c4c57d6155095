"""Files of calibrations: round trips, what may be left out, and one line for each fault."""

from __future__ import annotations

import numpy as np
import pytest

from nlosctl.contract.calibration import Calibration, SensorOffset
from nlosctl.errors import DataError
from nlosctl.io.calibrations.calibration_file import calibration_from_toml, calibration_to_toml

GOOD = """
[[sensor]]
name = "A1"
range_offset_m = 0.2
range_offset_std_m = 0.05
std_scale = 1.5

[[sensor]]
name = "A2"
range_offset_m = -0.1
range_offset_std_m = 0.04

[covariance]
order = ["A1", "A2"]
matrix = [[0.0025, 0.001], [0.001, 0.0016]]
"""


def test_a_calibration_reads_back_to_the_same_numbers() -> None:
    """Names with any characters, groups, missing stds and the covariance survive to the last bit."""
    rng = np.random.default_rng(1)
    root = rng.normal(size=(3, 3))
    entries = (
        SensorOffset(name='a "quoted" ä', group=("1", "x y"), offset=1 / 3, std=0.1, std_scale=1 / 7, std_dof=11.7),
        SensorOffset(name="b", group=("1", ""), offset=-2e-9, std=0.2, std_scale=2.0),
        SensorOffset(name="c", group=("2", "x y"), offset=0.0, std=None, std_scale=1.0),
        SensorOffset(name="b", group=("2", "x y"), offset=5.0, std=0.3, std_scale=1.0),
    )
    whole = Calibration(kind="bearings", entries=entries, by=("day", "site"), order=(0, 1, 3), covariance=root @ root.T)
    text = calibration_to_toml(whole, {"method": "ml", "snapshots": 3, "prior_std": None})
    back = calibration_from_toml(text, "file")
    assert (back.kind, back.entries, back.by, back.order) == (whole.kind, entries, whole.by, whole.order)
    np.testing.assert_array_equal(back.covariance, 0.5 * (root @ root.T + (root @ root.T).T))
    assert calibration_to_toml(back, {"method": "ml", "snapshots": 3}) == text


def test_what_may_be_left_out() -> None:
    """Without a covariance the stds are independent; std_scale is 1; an offset without std has no variance."""
    calibration = calibration_from_toml(
        '[[sensor]]\nname = "a"\nheading_offset_deg = 2\nheading_std_deg = 0.5\n'
        "[[sensor]]\nname = 7\nheading_offset_deg = -1.0\n",
        "file",
    )
    assert calibration.kind == "bearings"
    assert [(entry.name, entry.std, entry.std_scale) for entry in calibration.entries] == [
        ("a", 0.5, 1.0),
        ("7", None, 1.0),
    ]
    assert calibration.order == (0,)
    assert calibration.covariance.tolist() == [[0.25]]
    np.testing.assert_allclose(calibration.correlated(), [[np.radians(0.5) ** 2, 0.0], [0.0, 0.0]])


def test_a_factor_that_was_estimated_grows_by_its_own_error() -> None:
    """With d degrees of freedom it is sqrt(d / (d - 2)) times as large: then the mean of variance ratios is 1."""
    rng = np.random.default_rng(2)
    for dof in (6.0, 12.0, 100.0):
        estimated = np.sqrt(rng.chisquare(dof, 200_000) / dof)
        used = [SensorOffset(name="a", std_scale=value, std_dof=dof).std_factor for value in estimated[:2].tolist()]
        factor = used[0] / estimated[0]
        assert used[1] == pytest.approx(factor * estimated[1])
        assert np.mean((factor * estimated) ** -2.0) == pytest.approx(1.0, abs=0.02)
    assert SensorOffset(name="a", std_scale=1.5).std_factor == 1.5
    assert SensorOffset(name="a", std_scale=1.0, std_dof=1.0).std_factor == pytest.approx(3.0**0.5)


FAULTS = [
    ('name = "A2"', 'name = "A1"', "sensor[1]: 'A1' is sensor[0] already"),
    ("range_offset_m = 0.2", "range_offset_m = nan", "sensor[0].range_offset_m: got nan, expected a finite number"),
    ("range_offset_m = 0.2", "range_ofset_m = 0.2", "sensor[0]: got no offset, expected one of heading_offset_deg"),
    ("range_offset_m = 0.2", 'range_offset_m = "x"', "sensor[0].range_offset_m: got 'x', expected a finite number"),
    (
        "range_offset_m = -0.1",
        "heading_offset_deg = 1",
        "sensor[1]: has heading_offset_deg, and sensor[0] range_offset_m",
    ),
    (
        "range_offset_m = -0.1",
        "range_offset_m = 1\narrival_offset_m = 1",
        "sensor[1]: got range_offset_m and arrival_offset_m",
    ),
    (
        "std_m = 0.05",
        "std_m = -0.05",
        "sensor[0].range_offset_std_m: got -0.05, expected a finite number of at least 0",
    ),
    ("std_scale = 1.5", "std_scale = 0", "sensor[0].std_scale: got 0, expected a number larger than 0"),
    ("std_scale = 1.5", "std_scale = inf", "sensor[0].std_scale: got inf, expected a finite number of at least 0"),
    ("std_scale = 1.5", "std_dof = -1", "sensor[0].std_dof: got -1, expected a finite number of at least 0"),
    ("std_scale = 1.5", 'session = "a"', "sensor[1].session: missing, unlike in sensor[0]"),
    ('name = "A1"\n', "", "sensor[0].name: missing, expected text"),
    ('"A2"]', '"A3"]', "covariance.order[1]: 'A3' has no entry [[sensor]]"),
    ('"A2"]', '"A1"]', "covariance.order[1]: 'A1' is named twice"),
    ("[0.001, 0.0016]", "[0.002, 0.0016]", "covariance.matrix[0][1]: got 0.001, but 0.002 in [1][0]: not symmetric"),
    (", [0.001, 0.0016]", "", "covariance.matrix: got 1 rows, expected 2, one for each of order"),
    ("[0.001, 0.0016]", "[0.001]", "covariance.matrix[1]: got 1 numbers, expected 2"),
    ("[0.001, 0.0016]", "[0.001, nan]", "covariance.matrix[1][1]: got nan, expected a finite number"),
    ("[0.001, 0.0016]", "[0.001, -1]", "covariance.matrix[1][1]: got -1, expected a variance of at least 0"),
    ("0.001]", "0.9]", "not symmetric"),
    (
        "[0.0025, 0.001], [0.001,",
        "[0.0025, 0.1], [0.1,",
        "covariance.matrix[0][1]: got 0.1, larger than the variances allow",
    ),
    ("matrix =", "matrx =", "covariance: got ['matrx', 'order'], expected order and matrix"),
    (
        "[covariance]",
        "[covarianc]",
        "unknown key 'covarianc' (did you mean 'covariance'?); a calibration has [[sensor]]",
    ),
    ("[[sensor]]", "[[sensors]]", "unknown key 'sensors'"),
]


@pytest.mark.parametrize(("old", "new", "message"), FAULTS, ids=[message[:45] for _, _, message in FAULTS])
def test_a_fault_is_named_with_its_entry(old: str, new: str, message: str) -> None:
    """Each fault of a file is one line with the file, the key, what was found and what was expected."""
    text = GOOD.replace(old, new)
    assert text != GOOD
    with pytest.raises(DataError) as raised:
        calibration_from_toml(text, "cal.toml")
    assert str(raised.value).startswith("cal.toml: ")
    assert message in str(raised.value)
    assert "\n" not in str(raised.value)


def test_a_matrix_with_a_negative_eigenvalue_is_no_covariance() -> None:
    """Three offsets whose correlations contradict each other are refused."""
    text = "".join(f'[[sensor]]\nname = "{name}"\nrange_offset_m = 0\n' for name in "abc")
    text += '[covariance]\norder = ["a", "b", "c"]\nmatrix = [[1, 0.9, -0.9], [0.9, 1, 0.9], [-0.9, 0.9, 1]]\n'
    with pytest.raises(DataError, match=r"covariance\.matrix: has negative eigenvalues: not a covariance"):
        calibration_from_toml(text, "f")


def test_an_empty_calibration_is_an_error() -> None:
    """A file without entries names what a calibration needs."""
    for text in ("", "sensor = 3", "[covariance]\norder = []\nmatrix = []"):
        with pytest.raises(DataError, match=r"f: sensor: expected tables headed \[\[sensor\]\]"):
            calibration_from_toml(text, "f")


def test_entries_of_a_sensor_differ_in_their_group() -> None:
    """One sensor in two sessions has two entries; two of the same session are an error that names both."""
    entry = '[[sensor]]\nname = "A1"\nsession = "{}"\nrange_offset_m = 0.1\n'
    assert len(calibration_from_toml(entry.format("a") + entry.format("b"), "f").entries) == 2
    with pytest.raises(
        DataError, match=r"f: sensor\[1\]: 'A1' \(a\) is sensor\[0\] already; give each sensor one entry"
    ):
        calibration_from_toml(entry.format("a") * 2, "f")
