"""``nlosctl detect-ip``, triplets in ``localize`` and ``evaluate``, and the functions."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet as pq
import pytest

import nlosctl
from nlosctl.cli.main import run

pytestmark = pytest.mark.extensive

METHODS = ("tdaj", "chi2", "joint")
FIXTURES = Path(__file__).parents[2] / "fixtures"
GOOD = str(FIXTURES / "good_triplets.csv")


def flags_of(*words, target):
    """Run detect-ip on the good file and return its flags."""
    assert run(["detect-ip", GOOD, "-q", "-o", str(target), "--overwrite", *words]) == 0
    return pq.read_table(target)


def test_flags_are_the_input_plus_decisions(tmp_path):
    """A row per path in input order, with the input's columns, then used, ip, p_value, reason."""
    flags = flags_of(target=tmp_path / "flags.parquet")
    given = pyarrow.csv.read_csv(GOOD)
    assert flags.column_names == [*given.column_names, "used", "ip", "p_value", "reason"]
    assert flags.select(["snapshot", "path"]) == given.select(["snapshot", "path"])
    ip, truth = flags["ip"].to_numpy(), flags["truth_ip"].to_numpy()
    assert ip[truth].mean() > 0.8
    assert ip[~truth].mean() < 0.12
    np.testing.assert_array_equal(ip, flags["p_value"].to_numpy() < 0.05)
    words = {word for reason in flags["reason"].to_pylist() for word in reason.split(",")}
    assert {"", "inconsistent"} <= words <= {"", "inconsistent", "rays_miss", "no_ellipse"}


def test_details_and_safe_region_add_columns(tmp_path):
    """--details adds points, differences and thresholds; eta_m adds outside_safe_region."""
    plain = flags_of("-m", "tdaj", target=tmp_path / "flags.parquet")
    assert "blind" in plain.column_names
    assert not {"lambda1_m", "threshold6_m", "outside_safe_region"} & set(plain.column_names)
    detailed = flags_of("-m", "tdaj", "--details", "-p", "eta_m=0.5", target=tmp_path / "flags.parquet")
    new = set(detailed.column_names) - set(plain.column_names)
    assert len(new) == 6 + 12 + 1
    beyond = np.abs(detailed["lambda5_m"].to_numpy()) > detailed["threshold5_m"].to_numpy()
    np.testing.assert_array_equal(detailed["outside_safe_region"].to_numpy(), beyond)
    no_ellipse = np.array(detailed["reason"].to_pylist()) == "no_ellipse"
    np.testing.assert_array_equal(detailed["threshold5_m"].to_numpy() > 0.5, ~no_ellipse)


def test_every_method_has_details(tmp_path):
    """Points, differences and thresholds are the same for each method."""
    tables = [flags_of("-m", method, "--details", target=tmp_path / "flags.parquet") for method in METHODS]
    names = [name for name in tables[0].column_names if name.startswith(("lambda", "threshold", "dod_", "doa_"))]
    assert len(names) == 18 + 4
    for table in tables[1:]:
        assert table.select(names).equals(tables[0].select(names))


def test_block_size_and_jobs_change_no_byte(tmp_path):
    """The same bytes for any jobs and block size, for each method."""
    for method in METHODS:
        files = [tmp_path / f"{n}.parquet" for n in range(2)]
        flags_of("-m", method, "--jobs", "1", target=files[0])
        flags_of("-m", method, "--jobs", "2", "--block-size", "7", target=files[1])
        assert files[0].read_bytes() == files[1].read_bytes()


def test_units_of_columns(tmp_path):
    """Degrees, a time of arrival and constant stds are read as the radians and metres they are."""
    source = str(FIXTURES / "good_triplets_toa.csv")
    target = tmp_path / "flags.parquet"
    degrees = repr(float(np.degrees(0.01)))
    constants = ["--dod-std-deg", degrees, "--doa-std-deg", degrees, "--path-length-std-m", "0.05"]
    assert run(["detect-ip", source, "-q", "-o", str(target), *constants]) == 0
    p_value = pq.read_table(target)["p_value"].to_numpy()
    expected = flags_of(target=tmp_path / "expected.parquet")["p_value"].to_numpy()
    np.testing.assert_allclose(p_value, expected, rtol=1e-6, atol=1e-12)


def test_detect_localize_evaluate(tmp_path, capsys):
    """Flagged paths are excluded, and the error decreases."""
    flags, fixes, report = tmp_path / "flags.csv", tmp_path / "fixes.csv", tmp_path / "report.json"
    rmse = {}
    for words in ([], ["--all-rows"]):
        assert run(["detect-ip", GOOD, "-m", "joint", "-q", "-o", str(flags), "--overwrite"]) == 0
        joint = ["localize", str(flags), "-p", "joint=true", "-o", str(fixes), "--overwrite", *words]
        assert run([*joint, "--report", str(report)]) == 0
        assert run(["evaluate", str(fixes), "--json"]) == 0
        rmse[bool(words)] = json.loads(capsys.readouterr().out)["overall"]["rmse_m"]
        left_out = json.loads(report.read_text())["rows_left_out"]
        assert (left_out == 0) == bool(words)
    assert rmse[False] < 0.1 * rmse[True]


def test_path_by_path_estimates_carry_the_path(tmp_path):
    """Estimates of single paths have the path's number and truth, in input order."""
    target, other = tmp_path / "fixes.parquet", tmp_path / "own.parquet"
    assert run(["localize", GOOD, "-q", "-o", str(target)]) == 0
    given, fixes = pyarrow.csv.read_csv(GOOD), pq.read_table(target)
    assert fixes["path"].to_pylist() == given["path"].to_pylist()
    assert fixes["truth_x_m"].to_pylist() == given["truth_x_m"].to_pylist()
    flags_of("-m", "chi2", "--estimates-out", str(other), target=tmp_path / "flags.parquet")
    same = [name for name in fixes.column_names if name != "method"]
    assert pq.read_table(other).select(same) == fixes.select(same)
    assert run(["localize", GOOD, "-q", "-p", "joint=true", "-o", str(target), "--overwrite"]) == 0
    joint = pq.read_table(target)
    assert joint["path"].null_count == joint.num_rows == len(set(given["snapshot"].to_pylist()))


def test_evaluate_scores_the_methods(tmp_path, capsys):
    """evaluate reports P_fa, P_d, AUC and calibration per method; AUC is larger for joint."""
    flags = tmp_path / "flags.parquet"
    assert run(["detect-ip", GOOD, "-m", "chi2", "-m", "joint", "-q", "-o", str(flags)]) == 0
    assert run(["evaluate", str(flags), "--json"]) == 0
    groups = {group["method"]: group for group in json.loads(capsys.readouterr().out)["groups"]}
    assert groups["joint"]["auc"] > groups["chi2"]["auc"] > 0.85
    assert groups["chi2"]["rows"] == groups["joint"]["rows"] == 540
    assert groups["chi2"]["ks_p_value"] > 0.01
    assert run(["evaluate", str(flags), "--fail-if", "p_d<0.999"]) == 4


@pytest.mark.parametrize(
    ("words", "code", "message"),
    [
        (["-p", "noise=laplace"], 2, "tdaj"),
        (["-m", "tdaj", "-p", "noise=student-t:1"], 2, "student-t:NU"),
        (["-m", "tdaj", "--estimates-out", "e.csv"], 2, "no estimates"),
        (["-m", "ml"], 2, "localize"),
        (["-p", "false_alarm=0"], 2, "(0, 1)"),
        (["-m", "tdaj", "-p", "k=6"], 2, "[0, 5]"),
    ],
)
def test_usage_errors(words, code, message, capsys, tmp_path):
    """An invalid parameter or option exits 2 with one line."""
    assert run(["detect-ip", GOOD, "-o", str(tmp_path / "f.csv"), *words]) == code
    err = capsys.readouterr().err
    assert message in err
    assert err.count("\n") == 1


@pytest.mark.parametrize(
    ("fault", "message"),
    [
        ("degrees_as_radians", "dod_deg"),
        ("negative_length", "'path_length_m': got -3"),
        ("zero_std", "'doa_std_rad': got 0"),
        ("duplicate_path", "duplicate"),
        ("missing_doa", "'doa_rad'"),
    ],
)
def test_bad_files(fault, message, capsys, tmp_path):
    """A bad file is an error with column and value."""
    assert run(["detect-ip", str(FIXTURES / f"bad_triplets_{fault}.csv"), "-o", str(tmp_path / "f.csv")]) == 1
    assert message in capsys.readouterr().err


def test_bad_rows_are_set_aside(tmp_path):
    """With --bad-rows the other rows are judged as without the bad one."""
    target, bad = tmp_path / "flags.csv", tmp_path / "bad.csv"
    words = ["detect-ip", str(FIXTURES / "bad_triplets_zero_std.csv"), "-q", "-o", str(target), "--bad-rows", str(bad)]
    assert run(words) == 0
    whole = flags_of(target=tmp_path / "whole.parquet").slice(0, 18)
    kept = pyarrow.csv.read_csv(target)
    assert kept.num_rows == 17
    assert pyarrow.csv.read_csv(bad).num_rows == 1
    expected = [p for n, p in enumerate(whole["p_value"].to_pylist()) if n != 7]
    assert kept["p_value"].to_pylist() == expected


def test_the_summary_counts(capsys, tmp_path):
    """Standard error counts direct and indirect paths; --report has them as JSON."""
    report = tmp_path / "report.json"
    assert run(["detect-ip", GOOD, "-m", "tdaj", "-o", str(tmp_path / "f.csv"), "--report", str(report)]) == 0
    verdicts = json.loads(report.read_text())["methods"]["tdaj"]["verdicts"]
    assert sum(verdicts.values()) == 540
    assert f"{verdicts['indirect']} indirect" in capsys.readouterr().err


def test_the_function_equals_the_command(tmp_path):
    """nlosctl.detect_ip gives the flags of the command line to the bit."""
    table = pyarrow.csv.read_csv(GOOD)
    result = nlosctl.detect_ip(table, method="joint", false_alarm=0.01)
    flags_of("-m", "joint", "-p", "false_alarm=0.01", target=tmp_path / "flags.parquet")
    assert result.flags.to_pylist() == pq.read_table(tmp_path / "flags.parquet").to_pylist()
    assert result.estimates.num_rows == 60
    assert nlosctl.detect_ip(table, method="tdaj").estimates is None
    simulated = nlosctl.simulate("shen", trials=50, number=2)
    assert isinstance(simulated, pa.Table)
    assert nlosctl.detect_ip(simulated, details=True, method="tdaj").flags.num_rows == 50


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        (["-m", "tdaj"], "guaranteed (to a fifth, down to 0.001) where 'blind' is false"),
        (["-m", "tdaj", "-p", "rule=fusion"], "guaranteed at no level with rule=fusion"),
        (["-m", "joint"], "guaranteed (to a fifth) down to 0.01"),
    ],
)
def test_the_summary_states_which_false_alarm_probability_is_guaranteed(tmp_path, capsys, options, expected):
    """``tdaj`` states for which rows its level holds, ``joint`` to which level; ``chi2`` is calibrated."""
    assert run(["detect-ip", GOOD, *options, "-o", str(tmp_path / "f.csv")]) == 0
    assert expected in capsys.readouterr().err
    assert run(["detect-ip", GOOD, "-m", "chi2", "-o", str(tmp_path / "chi2.csv")]) == 0
    assert "guaranteed" not in capsys.readouterr().err
