"""``nlosctl posterior``: its outputs, and one clear line for what it can't do."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pyarrow.parquet
import pytest
from cli_support import Outcome

import nlosctl
from nlosctl.contract.tables import POSTERIOR

Cli = Callable[..., Outcome]
FIELD = "--field=-500,500,-500,500"


@pytest.fixture(autouse=True)
def _bearings(tmp_path: Path) -> None:
    """Five snapshots of bearings."""
    table = nlosctl.simulate("ring", trials=5, seed=2, sensors=5, bearing_std_deg=3.0)
    pyarrow.parquet.write_table(table, tmp_path / "m.parquet")


def test_all_maps_have_their_snapshots(cli: Cli, tmp_path: Path) -> None:
    """``--all`` writes the columns of the schema, a map after the other, equal to the map of each alone."""
    done = cli("posterior", "m.parquet", "--all", FIELD, "--cell", 50, "-m", "mixture-ml", "-o", "maps.parquet")
    assert (done.code, done.out) == (0, b"")
    assert done.err.startswith("posterior of bearings by mixture-ml: 5 snapshots, 20 x 20 cells of 50 m\n")
    maps = pyarrow.parquet.read_table(tmp_path / "maps.parquet")
    assert maps.column_names == [column.name for column in POSTERIOR.columns]
    assert maps["snapshot"].to_pylist() == [number for number in range(5) for _ in range(400)]
    cli("posterior", "m.parquet", "--snapshot", 3, FIELD, "--cell", 50, "-m", "mixture-ml", "-o", "one.parquet")
    alone = pyarrow.parquet.read_table(tmp_path / "one.parquet")
    assert alone.equals(maps.slice(1200, 400).select(alone.column_names))


def test_the_order_and_cut_of_the_input_do_not_matter(cli: Cli, tmp_path: Path) -> None:
    """``--combine`` over two files, or standard input, is byte for byte that over one."""
    table = pyarrow.parquet.read_table(tmp_path / "m.parquet")
    pyarrow.parquet.write_table(table.slice(15), tmp_path / "a.parquet")
    pyarrow.parquet.write_table(table.slice(0, 15), tmp_path / "b.parquet")
    one = cli("posterior", "m.parquet", "--combine", "--cell", 25, "-q")
    two = cli("posterior", "a.parquet", "b.parquet", "--combine", "--cell", 25, "-q")
    stream = cli("posterior", "-", "--combine", "--cell", 25, "-q", stdin=(tmp_path / "m.parquet").read_bytes())
    assert one.code == 0
    assert one.out == two.out == stream.out


@pytest.mark.parametrize(
    ("words", "code", "message"),
    [
        ((), 2, "set one of --snapshot ID (the map of one snapshot), --all (a map of each) and --combine"),
        (("--all", "--combine"), 2, "set one of --snapshot ID"),
        (("--snapshot", "9"), 1, "no snapshot '9' among the 5 of the input"),
        (("--all", "--cell", "0"), 2, "--cell must be a finite number of metres above 0"),
        (("--all", "--cell", "0.5", FIELD), 2, "snapshot 0: 4000000 cells of 0.5 m, more than --max-cells 1000000"),
        (("--all", "-m", "ls"), 2, "method 'ls' has no likelihood of positions for a posterior; set --method to ml"),
        (("--all", "-m", "ml", "-p", "law=vonmises"), 2, "leave out law=vonmises"),
        (("--all", "-p", "prior_x_m=3"), 2, "a prior needs all of prior_x_m, prior_y_m and prior_std_m"),
        (("--all", "-p", "nothing=3"), 2, "nothing"),
        (("--all", "-o", "maps/"), 2, "maps are one table, not one per part of the input"),
        (("--all", "-o", "nowhere/map.parquet"), 1, "nowhere"),
        (("--combine", "--where", "sensor == none"), 1, "no rows left"),
    ],
)
def test_one_line_for_what_it_cannot_do(
    cli: Cli, tmp_path: Path, words: tuple[str, ...], code: int, message: str
) -> None:
    """The message names the setting, and nothing is written."""
    before = {path.name for path in tmp_path.iterdir()}
    outcome = cli("posterior", "m.parquet", *(words if "-o" in words else (*words, "-o", "map.parquet")))
    assert outcome.code == code
    assert message in outcome.err
    assert outcome.err.count("\n") == 1
    assert {path.name for path in tmp_path.iterdir()} == before


def test_a_posterior_narrower_than_a_cell_is_noted(cli: Cli) -> None:
    """The summary states it where one cell has more than half of the probability."""
    done = cli("posterior", "m.parquet", "--combine", "--cell", 400, FIELD, "-o", "map.csv")
    assert done.code == 0
    assert "narrower than a cell; choose a smaller --cell" in done.err


def test_a_point_has_nothing_to_show(cli: Cli, tmp_path: Path) -> None:
    """Sensors at one point have no region of their own: the message names ``--field``."""
    rows = "1,s,0,0,45,3\n1,t,0,0,50,3\n"
    (tmp_path / "p.csv").write_text(f"snapshot,sensor,sensor_x_m,sensor_y_m,bearing_deg,bearing_std_deg\n{rows}")
    outcome = cli("posterior", "p.csv", "--snapshot", 1, "-o", "map.csv")
    assert outcome.code == 1
    assert "nothing to show; set --field" in outcome.err
    assert cli("posterior", "p.csv", "--snapshot", 1, FIELD, "-o", "map.csv").code == 0


@pytest.mark.parametrize("maps", [("--snapshot", "0"), ("--all",)])
def test_an_id_in_two_inputs_is_no_snapshot(cli: Cli, tmp_path: Path, maps: tuple[str, ...]) -> None:
    """Maps of two inputs with ids of their own would be one map of both."""
    table = "snapshot,sensor,sensor_x_m,sensor_y_m,bearing_deg,bearing_std_deg\n0,a,0,0,45,3\n0,b,100,0,135,3\n"
    (tmp_path / "1.csv").write_text(table)
    (tmp_path / "2.csv").write_text(table.replace("45", "30"))
    done = cli("posterior", "1.csv", "2.csv", *maps, "-o", "m.csv")
    assert (done.code, (tmp_path / "m.csv").exists()) == (1, False)
    assert "snapshot '0' is in 1.csv and in 2.csv" in done.err
