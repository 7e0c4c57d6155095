"""Ranges by mirrors and circles on the command line: which commands use them, and which refuse them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from cli_support import FIXTURES, Outcome

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


def test_the_fixture_is_solved_by_every_command_that_uses_reflectors(cli: Cli) -> None:
    """Fixes of ranges whose lengths were found by brute force agree with the truth, as do flags and the bound."""
    hall = FIXTURES / "good_reflected_ranges.csv"
    assert cli("validate", hall).code == 0
    assert cli("localize", "-m", "mixture-ml", hall, "-o", "fixes.csv", "--flags-out", "flags.csv").code == 0
    scores = cli("evaluate", "fixes.csv", "--json").json["groups"][0]
    assert scores["median_m"] < 0.2
    assert scores["fix_rate"] >= 0.7  # two of five rows are outliers in a quarter of the snapshots
    assert scores["rmse_m"] < 0.4
    assert cli("evaluate", "flags.csv", "--json").json["groups"][0]["accuracy"] > 0.9
    bound = cli("bound", hall)
    assert bound.code == 0
    assert max(bound.table["rms_m"].to_pylist()) < 1.0
    assert cli("localize", "-m", "ml", hall, "-o", "ml.csv").code == 0


def test_columns_that_a_method_does_not_use_are_noted(cli: Cli, tmp_path: Path) -> None:
    """A prior, a target's radius and a reflector of triplets are used, or the summary names the methods that do not."""
    header = "snapshot,sensor,sensor_x_m,sensor_y_m,bearing_deg,bearing_std_deg,prior_x_m,prior_y_m,prior_std_m"
    (tmp_path / "b.csv").write_text(f"{header}\n1,a,0,0,45,1,50,50,9\n1,b,100,0,135,1,50,50,9\n")
    done = cli("localize", "-m", "ml", "-m", "sequential", "b.csv", "-o", "e.csv")
    assert "the column 'prior_x_m' is not used by ml" in done.err
    assert "not used by ml, sequential" not in done.err
    text = (FIXTURES / "good_triplets.csv").read_text().splitlines()
    extra = [f"{text[0]},reflector,target_radius_m", *(f"{line},wall,0.1" for line in text[1:])]
    (tmp_path / "t.csv").write_text("\n".join(extra) + "\n")
    done = cli("detect-ip", "-m", "chi2", "-m", "joint", "t.csv", "-o", "f.csv")
    assert "the column 'target_radius_m' is not used by chi2\n" in done.err
    assert "the column 'reflector' is not used" in done.err
    done = cli("bound", FIXTURES / "good_ranges.csv")
    assert "the column 'sensor_z_m' is not used" in done.err


def test_a_range_beside_a_bearing_by_a_circle_is_refused(cli: Cli, tmp_path: Path) -> None:
    """Its path is not the unfolded one: methods and the bound that use ranges refuse it, and run without the ranges."""
    header = "snapshot,sensor,sensor_x_m,sensor_y_m,bearing_deg,bearing_std_deg,reflector,range_m,range_std_m"
    lines = ["1,a,-300,-200,45,2,,400,2", "1,b,300,-250,120,2,{one},{length},{std}", "1,c,250,300,200,2,,,"]
    truth = [f"{header},truth_x_m,truth_y_m", *(f"{line},0,100" for line in lines)]
    (tmp_path / "r.scene.toml").write_text(MIRROR)

    def run(*words: str, one: str = "dome", length: str = "1500") -> Outcome:
        (tmp_path / "r.csv").write_text("\n".join([*truth, ""]).format(one=one, length=length, std=length and 2))
        return cli(*words, "r.csv", "-o", "out.csv", "--overwrite")

    uses = [("localize", "-m", name) for name in ("ml", "mixture-ml", "suppress", "sequential")]
    for words in (*uses, ("bound",)):
        done = run(*words)
        assert done.code == 2
        assert "column 'reflector': got 'dome', a circle, and the row has a range beside its bearing" in done.err
    assert run("localize", "-m", "ls").code == 0
    assert run("bound", "--no-ranges").code == 0
    assert run("localize", "-p", "use_ranges=false").code == 0
    assert run("localize", one="wall").code == 0
    assert run("localize", length="").code == 0
