"""Settings that commands share: constants, the table ``[all]``, misspelt variables, EPSG codes."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from cli_support import Outcome

Cli = Callable[..., Outcome]

ROWS = "1,s,0,0,45,1000,1000\n1,t,2000,0,135,1000,1000\n1,u,0,2000,-45,1000,1000\n"
READERS = {
    "localize": ("localize", "m.csv", "-o", "e.csv"),
    "bound": ("bound", "m.csv", "-o", "b.csv"),
    "posterior": ("posterior", "m.csv", "--all", "-o", "p.csv"),
    "validate": ("validate", "m.csv"),
    "plot": ("plot", "m.csv", "-o", "p.svg"),
    "report": ("report", "m.csv", "-o", "r.html"),
}


@pytest.fixture(autouse=True)
def _bearings(tmp_path: Path) -> None:
    """Bearings without standard deviations."""
    header = "snapshot,sensor,sensor_x_m,sensor_y_m,bearing_deg,truth_x_m,truth_y_m\n"
    (tmp_path / "m.csv").write_text(header + ROWS)


@pytest.mark.parametrize("command", READERS)
def test_every_reading_command_takes_the_constants(cli: Cli, command: str) -> None:
    """Without the standard deviation the message names the option; the same command takes it."""
    outcome = cli(*READERS[command])
    assert outcome.code == 1
    assert "--bearing-std-deg" in outcome.err
    assert cli(*READERS[command], "--bearing-std-deg", 2).code == 0


@pytest.mark.parametrize("command", READERS)
def test_the_table_all_serves_every_command(cli: Cli, tmp_path: Path, command: str) -> None:
    """``[all]`` of the config file sets options of all commands that have them; the command's own table goes first."""
    (tmp_path / "c.toml").write_text("[all]\nbearing-std-deg = 2.0\nseed = 3\n[localize]\nseed = 5\n")
    assert cli(*READERS[command], "--config", "c.toml").code == 0
    shown = cli("config", "show", "localize", "--config", "c.toml", "--json").json
    assert {row["setting"]: row["value"] for row in shown}["seed"] == 5


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[all]\nbearing-std-degrees = 2.0\n", "[all] has no setting 'bearing-std-degrees' (did you mean"),
        ("[al]\nseed = 2\n", "no command 'al' (did you mean 'all'?)"),
        ("all = 3\n", "expected a table [all]"),
    ],
)
def test_a_wrong_table_all(cli: Cli, tmp_path: Path, text: str, message: str) -> None:
    """A setting that no command has, and a misspelt table, are usage errors."""
    (tmp_path / "c.toml").write_text(text)
    outcome = cli(*READERS["localize"], "--bearing-std-deg", 2, "--config", "c.toml")
    assert outcome.code == 2
    assert message in outcome.err


def test_a_figure_of_files_with_and_without_the_column(cli: Cli) -> None:
    """A constant serves the files of a figure that lack the column; flags have it."""
    words = ("localize", "m.csv", "--bearing-std-deg", 2, "-o", "e.csv", "--flags-out", "f.csv")
    assert cli(*words).code == 0
    assert cli("plot", "f.csv", "e.csv", "--bearing-std-deg", 2, "-o", "p.svg").code == 0


def test_a_misspelt_variable_is_noted(cli: Cli, monkeypatch: pytest.MonkeyPatch) -> None:
    """The run states which variable sets nothing, on standard error only, unless it is quiet."""
    words = (*READERS["localize"], "--bearing-std-deg", 2, "--overwrite")
    monkeypatch.setenv("NLOSCTL_LOCALIZE_METHODS", "ls")
    monkeypatch.setenv("NLOSCTL_EVALUATE_JSON", "1")
    outcome = cli(*words)
    assert outcome.code == 0
    note = "NLOSCTL_LOCALIZE_METHODS sets nothing (did you mean 'NLOSCTL_LOCALIZE_METHOD'?)"
    assert outcome.err.count("sets nothing") == 1
    assert note in outcome.err
    assert "sets nothing" not in cli(*words, "-q").err


def test_epsg_codes_and_origins(cli: Cli, tmp_path: Path) -> None:
    """A number alone is an EPSG code; the message on another text sends latitudes to ``--origin``."""
    header = "snapshot,sensor,sensor_lat_deg,sensor_lon_deg,azimuth_deg,bearing_std_deg\n"
    (tmp_path / "g.csv").write_text(header + "1,h,47.37,8.54,110.187,1\n1,t,47.4,8.6,198.754,1\n")
    for number, words in enumerate((("--crs", "32632"), ("--crs", "EPSG:32632"))):
        assert cli("localize", "g.csv", "-q", *words, "-o", f"{number}.csv").code == 0
    assert (tmp_path / "0.csv").read_text() == (tmp_path / "1.csv").read_text()
    outcome = cli("localize", "g.csv", "--crs", "47.3")
    assert outcome.code == 2
    assert "--crs takes a CRS, such as EPSG:32632 (LAT,LON belongs to --origin). Got '47.3'" in outcome.err
    outcome = cli("localize", "g.csv", "--origin", "32632")
    assert "--origin takes LAT,LON in degrees (LAT from -90 to 90). Got '32632'" in outcome.err


@pytest.mark.parametrize("command", READERS)
@pytest.mark.parametrize("table", ["all", "command"])
def test_a_config_value_gives_way_to_the_column(cli: Cli, tmp_path: Path, command: str, table: str) -> None:
    """A constant of the config file is for files without the column; as a flag it is an error there."""
    text = (tmp_path / "m.csv").read_text().replace("bearing_deg", "bearing_deg,bearing_std_deg", 1)
    (tmp_path / "m.csv").write_text(
        text.replace(",45,", ",45,1,").replace(",135,", ",135,1,").replace(",-45,", ",-45,1,")
    )
    name = command if table == "command" else table
    (tmp_path / "c.toml").write_text(f"[{name}]\nbearing_std_deg = 5\nrange_std_m = 2\ndod_std_deg = 1\n")
    if table == "command":
        (tmp_path / "c.toml").write_text(f"[{name}]\nbearing_std_deg = 5\n")
    words = READERS[command]
    assert cli(*words, "--config", "c.toml").code == 0
    outcome = cli(*words, "--bearing-std-deg", 5, *(["--overwrite"] if "-o" in words else []))
    if command in ("plot", "report"):  # its files share the options: each takes what it lacks
        assert outcome.code == 0
        return
    assert outcome.code == 2
    assert "--bearing-std-deg is given, but m.csv has a column 'bearing_std_deg'" in outcome.err
    if command == "localize":
        stds = (tmp_path / "e.csv").read_text()
        assert cli(*words, "--overwrite").code == 0
        assert (tmp_path / "e.csv").read_text() == stds


def test_convert_adds_the_column(cli: Cli, tmp_path: Path) -> None:
    """`convert --bearing-std-deg 3` writes the column that the file lacks; the fixes are those with the flag later."""
    assert cli("convert", "m.csv", "--bearing-std-deg", 3, "-o", "c.parquet").code == 0
    assert cli("localize", "c.parquet", "-o", "c.csv").code == 0
    assert cli("localize", "m.csv", "--bearing-std-deg", 3, "-o", "d.csv").code == 0
    assert (tmp_path / "c.csv").read_text() == (tmp_path / "d.csv").read_text()
    for words, message in (
        (("c.parquet", "--bearing-std-deg", 3), "has a column 'bearing_std_rad'"),
        (("m.csv", "--range-std-m", 3), "no column 'range_m'"),
        (("m.csv", "--dod-std-deg", 3), "take no constant"),
        (("c.csv", "--bearing-std-deg", 3), "the table has none"),
    ):
        outcome = cli("convert", *words, "-o", "n.csv")
        assert outcome.code in (1, 2)
        assert message in outcome.err
    (tmp_path / "c.toml").write_text("[all]\nbearing_std_deg = 3\nrange_std_m = 3\n")
    for given, names in (("c.parquet", 1), ("m.csv", 1), ("c.csv", 0)):
        assert cli("convert", given, "--config", "c.toml", "-o", "n.csv", "--overwrite").code == 0
        header = (tmp_path / "n.csv").read_text().splitlines()[0]
        assert (header.count("bearing_std_rad"), header.count("range_std_m")) == (names, 0)
