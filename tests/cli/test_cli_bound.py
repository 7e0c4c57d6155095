"""``nlosctl bound``: at the truth, over a map, and errors."""

from __future__ import annotations

import csv
import io
import json
import re
import subprocess
import tomllib
from pathlib import Path

import numpy as np
import pyarrow.parquet
import pytest
from program import run_here

import nlosctl
from nlosctl.contract.tables import BOUND

pytestmark = pytest.mark.extensive

FIXTURES = Path(__file__).parents[2] / "fixtures"
MEASUREMENTS = str(FIXTURES / "good_over_the_horizon.csv")
SCENE = str(FIXTURES / "good_over_the_horizon.scene.toml")


def run(*words: str, standard_input: bytes | None = None) -> subprocess.CompletedProcess[bytes]:
    """Run ``nlosctl bound`` with arguments."""
    return run_here("bound", *words, stdin=standard_input or b"")


def rows(done: subprocess.CompletedProcess[bytes]) -> list[dict[str, str]]:
    """Return the CSV rows of stdout."""
    assert done.returncode == 0, done.stderr.decode()
    return list(csv.DictReader(io.StringIO(done.stdout.decode())))


def test_a_row_per_snapshot_at_its_truth() -> None:
    """Each snapshot has the bound at its truth, in the columns of the schema, and is counted in the summary."""
    done = run(MEASUREMENTS)
    found = rows(done)
    assert list(found[0]) == [column.name for column in BOUND.columns if column.required or column.name == "snapshot"]
    assert [row["snapshot"] for row in found] == [str(number) for number in range(25)]
    with Path(MEASUREMENTS).open(encoding="utf-8") as file:
        truth = {row["snapshot"]: float(row["truth_x_m"]) for row in csv.DictReader(file)}
    for row in found:
        assert float(row["x_m"]) == truth[row["snapshot"]]
        trace = float(row["bound_xx_m2"]) + float(row["bound_yy_m2"])
        assert float(row["rms_m"]) == pytest.approx(trace**0.5)
        assert 0.0 < float(row["semi_minor_m"]) <= float(row["cep50_m"]) / 0.67 < 3.0 * float(row["semi_major_m"])
    assert "bound of bearings: 25 of 25 snapshots have one" in done.stderr.decode()


def test_a_map_has_a_row_per_vertex() -> None:
    """A map has its vertices row by row, both ends included; null in the shadow of the earth."""
    found = rows(run(MEASUREMENTS, "--map", "-200e3,200e3,6300e3,6450e3,50e3"))
    assert list(found[0]) == [column.name for column in BOUND.columns if column.required]
    assert len(found) == 9 * 4
    assert [float(row["x_m"]) for row in found[:9]] == [-200e3 + 50e3 * number for number in range(9)]
    underground = [row for row in found if np.hypot(float(row["x_m"]), float(row["y_m"])) < 6371e3]
    assert underground
    assert all(row["rms_m"] == "" and row["n_used"] == "0" for row in underground)
    assert any(row["n_used"] == "4" and float(row["rms_m"]) > 0.0 for row in found)


def test_a_map_of_ranges_is_the_closed_form(tmp_path: Path) -> None:
    """The information of ranges is the sum of u u' / std^2 over the unit vectors u from the sensors."""
    sensors, stds = np.array([(0.0, 0.0), (100.0, 0.0), (40.0, 90.0)]), np.array([0.5, 1.0, 2.0])
    lines = [f"1,{k},{x},{y},50,{std}" for k, ((x, y), std) in enumerate(zip(sensors, stds, strict=True))]
    file = tmp_path / "ranges.csv"
    file.write_text("\n".join(["snapshot,sensor,sensor_x_m,sensor_y_m,range_m,range_std_m", *lines]), encoding="utf-8")
    for row in rows(run(str(file), "--map", "10,70,20,60,20")):
        toward = np.array([float(row["x_m"]), float(row["y_m"])]) - sensors
        unit = toward / np.hypot(*toward.T)[:, None] / stds[:, None]
        expected = np.linalg.inv(unit.T @ unit)
        found = [float(row[f"bound_{name}_m2"]) for name in ("xx", "xy", "yy")]
        np.testing.assert_allclose(found, [expected[0, 0], expected[0, 1], expected[1, 1]], rtol=1e-12)


def test_the_function_equals_the_command() -> None:
    """`nlosctl.bound` on a table gives the rows of the command."""
    import pyarrow.csv

    table = pyarrow.csv.read_csv(MEASUREMENTS)
    by_function = nlosctl.bound(table, scene=SCENE).to_pydict()
    by_command = rows(run(MEASUREMENTS))
    assert [repr(value) for value in by_function["rms_m"]] == [row["rms_m"] for row in by_command]
    over_map = nlosctl.bound(table, scene=SCENE, map=(0.0, 1e5, 6.4e6, 6.4e6, 5e4))
    assert over_map.num_rows == 3


@pytest.mark.parametrize(
    ("words", "code", "message"),
    [
        (("--map", "1,2,3"), 2, "--map takes xmin,xmax,ymin,ymax,step"),
        (("--map", "1,0,0,1,1"), 2, "rising and step above 0"),
        (("--map", "0,1,0,1,0"), 2, "rising and step above 0"),
        (("--map", "0,1,0,1,nan"), 2, "--map takes"),
        (("--map", "0,1e9,0,1e9,1"), 2, "vertices"),
        (("--map", "0,one,0,1,1"), 2, "--map takes"),
        (("--map", "0,1,0,1,1", "-o", "maps/"), 2, "set --output to a file"),
        (("--scene", "absent.toml"), 1, "absent.toml: the scene can't be read"),
    ],
)
def test_invalid_maps_and_scenes(words: tuple[str, ...], code: int, message: str) -> None:
    """An invalid map is a usage error, a missing scene a data error; stdout stays empty."""
    done = run(MEASUREMENTS, *words)
    assert (done.returncode, done.stdout) == (code, b"")
    assert message in done.stderr.decode()


def test_missing_truth_is_an_error(tmp_path: Path) -> None:
    """Without truth columns the message has the cure, and no partial output is left."""
    lines = Path(MEASUREMENTS).read_text(encoding="utf-8").splitlines()
    cut = tmp_path / "cut.csv"
    cut.write_text("\n".join(",".join(line.split(",")[:7]) for line in lines), encoding="utf-8")
    done = run(str(cut), "--scene", SCENE, "-o", str(tmp_path / "bound.csv"))
    assert done.returncode == 1
    assert "no column 'truth_x_m'; a bound needs the truth, or --map" in done.stderr.decode()
    assert not (tmp_path / "bound.csv").exists()


def test_the_report_counts(tmp_path: Path) -> None:
    """``--report`` has the number of positions and of bounds."""
    report = tmp_path / "report.json"
    rows(run(MEASUREMENTS, "--map", "0,1e5,6.3e6,6.4e6,1e5", "--report", str(report)))
    output = json.loads(report.read_text(encoding="utf-8"))
    assert output == {"kind": "bearings", "map": "0,1e5,6.3e6,6.4e6,1e5", "positions": 4, "bounded": 2}


def test_it_reads_standard_input() -> None:
    """`-` reads measurements from a pipe."""
    found = rows(run("-", "--scene", SCENE, standard_input=Path(MEASUREMENTS).read_bytes()))
    assert len(found) == 25


def test_a_map_holds_its_sensors(tmp_path: Path) -> None:
    """The map's scene has the sensors of the first snapshot at their positions, and those rows alone that take part."""
    rows_of_file = ["0,a,0,0,45,1,true", "0,b,100,0,135,1,true", "0,a,50,-20,90,1,true", "0,c,9,9,0,1,false"]
    header = "snapshot,sensor,sensor_x_m,sensor_y_m,bearing_deg,bearing_std_deg,los"
    (tmp_path / "in.csv").write_text("\n".join([header, *rows_of_file, "1,d,0,0,45,1,true", ""]))
    done = run_here("bound", "in.csv", "--map", "0,100,0,100,50", "-o", "map.parquet", folder=tmp_path)
    assert done.returncode == 0
    scene = pyarrow.parquet.read_schema(tmp_path / "map.parquet").metadata[b"nlosctl.scene"].decode()
    sensors = {entry["name"]: entry["position"] for entry in tomllib.loads(scene)["sensor"]}
    assert sensors == {"a": [0.0, 0.0], "b": [100.0, 0.0], "a#2": [50.0, -20.0]}
    assert run_here("plot", "map.parquet", "-o", "map.svg", folder=tmp_path).returncode == 0
    assert {"a", "b", "a#2"} <= set(re.findall(r"<!-- (.*?) -->", (tmp_path / "map.svg").read_text()))


@pytest.mark.parametrize("words", [(), ("--map", "30,30,40,40,5")])
def test_slant_ranges_have_less_information(tmp_path: Path, words: tuple[str, ...]) -> None:
    """With `--target-z-m` a row's information is that of the horizontal part of its direction; without, a note."""
    sensors = np.array([[0.0, 0.0, 40.0], [100.0, 0.0, 10.0], [0.0, 90.0, 25.0]])
    lines = ["snapshot,sensor,sensor_x_m,sensor_y_m,sensor_z_m,range_m,range_std_m,truth_x_m,truth_y_m"]
    source = np.array([30.0, 40.0, 2.0])
    for name, sensor in zip("abc", sensors, strict=True):
        place = ",".join(map(str, sensor.tolist()))
        lines.append(f"0,{name},{place},{np.linalg.norm(source - sensor)},0.5,30,40")
    (tmp_path / "in.csv").write_text("\n".join([*lines, ""]))
    unit = (source - sensors) / np.linalg.norm(source - sensors, axis=1)[:, None]
    expected = np.linalg.inv(unit[:, :2].T @ unit[:, :2] / 0.25)
    done = run_here("bound", "in.csv", "--target-z-m", "2", *words, folder=tmp_path)
    (row,) = rows(done)
    found = [float(row[f"bound_{name}_m2"]) for name in ("xx", "xy", "yy")]
    np.testing.assert_allclose(found, [expected[0, 0], expected[0, 1], expected[1, 1]], rtol=1e-9)
    assert b"note" not in done.stderr
    flat = run_here("bound", "in.csv", *words, folder=tmp_path)
    assert b"'sensor_z_m' is not used without --target-z-m" in flat.stderr
    assert float(rows(flat)[0]["bound_xx_m2"]) < 0.9 * expected[0, 0]
    table = nlosctl.bound(tmp_path / "in.csv", target_z_m=2.0)
    assert table.column("bound_xx_m2")[0].as_py() == pytest.approx(expected[0, 0])


def simulated(name: str, target: Path, *words: str) -> str:
    """Return the path of a simulated file."""
    assert run_here("simulate", name, "-n", "20", "-q", *words, "-o", str(target)).returncode == 0
    return str(target)


def test_three_dimensions_have_heights_and_six_entries(tmp_path: Path) -> None:
    """In space a row has z_m, all six entries of the bound, and the root of the whole trace."""
    found = rows(run(simulated("space-ring", tmp_path / "ring.csv")))
    at_rest = [column.name for column in BOUND.columns if column.name != "time_s" and column.unit != "m2/s2"]
    assert list(found[0]) == at_rest
    for row in found:
        diagonal = [float(row[f"bound_{axes}_m2"]) for axes in ("xx", "yy", "zz")]
        assert float(row["rms_m"]) == pytest.approx(np.sqrt(sum(diagonal)))
        assert 0.0 < float(row["z_m"]) < 200.0
    flat = rows(run(str(tmp_path / "ring.csv"), "--dimensions", "2"))
    assert "z_m" not in flat[0]


@pytest.mark.parametrize(("std", "noise"), [(None, "gaussian"), ("0.3", "gaussian"), ("0.3", "laplace")])
def test_a_map_in_space_is_at_a_height(tmp_path: Path, std: str | None, noise: str) -> None:
    """A map of ranges in space is the closed form at its height; an exact height leaves x and y.

    Laplacian errors double the information of the ranges, not that of the height.
    """
    file = simulated("box", tmp_path / "box.parquet")
    words = ["--dimensions", "3", "--map", "-4,4,-4,4,4", "--target-z-m", "1.5"]
    found = rows(run(file, *words, "--noise", noise, *([] if std is None else ["--target-z-std-m", std])))
    table = pyarrow.parquet.read_table(file).to_pylist()[:6]
    for row in found:
        point = np.array([float(row[name]) for name in ("x_m", "y_m", "z_m")])
        assert point[2] == 1.5
        away = point - np.array([[line[f"sensor_{axis}_m"] for axis in "xyz"] for line in table])
        unit = away / np.linalg.norm(away, axis=1)[:, None] / 0.1
        information = unit.T @ unit * (2.0 if noise == "laplace" else 1.0)
        expected = np.zeros((3, 3))
        if std is None:
            expected[:2, :2] = np.linalg.inv(information[:2, :2])
        else:
            information[2, 2] += 1.0 / float(std) ** 2
            expected = np.linalg.inv(information)
        names = ("xx", "xy", "yy", "xz", "yz", "zz")
        got = np.array([float(row[f"bound_{axes}_m2"]) for axes in names])
        np.testing.assert_allclose(got, expected[np.tril_indices(3)], rtol=1e-9, atol=1e-15)


def test_a_map_in_space_needs_a_height(tmp_path: Path) -> None:
    """A map of a file in three dimensions without a height is a usage error that names the option."""
    done = run(simulated("space-ring", tmp_path / "ring.csv"), "--map", "-4,4,-4,4,4")
    assert done.returncode == 2
    assert b"--map in three dimensions needs the height of its positions: set --target-z-m" in done.stderr


def test_resume_refuses_another_std_of_the_height(tmp_path: Path) -> None:
    """A folder is not completed with another ``--target-z-std-m`` than it was begun with; nothing changes."""
    (tmp_path / "in").mkdir()
    simulated("box", tmp_path / "in" / "box.parquet")
    words = ["bound", "in/", "-o", "out/", "--dimensions", "3", "--target-z-m", "1.5", "--target-z-std-m"]
    assert run_here(*words, "0.3", folder=tmp_path).returncode == 0
    before = (tmp_path / "out" / "box.parquet").read_bytes()
    refused = run_here(*words, "0.6", "--resume", folder=tmp_path)
    assert refused.returncode == 1
    assert b"target_z_std_m was 0.3 and is 0.6" in refused.stderr
    assert (tmp_path / "out" / "box.parquet").read_bytes() == before
    assert run_here(*words, "0.3", "--resume", folder=tmp_path).returncode == 0
