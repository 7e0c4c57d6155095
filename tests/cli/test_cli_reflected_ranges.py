"""Ranges by mirrors and circles on the command line: which commands use them, and which refuse them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from cli_support import Outcome

Cli = Callable[..., Outcome]

MIRROR = """
[[reflector]]
name = "wall"
kind = "line"
point = [0.0, 600.0]
direction = [1.0, 0.1]

[[reflector]]
name = "dome"
kind = "circle"
center = [0.0, 0.0]
radius = 1000.0
"""
REFLECTED = """snapshot,sensor,sensor_x_m,sensor_y_m,sensor_z_m,range_m,range_std_m,reflector,los
1,a,-300,-200,1,300,2,,true
1,b,300,-250,1,900,2,{one},true
1,c,250,300,1,700,2,{other},{los}
"""


def reflected_file(folder: Path, *, one: str, other: str = "", los: str = "true") -> None:
    """Write ranges that name reflectors, with their scene."""
    (folder / "r.csv").write_text(REFLECTED.format(one=one, other=other, los=los))
    (folder / "r.scene.toml").write_text(MIRROR)


@pytest.mark.parametrize("words", [("localize", "-m", "sr-ls"), ("identify-los", "--field=-500,500,-500,500")])
def test_methods_that_take_ranges_as_direct_refuse_reflectors(cli: Cli, tmp_path: Path, words: tuple[str, ...]) -> None:
    """One line names file, snapshot, column, value and the methods that can; rows that are left out do not count."""
    reflected_file(tmp_path, one="wall")
    done = cli(*words, "r.csv", "-o", "out.csv")
    assert done.code == 2
    assert not (tmp_path / "out.csv").exists()
    lines = done.err.strip().splitlines()
    assert len(lines) == 1
    assert "r.csv, snapshot 1, column 'reflector': got 'wall'" in lines[0]
    assert "localize by mixture-ml, ml, r-ls" in lines[0]
    reflected_file(tmp_path, one="", other="wall", los="false")
    assert cli("localize", "-m", "sr-ls", "r.csv", "-o", "out.csv", "--overwrite").code == 0


def test_slant_ranges_by_a_circle_are_refused(cli: Cli, tmp_path: Path) -> None:
    """With a height of the targets a row by a circle is a usage error; one by a wall is not."""
    reflected_file(tmp_path, one="dome")
    done = cli("localize", "r.csv", "--target-z-m", "3", "-o", "out.csv", "--overwrite")
    assert done.code == 2
    assert "column 'reflector': got 'dome', a circle, but with --target-z-m" in done.err
    reflected_file(tmp_path, one="wall")
    assert cli("localize", "r.csv", "--target-z-m", "3", "-o", "out.csv", "--overwrite").code == 0


def test_an_unknown_reflector_of_a_range_is_a_bad_row(cli: Cli, tmp_path: Path) -> None:
    """``validate`` names row, column and the nearest name of a reflector that the scene does not have."""
    reflected_file(tmp_path, one="wal")
    done = cli("validate", "r.csv")
    assert done.code == 1
    assert "column 'reflector': the scene has no reflector 'wal' (did you mean 'wall'?)" in done.err + done.text
