"""Which importer a log belongs to: ``--from auto``, logs of two makers, and the messages of wrong importers."""

from __future__ import annotations

import itertools
import shutil
import tomllib
from pathlib import Path

import pytest
from program import run_here

import nlosctl
from nlosctl import registry
from nlosctl.errors import DataError
from nlosctl.pipeline.convert.importer import Import

ROOT = Path(__file__).parents[2]
FORMATS = ROOT / "fixtures" / "formats"
LOGS = {
    "kraken_app.csv": "kraken-csv",
    "df_aggregator.xml": "kraken-xml",
    "kraken_one_line.xml": "kraken-xml",
    "kraken_pro.jsonl": "kraken-json",
    "u_connect_locate.log": "uudf",
    "anchor_azimuths.csv": "anchor-azimuths",
    "uwb_ranges.csv": "uwb",
    "bear_bearings.csv": "wildlife",
    "grouse.csv": "wildlife",
    "azimuth.dat": "white-garrott",
    "telemetry.tsv": "wildlife",
    "array_a.json": "odas",
    "array_b.json": "odas",
    "array_c.json": "odas",
    "uwb_wide.csv": "uwb",
    "uwb_ranges.jsonl": "uwb",
    "sionna_paths.npz": "sionna",
    "deepmimo_paths.npz": "deepmimo",
    "opensky.csv": "opensky",
    "sounds.csv": "soundfinder",
    "util_tdoa.csv": "util-tdoa",
}
SCENES = {f"array_{letter}.json": f"array_{letter}" for letter in "abc"} | {
    name: Path(name).stem for name in ("azimuth.dat", "opensky.csv", "sounds.csv", "util_tdoa.csv")
}
BESIDE = {"deepmimo_scenario", "opensky_sensors.csv", "recorders.csv", "anchor_survey.txt"}
TEXTS = {name: FORMATS / name for name in LOGS if not name.endswith(".npz")}


def log(folder: Path, *names: str, joint: bytes = b"") -> Path:
    """Write logs, one after the other, to a file whose name has no meaning, with the scene of the anchors."""
    path = folder / "log"
    path.write_bytes(joint.join((FORMATS / name).read_bytes() for name in names))
    shutil.copy(FORMATS / f"{SCENES.get(names[0], 'uwb_ranges')}.scene.toml", folder / "log.scene.toml")
    return path


def test_every_importer_has_a_log() -> None:
    """Each built-in importer has a log in the fixtures, and each log there an entry in ``LOGS``."""
    built_in = [entry for entry in registry.format_entries() if entry.distribution == "nlosctl"]
    assert {entry.name for entry in built_in if entry.kind == "import"} == set(LOGS.values())
    assert {path.name for path in FORMATS.iterdir() if not path.name.endswith(".scene.toml")} == {*LOGS, *BESIDE}


@pytest.mark.parametrize("name", LOGS)
def test_auto_recognizes_every_log_by_content(tmp_path: Path, name: str) -> None:
    """``auto`` needs no parameters for a sample, and gives the rows of the named importer whatever the file's name."""
    of_sample = Import("auto", {}).read(str(FORMATS / name))
    parameters = {"sensor": Path(name).stem} if LOGS[name] == "odas" else {}
    found = Import("auto", parameters).read(str(log(tmp_path, name)))
    assert found.importer == LOGS[name]
    assert found.table.equals(Import(LOGS[name], parameters).read(str(tmp_path / "log")).table)
    assert found.table.equals(of_sample.table)


@pytest.mark.parametrize("first", TEXTS)
def test_two_makers_in_one_log_are_an_error(tmp_path: Path, first: str) -> None:
    """Never half a file: the message names both, whether the importer is one of them or ``auto``."""
    for second, joint in itertools.product(TEXTS, (b"", b"\n")):
        makers = {LOGS[first], LOGS[second]}
        path = log(tmp_path, first, second, joint=joint)
        for name in ("auto", *makers) if len(makers) == 2 else ():
            with pytest.raises(DataError) as caught:
                Import(name, {}).read(str(path))
            assert "\n" not in str(caught.value)
            assert all(repr(maker) in str(caught.value) for maker in makers), str(caught.value)


@pytest.mark.parametrize("name", LOGS)
def test_a_wrong_importer_names_the_right_one(tmp_path: Path, name: str) -> None:
    """Whatever the fault of the other importer, its message names the one that recognizes the log."""
    path = log(tmp_path, name)
    for other in sorted({*LOGS.values()} - {LOGS[name]}):
        with pytest.raises(DataError, match=f"looks like a file for the importer '{LOGS[name]}'"):
            Import(other, {}).read(str(path))


def test_columns_that_look_like_those_of_another(tmp_path: Path) -> None:
    """A header that fits another importer does not forbid the named one: columns have any names."""
    (tmp_path / "t.csv").write_text("time_s,sensor,azimuth_deg,metres\n0,A,1,5\n0.01,B,2,6\n")
    parameters = {"time": "time_s", "anchor": "sensor", "range": "metres"}
    assert Import("uwb", parameters).read(str(tmp_path / "t.csv")).table["range_m"].to_pylist() == [5.0, 6.0]


@pytest.mark.parametrize("content", [b"", b"a,b\n1,2\n", b"\x00\x01", b"PK\x03\x04broken", b"PAR1broken", b"{}\n"])
def test_what_nothing_fits_lists_the_candidates(tmp_path: Path, content: bytes) -> None:
    """One line with the names of all importers, exit code 1."""
    (tmp_path / "x").write_bytes(content)
    done = run_here("convert", "x", "--from", "auto", "-o", "y.parquet", folder=tmp_path)
    assert done.returncode == 1
    (line,) = done.stderr.decode().splitlines()
    assert "no importer recognizes it; name one with --from: " in line
    assert all(name in line for name in LOGS.values())


def test_tables_of_this_program_are_not_logs(tmp_path: Path) -> None:
    """A table that an importer made is not recognized as a log."""
    for suffix in (".csv", ".jsonl", ".parquet"):
        nlosctl.convert(str(FORMATS / "kraken_app.csv"), str(tmp_path / f"t{suffix}"), importer="kraken-csv")
        with pytest.raises(DataError, match="no importer recognizes it"):
            Import("auto", {}).read(str(tmp_path / f"t{suffix}"))


def test_the_summary_names_the_importer(tmp_path: Path) -> None:
    """On success the summary and the provenance name the importer that ``auto`` found; stdin works too."""
    shutil.copy(FORMATS / "kraken_app.csv", tmp_path / "log")
    done = run_here("convert", "log", "--from", "auto", "-o", "y.parquet", folder=tmp_path)
    assert done.stderr.decode() == "log: 3 rows (importer kraken-csv)\n"
    content = (FORMATS / "kraken_one_line.xml").read_bytes()
    done = run_here("convert", "-", "--from", "auto", "-o", "z.parquet", folder=tmp_path, stdin=content)
    assert done.stderr.decode() == "-: 3 rows (importer kraken-xml)\n"


def test_the_sample_scenes_are_valid() -> None:
    """Each scene beside a sample is TOML with anchors."""
    for path in FORMATS.glob("*.scene.toml"):
        assert tomllib.loads(path.read_text())["sensor"]
