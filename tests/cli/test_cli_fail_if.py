"""``--fail-if`` of the solving commands, without a truth."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from cli_support import Outcome

Cli = Callable[..., Outcome]
CLEAN = ("simulate", "ring", "-n", 40, "-q")


@pytest.mark.parametrize(
    ("conditions", "code"),
    [
        (["fix_rate<0.95"], 0),
        (["fix_rate>=1"], 4),
        (["ml:fix_rate<0.95", "share_p_below_0001>0.05"], 0),
        (["used_share<0.5"], 0),
        (["ml:used_share>0.5"], 4),
        (["rmse_m>5"], 2),
        (["ls:fix_rate<0.9"], 2),
        (["fix_rate"], 2),
    ],
)
def test_conditions_on_a_run(cli: Cli, conditions: list[str], code: int) -> None:
    """A condition that is met exits 4, one on an unknown metric or method 2, before anything is read or written."""
    drawn = cli(*CLEAN)
    words = [word for condition in conditions for word in ("--fail-if", condition)]
    outcome = cli("localize", "-", *words, stdin=drawn.out)
    assert outcome.code == code
    assert (outcome.out == b"") is (code == 2)
    assert ("which meets" in outcome.err) is (code == 4)


def test_fixes_are_counted_not_positions(cli: Cli, tmp_path: Path) -> None:
    """Half of the snapshots have parallel lines: the fix rate is .5; ``--strict`` with a condition met exits 4."""
    rows = ["snapshot,sensor,sensor_x_m,sensor_y_m,bearing_rad,bearing_std_rad"]
    for snapshot in range(4):
        second = 2.0 if snapshot % 2 else 1.0
        rows += [f"{snapshot},a,0,0,1.0,0.01", f"{snapshot},b,100,0,{second},0.01"]
    (tmp_path / "m.csv").write_text("\n".join(rows) + "\n")
    outcome = cli("localize", "m.csv", "--fail-if", "fix_rate<0.51", "--strict")
    assert outcome.code == 4
    assert "fix_rate of ml is 0.5, which meets 'fix_rate<0.51'" in outcome.err
    assert cli("localize", "m.csv", "--fail-if", "fix_rate<0.5", "--strict").code == 3


def test_targets_count_by_snapshot(cli: Cli) -> None:
    """``identify-los``: a snapshot counts once, however many targets it has, and not where it has none."""
    drawn = cli("simulate", "echo-field", "-n", 5, "-q")
    outcome = cli("identify-los", "-", "--fail-if", "fix_rate<=1", stdin=drawn.out)
    assert "fix_rate of assignment is 1, which meets" in outcome.err
    assert cli("detect-ip", "-", "--fail-if", "fix_rate<1", stdin=drawn.out).code == 2


def test_answered_rows_of_a_detector(cli: Cli) -> None:
    """``detect-ip``: the share of rows with a p-value; paths shorter than the baseline have none by ``tdaj``."""
    rows = [
        "snapshot,path,tx_x_m,tx_y_m,rx_x_m,rx_y_m,dod_rad,doa_rad,path_length_m,dod_std_rad,doa_std_rad,path_length_std_m"
    ]
    rows += ["1,1,0,0,40,0,0.8,2.3,60,0.01,0.01,0.3", "1,2,0,0,40,0,0.8,2.3,39,0.01,0.01,0.3"]
    given = ("\n".join(rows) + "\n").encode()
    for method, rate in (("chi2", "1"), ("tdaj", "0.5")):
        outcome = cli("detect-ip", "-m", method, "-", "--fail-if", "answered_rate>0", stdin=given)
        assert outcome.code == 4
        assert f"answered_rate of {method} is {rate}, which meets" in outcome.err
