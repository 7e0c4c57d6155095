"""Epochs of periodic logs: ``--window auto``, and the note where a window cuts them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from program import run_here

import nlosctl
from nlosctl.contract.epochs import epoch_numbers

JITTERED = """time,anchor,range
10.0000,A1,5.00
10.0030,A2,6.71
10.0060,A3,7.81
10.0990,A1,5.20
10.1030,A2,6.60
10.1060,A3,7.60
10.1990,A1,5.40
10.2030,A2,6.50
10.2060,A3,7.40
"""


@pytest.mark.parametrize("missing", [0.0, 0.1, 0.3])
def test_jittered_epochs_are_found(missing: float) -> None:
    """1200 epochs of 6 anchors at 10 Hz with 1 ms of jitter: every epoch is found, also if rows are missing."""
    generator = np.random.default_rng(4)
    rows = [
        (0.1 * epoch + 0.003 * anchor + generator.normal(0.0, 0.001), anchor, epoch)
        for epoch in range(1200)
        for anchor in range(6)
        if generator.random() >= missing
    ]
    rows.sort()
    numbers = epoch_numbers([row[0] for row in rows], [row[1] for row in rows])
    true = np.unique([row[2] for row in rows], return_inverse=True)[1]
    assert numbers == true.tolist()


def test_stations_that_report_evenly_in_turn() -> None:
    """Three stations at 1 Hz, offsets .31 and .68 s: each epoch has each station once."""
    rows = sorted(
        (second + offset, name) for second in range(120) for name, offset in (("a", 0.0), ("b", 0.31), ("c", 0.68))
    )
    numbers = epoch_numbers([time for time, _ in rows], [name for _, name in rows])
    assert numbers == [index // 3 for index in range(360)]


def test_small_cases() -> None:
    """No row, one row, equal times and one sensor have epochs too."""
    assert epoch_numbers([], []) == []
    assert epoch_numbers([5.0], ["a"]) == [0]
    assert epoch_numbers([0.0, 0.0, 1.0, 1.0, 2.0], ["a", "b", "a", "b", "b"]) == [0, 0, 1, 1, 2]
    assert epoch_numbers([0.0, 1.0, 2.0], ["a", "a", "a"]) == [0, 1, 2]


def test_a_window_that_cuts_epochs_names_auto(tmp_path: Path) -> None:
    """With ``--window 0.1s`` a note counts the damage; with ``auto`` the snapshots are the epochs, without a note."""
    (tmp_path / "log.csv").write_text(JITTERED)
    words = ["convert", "log.csv", "--from", "uwb", "-p", "range_std_m=0.1"]
    cut = run_here(*words, "--window", "0.1s", "-o", "cut.parquet", folder=tmp_path)
    assert cut.returncode == 0, cut.stderr
    text = " ".join(cut.stderr.decode().split())
    assert "of 3 snapshots 1 have a sensor more than once, and 1 lack a sensor that others have" in text
    assert "--window auto" in text
    auto = run_here(*words, "--window", "auto", "-o", "auto.parquet", folder=tmp_path)
    assert auto.returncode == 0, auto.stderr
    assert "note: of" not in auto.stderr.decode()
    table = nlosctl.read(tmp_path / "auto.parquet")
    assert table["snapshot"].to_pylist() == ["10"] * 3 + ["10.099"] * 3 + ["10.199"] * 3
    assert table["sensor"].to_pylist() == ["A1", "A2", "A3"] * 3


def test_epochs_of_several_tags_in_any_order(tmp_path: Path) -> None:
    """Each tag has epochs of its own, and the order of the lines does not matter."""
    lines = [
        f"{10 + k / 10 + a / 1000 + t / 77:.4f},t{t},A{a},5.0" for k in range(4) for a in range(3) for t in range(2)
    ]
    words = ["--from", "uwb", "-p", "range_std_m=0.1", "-p", "tag=tag", "--window", "auto"]
    for name, order in (("one", lines), ("two", lines[::-1])):
        (tmp_path / f"{name}.csv").write_text("time,tag,anchor,range\n" + "\n".join(order) + "\n")
        done = run_here("convert", f"{name}.csv", *words, "-o", f"{name}.parquet", "-q", folder=tmp_path)
        assert done.returncode == 0, done.stderr
    one, two = (nlosctl.read(tmp_path / f"{name}.parquet") for name in ("one", "two"))
    assert one.equals(two)
    counts = one.group_by("snapshot").aggregate([("sensor", "count_distinct")])
    assert counts["sensor_count_distinct"].to_pylist() == [3] * 8
    assert one["snapshot"].to_pylist()[0] == "tag-t0/10"
