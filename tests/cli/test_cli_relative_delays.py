"""Triplets whose delays are relative to the first path, as channel sounders export them."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from conftest import Cli

BASELINE_M = 20.0
NS_PER_M = 1e9 / 299_792_458.0
TARGET = (8.0, 6.0)
STDS = ("--dod-std-deg", "1", "--doa-std-deg", "1", "--toa-std-ns", "0.5")


def write(path: Path, added_ns: float) -> None:
    """Write the direct path and the path over `TARGET`; delays are relative to the direct path, plus ``added_ns``."""
    x, y = TARGET
    excess_m = math.hypot(x, y) + math.hypot(x - BASELINE_M, y) - BASELINE_M
    paths = [
        (0.0, 180.0, 0.0),
        (math.degrees(math.atan2(y, x)), math.degrees(math.atan2(y, x - BASELINE_M)), excess_m * NS_PER_M),
    ]
    rows = [
        f"1,{number},0,0,{BASELINE_M},0,{dod!r},{doa!r},{delay_ns + added_ns!r}"
        for number, (dod, doa, delay_ns) in enumerate(paths)
    ]
    path.write_text("\n".join(["snapshot,path,tx_x_m,tx_y_m,rx_x_m,rx_y_m,dod_deg,doa_deg,toa_ns", *rows]) + "\n")


@pytest.mark.parametrize("words", [("detect-ip", "-m", "chi2"), ("localize", "-m", "ml"), ("validate",)])
def test_a_delay_of_zero_is_refused_with_the_cure(cli: Cli, tmp_path: Path, words: tuple[str, ...]) -> None:
    """The message names row, column, and what to add to the delays."""
    write(tmp_path / "relative.csv", 0.0)
    done = cli(*words, "relative.csv", *STDS)
    assert done.code == 1
    (line,) = done.err.splitlines()
    assert "relative.csv, row 1 (line 2), column 'toa_ns': got 0, expected a number larger than 0" in line
    assert "if delays are relative to the first path, add its delay to all" in line
    assert "where that is the direct path: the distance from transmitter to receiver over the speed of light" in line


def test_the_cure_leads_to_the_target(cli: Cli, tmp_path: Path) -> None:
    """With the delay of the direct path added to all, the path over the target ends there."""
    write(tmp_path / "whole.csv", BASELINE_M * NS_PER_M)
    done = cli("localize", "-m", "ml", "whole.csv", *STDS)
    assert done.code == 0, done.err
    fixes = [row for row in done.table.to_pylist() if row["status"] == "ok"]
    assert [(row["path"], row["x_m"], row["y_m"]) for row in fixes] == [
        (1, pytest.approx(TARGET[0], abs=1e-6), pytest.approx(TARGET[1], abs=1e-6))
    ]
