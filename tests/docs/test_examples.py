"""The examples at the end of each command's help run, one by one, in a folder with the files that they name."""

from __future__ import annotations

import shlex
import shutil
from pathlib import Path

import pyarrow.csv
import pytest
from test_reference import leaves

from nlosctl.cli.examples import EXAMPLES
from tests.support.deviation_worlds import drive
from tests.support.program import run_here

ROOT = Path(__file__).parents[2]
LINES = [(name, line) for name, lines in EXAMPLES.items() for line in lines]


def _make_inputs(folder: Path) -> None:
    for name, words in {
        "paths.csv": "room -n 3 --seed 1",
        "echoes.csv": "echo-field -n 3 --seed 1 -p targets=2",
        "bearings.csv": "ring -n 20",
    }.items():
        assert run_here("simulate", *words.split(), "-q", "-o", name, folder=folder).returncode == 0
    shutil.copy(ROOT / "fixtures" / "formats" / "kraken_app.csv", folder / "drive.csv")
    rows = [line.split(",") for line in (folder / "bearings.csv").read_text().splitlines()]
    at = [rows[0].index(name) for name in ("snapshot", "sensor", "sensor_x_m", "sensor_y_m", "bearing_rad")]
    angles = [",".join(row[index] for index in at) for row in rows]
    (folder / "angles.csv").write_text("\n".join([angles[0].replace("bearing_rad", "Angle"), *angles[1:], ""]))
    timed = [f"{second},{second / 2},{second % 3},1,0,1" for second in range(20)]
    (folder / "timed.csv").write_text("\n".join(["time_s,x_m,y_m,cov_xx_m2,cov_xy_m2,cov_yy_m2", *timed, ""]))
    pyarrow.csv.write_csv(drive(60)[0], folder / "turn.csv")
    shutil.move(folder / "bearings.csv", folder / "ring.csv")
    swept = run_here("simulate", "ring", "-n", "20", "--sweep", "sensors=4,8", "-q", folder=folder)
    for words in (
        "localize ring.csv -m ml -m ls -o fixes.parquet --flags-out flags.parquet",
        "localize - -m ls -o s.csv",
    ):
        assert run_here(*words.split(), "-q", stdin=swept.stdout, folder=folder).returncode == 0
    (folder / "ring.csv").rename(folder / "bearings.csv")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the inputs of the examples."""
    made = tmp_path_factory.mktemp("examples")
    _make_inputs(made)
    return made


@pytest.mark.extensive
@pytest.mark.parametrize("line", [line for name, line in LINES if name != "reproduce"])
def test_an_example_runs(folder: Path, line: str) -> None:
    """Each example exits 0, the commands of a pipe one after the other."""
    stdin = b""
    for step in line.split(" | "):
        words = [*shlex.split(step)[1:], *(["--overwrite"] if " -o " in step else [])]
        done = run_here(*words, stdin=stdin, folder=folder)
        assert (done.returncode, b"" if done.returncode == 0 else done.stderr) == (0, b"")
        stdin = done.stdout


def test_every_command_has_two_examples() -> None:
    """Every command of ours has at least two, each within a terminal of 80 columns, in its help."""
    commands = {name.removeprefix("nlosctl "): command for name, command in leaves().items() if name != "nlosctl"}
    assert set(EXAMPLES) == set(commands)
    for name, lines in EXAMPLES.items():
        assert len(lines) >= 2
        for line in lines:
            assert len(line) <= 78, line
            assert f"nlosctl {name}" in line
            assert line in commands[name].epilog


def test_usage_lines_have_plain_names() -> None:
    """No braces and no doubled brackets in a usage line; several inputs have dots after the name."""
    done = {name: run_here(*name.split(), "--help").stdout.decode() for name in EXAMPLES}
    for text in done.values():
        usage = next(line for line in text.splitlines() if "Usage:" in line)
        assert not {"{", "}"} & set(usage)
        assert "[[" not in usage
    assert "nlosctl localize [OPTIONS] INPUT..." in done["localize"]
    assert "nlosctl config show [OPTIONS] [COMMAND] [FLAG...]" in done["config show"]
