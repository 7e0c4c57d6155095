"""Regression tests of faults found by fuzzing, kills and numerical tests."""

from __future__ import annotations

import gc
import json
import os
import signal
import time
from collections.abc import Iterator
from io import BytesIO
from pathlib import Path
from typing import Any
from zipfile import ZipFile

import numpy as np
import pyarrow as pa
import pyarrow.parquet
import pytest
from guarded_run import Ending, complaints, run_guarded
from other_seeds import CACHED, PARTED, without_figures
from seed_files import FIXTURES

from nlosctl.cli import main

pytestmark = pytest.mark.extensive

BEARINGS = "snapshot,sensor,sensor_x_m,sensor_y_m,bearing_rad,bearing_std_rad\n"
TRIPLETS = "snapshot,path,tx_x_m,tx_y_m,rx_x_m,rx_y_m,dod_rad,doa_rad,toa_s,dod_std_rad,doa_std_rad,path_length_std_m\n"


def assert_refused(folder: Path, words: list[Any], *message: str) -> Ending:
    """Check that a run exits 1 with one clear line that contains all of ``message``, and leaves nothing."""
    before = [path.name for path in folder.iterdir()]
    ending = run_guarded([*words, "-q"])
    assert list(complaints(ending, folder, [], before)) == []
    assert ending.code == 1
    assert [word for word in message if word not in ending.err] == []
    return ending


def test_hexadecimal_integers_are_refused(folder: Path) -> None:
    """``0x10`` in a column of integers is a bad row; it was read as 16."""
    text = (FIXTURES / "good_echoes.csv").read_text().replace("true,0\n", "true,0x10\n", 1)
    assert "0x10" in text
    (folder / "m.csv").write_text(text)
    assert_refused(folder, ["identify-los", "m.csv", "-o", "f.csv"], "'truth_target'", "'0x10'", "integer")


def test_control_characters_after_a_number(folder: Path) -> None:
    """A group separator after a number is a bad row; it was stripped like a blank."""
    (folder / "m.csv").write_text(f"{BEARINGS}1,a,0,0,0.5\x1d,0.1\n1,b,\u00a01 ,0,1.5,0.1\n")
    ending = assert_refused(folder, ["localize", "m.csv", "-o", "e.csv"], "row 1", "'bearing_rad'", "0.5\\x1d")
    assert "row 2" not in ending.err


def test_half_precision_in_a_foreign_column(folder: Path) -> None:
    """Estimates with a foreign half-precision column are evaluated; this was an internal error."""
    run_guarded(["localize", str(FIXTURES / "good_bearings.parquet"), "-o", "e.parquet", "-q"])
    table = pyarrow.parquet.read_table(folder / "e.parquet")
    more = pa.array(np.full(table.num_rows, 0.5, np.float16))
    with pa.ipc.new_file(folder / "e.arrow", table.append_column("quality", more).schema) as sink:
        sink.write_table(table.append_column("quality", more))
    ending = run_guarded(["evaluate", "e.arrow", "-q"])
    assert (ending.code, ending.err) == (0, "")


def test_the_largest_path_number(folder: Path) -> None:
    """Paths up to the largest integer are distinguished; the largest was a warning."""
    rows = [f"1,{path},0,0,9,0,1,2,12,0.1,0.1,1\n" for path in (2**63 - 1, 5, 3)]
    header = TRIPLETS.replace("toa_s", "path_length_m")
    (folder / "m.csv").write_text(header + "".join(rows))
    ending = run_guarded(["validate", "m.csv", "-q"])
    assert (ending.code, ending.err) == (0, "")


def test_paths_without_any_number(folder: Path) -> None:
    """Rows without any path number are duplicates, reported one by one; this was a warning."""
    rows = [f"{snapshot},,0,0,9,0,1,2,{12 + length},0.1,0.1,1\n" for snapshot in (1, 2) for length in (0, 1)]
    header = TRIPLETS.replace("toa_s", "path_length_m")
    (folder / "m.csv").write_text(header + "".join(rows))
    ending = run_guarded(["detect-ip", "m.csv", "-q"])
    assert ending.code == 1
    assert [f"m.csv, row {row} (line {row + 1}): duplicate measurement" in ending.err for row in (1, 2, 3, 4)] == [
        False, True, False, True
    ]  # fmt: skip


def test_integers_above_2_61_are_plotted(folder: Path) -> None:
    """Estimates with integers of 2^61 and more are plotted; this was an internal error."""
    run_guarded(["localize", str(FIXTURES / "good_bearings.parquet"), "-o", "e.parquet", "-q"])
    table = pyarrow.parquet.read_table(folder / "e.parquet")
    large = pa.array(np.append(np.zeros(table.num_rows - 1, np.int64), 2**61 + 1))
    place = table.column_names.index("alternative")
    pyarrow.parquet.write_table(table.set_column(place, "alternative", large), folder / "large.parquet")
    for words in (["plot", "large.parquet", "-o", "p.svg", "-q"], ["evaluate", "large.parquet", "-q"]):
        ending = run_guarded(words)
        assert (ending.code, ending.err) == (0, "")


def test_tables_without_columns_are_refused(folder: Path) -> None:
    """A table of twenty rows without columns is refused; it was copied as an empty table."""
    batch = pa.RecordBatch.from_pylist([{}] * 20, pa.schema([]))
    with pa.ipc.new_file(folder / "m.arrow", batch.schema) as sink:
        sink.write_batch(batch)
    ending = run_guarded(["convert", "m.arrow", "-o", "c.csv", "-q"])
    assert (ending.code, ending.err) == (1, "nlosctl: m.arrow: the table has no columns\n")


@pytest.mark.parametrize("words", [["evaluate", "e.csv"], ["plot", "e.csv", "-o", "p.svg"]], ids=["evaluate", "plot"])
def test_duplicate_columns_in_results(words: list[str], folder: Path) -> None:
    """Duplicate columns are reported; this was an internal error."""
    run_guarded(["localize", str(FIXTURES / "good_bearings.parquet"), "-o", "e.csv", "-q"])
    header, *lines = (folder / "e.csv").read_text().splitlines()
    text = "\n".join([f"{header},note,note", *(f"{line},a,b" for line in lines)])
    (folder / "e.csv").write_text(text)
    ending = run_guarded([*words, "-q"])
    assert (ending.code, ending.err) == (1, "nlosctl: e.csv: column 'note' occurs twice; rename or drop one\n")


def test_files_refused_by_evaluate_are_closed(folder: Path) -> None:
    """Flags without truth, and estimates beside flags, are refused, and no file stays open."""
    words = [str(FIXTURES / "good_bearings.csv"), "--flags-out", "f.csv", "-o", "e.csv", "-q"]
    assert run_guarded(["localize", *words]).code == 0
    lines = (folder / "f.csv").read_text().splitlines()
    (folder / "bare.csv").write_text("\n".join(line.rpartition(",")[0] for line in lines).replace("truth_los", "other"))
    for inputs, output in (["bare.csv"], "no column"), (["e.csv", "f.csv"], "one by one"):
        ending = run_guarded(["evaluate", *inputs, "-q"])
        gc.collect()
        assert ending.code == 1
        assert output in ending.err


def test_overflow_in_unit_conversion(folder: Path) -> None:
    """A time that is finite in seconds but not in metres is a bad row; this was a warning."""
    (folder / "m.csv").write_text(f"{TRIPLETS}1,0,0,0,9,0,1,2,1e302,0.1,0.1,1\n")
    assert_refused(folder, ["detect-ip", "m.csv", "-o", "f.csv"], "row 1", "'toa_s'", "got 1e+302", "within 1e+15")


def test_ragged_lines_that_are_not_utf8(folder: Path) -> None:
    """A line with too few fields that is not UTF-8 is reported; this was an internal error."""
    (folder / "m.csv").write_bytes(f"{BEARINGS}1,a,0,0,0.5,0.1\n1,b,".encode() + b"\xff\xfe\n")
    assert_refused(folder, ["localize", "m.csv", "-o", "e.csv"], "m.csv, row 2", "3 fields")


def test_unknown_reflectors(folder: Path) -> None:
    """A row by a reflector missing from the scene, or without a scene, is reported; this was an internal error."""
    (folder / "m.csv").write_text(BEARINGS.replace("\n", ",reflector\n") + "1,a,0,0,0.5,0.1,wall\n")
    assert_refused(folder, ["localize", "m.csv", "-o", "e.csv"], "'wall'", "no scene")
    (folder / "s.toml").write_text('[[reflector]]\nname = "well"\nkind = "line"\npoint = [0, 9]\ndirection = [1, 0]\n')
    assert_refused(folder, ["localize", "m.csv", "--scene", "s.toml", "-o", "e.csv"], "did you mean 'well'")


@pytest.mark.parametrize("value", ["1e160", "-1e308"])
def test_coordinates_with_overflowing_squares(value: str, folder: Path) -> None:
    """Coordinates whose square overflows are reported with row, key or line."""
    (folder / "m.csv").write_text(f"{BEARINGS}1,a,{value},0,0.5,0.1\n")
    assert_refused(folder, ["localize", "m.csv", "-o", "e.csv"], "'sensor_x_m'", "within 1e+15")
    (folder / "s.toml").write_text(f'[[sensor]]\nname = "a"\nposition = [{value}, 0.0]\n')
    assert_refused(folder, ["localize", "m.csv", "--scene", "s.toml", "-o", "e.csv"], "position", "within 1e+15")
    (folder / "p.csv").write_text(f"0,0\n{value},0\n0,5\n")
    ranges = FIXTURES / "good_ranges.csv"
    words = ["localize", ranges, "-m", "mixture-ml", "--field", "polygon:p.csv", "-o", "e.csv"]
    assert_refused(folder, words, "p.csv, line 2", "within 1e+15")


def test_too_small_standard_deviations(folder: Path) -> None:
    """A standard deviation whose inverse square overflows is a bad row."""
    (folder / "m.csv").write_text(f"{BEARINGS}1,a,0,0,0.5,5e-324\n")
    assert_refused(
        folder, ["localize", "m.csv", "-o", "e.csv"], "'bearing_std_rad'", "larger than 0 (at least 1e-15 rad)"
    )


def test_polygons_with_nearly_degenerate_edges(folder: Path) -> None:
    """A nearly level or nearly zero edge of a polygon does not overflow."""
    (folder / "p.csv").write_text("-900,-900\n900.5,0\n900.5,1e-320\n900,1e-320\n-900,900\n")
    ranges = FIXTURES / "good_ranges.csv"
    ending = run_guarded(["localize", ranges, "-m", "mixture-ml", "--field", "polygon:p.csv", "-o", "e.csv", "-q"])
    assert (ending.code, ending.err, ending.raised) == (0, "", "")


ESTIMATES = "snapshot,method,target,alternative,x_m,y_m,cov_xx_m2,cov_xy_m2,cov_yy_m2,n_measurements,n_used,cost,status"
ROW = {"alternative": "0", "truth": "1,1", "id": "7"}


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"alternative": ""}, ["'alternative'", "empty"]),
        ({"truth": "1e20,1"}, ["'truth_x_m'", "got 1e+20", "within 1e+15"]),
        ({"truth": "x,1"}, ["row 1", "'truth_x_m'"]),
    ],
)
def test_corrupted_estimates(changed: dict[str, str], message: list[str], folder: Path) -> None:
    """Missing alternatives, and truth out of range or not numeric, are reported; these were internal errors."""
    row = {**ROW, **changed}
    line = f"{row['id']},ml,0,{row['alternative']},1,1,1,0,1,3,3,0.5,ok,{row['truth']}\n"
    (folder / "e.csv").write_text(f"{ESTIMATES},truth_x_m,truth_y_m\n{line}")
    assert_refused(folder, ["evaluate", "e.csv"], *message)


def test_maps_of_text_positions(folder: Path) -> None:
    """Text in a column of positions is reported by an exporter; this was an internal error."""
    table = ESTIMATES.replace("cost,", "") + "\n7,ml,0,0,1,1&2,1,0,1,3,3,ok\n"
    (folder / "e.csv").write_text(table)
    assert_refused(folder, ["convert", "e.csv", "-o", "e.geojson", "--param", "metres=true"], "'y_m'", "numbers")


@pytest.mark.parametrize("command", ["plot", "evaluate", "convert"])
def test_infinite_estimates(command: str, folder: Path) -> None:
    """An infinite position is reported by plot, evaluate and exporters; this was a warning."""
    (folder / "e.csv").write_text(f"{ESTIMATES},truth_x_m,truth_y_m\n7,ml,0,0,1e308,1,1,0,1,3,3,0.5,ok,1,1\n")
    output = {"plot": ["-o", "p.svg"], "convert": ["-o", "p.geojson", "--param", "metres=true"]}.get(command, [])
    assert_refused(folder, [command, "e.csv", *output], "'x_m'")


def test_times_too_far_apart_for_windows(folder: Path) -> None:
    """Times of a log that no count of microseconds holds are reported; the importer failed."""
    (folder / "u.csv").write_text("time,anchor,range\n0,a,5\n1e308,a,5\n")
    assert_refused(
        folder, ["convert", "u.csv", "--from", "uwb", "-o", "r.csv"], "times from 0 to 1e+308 s, expected seconds"
    )


def test_a_column_without_a_name(folder: Path) -> None:
    """A column named '' beside sensors of the scene is no column of the contract; the reader failed."""
    table = pa.table({"snapshot": [0, 0], "sensor": ["a", "b"], "": [7, 8], "bearing_rad": [0.1, 2.1]})
    with pa.ipc.new_stream(folder / "b.arrows", table.schema) as writer:
        writer.write_table(table)
    scene = "".join(f'[[sensor]]\nname = "{name}"\nposition = [{x}, 0]\n' for name, x in (("a", 0), ("b", 10)))
    (folder / "s.toml").write_text(scene)
    words = ["localize", "b.arrows", "--scene", "s.toml", "--bearing-std-deg", "2", "-o", "e.csv", "-q"]
    assert run_guarded(words).code == 0


def test_path_names_that_are_not_utf8(folder: Path) -> None:
    """Traced paths with names that are not UTF-8 are reported; the importer failed."""
    numbers = {name: [1.0] for name in ("tau", "phi_r", "phi_t", "rx_x", "rx_y", "tx_x", "tx_y")}
    not_utf8 = pa.StringArray.from_buffers(1, pa.py_buffer(bytes([0, 0, 0, 0, 1, 0, 0, 0])), pa.py_buffer(b"\x80"))
    pa.parquet.write_table(pa.table({"rx": not_utf8, "tx": [1], **numbers}), folder / "p.parquet")
    assert_refused(folder, ["convert", "p.parquet", "--from", "sionna", "-o", "o.csv"], "p.parquet, column 'rx'")


def test_integer_parameters_out_of_range(folder: Path) -> None:
    """A parameter of thirty digits is a usage error; the method failed."""
    words = ["localize", FIXTURES / "good_bearings.csv", "-o", "e.csv", "-q", "--param"]
    ending = run_guarded([*words, "max_iterations=" + "9" * 30])
    assert ending.code == 2
    assert list(complaints(ending, folder, [], [])) == []


def test_flags_with_invalid_truth(folder: Path) -> None:
    """A truth of flags other than true or false is a bad row; this was an internal error."""
    flags = "snapshot,sensor,sensor_x_m,sensor_y_m,range_m,range_std_m,truth_los,los,used\n"
    (folder / "f.csv").write_text(f"{flags}1,a,0,0,5,1,true,true,true\n1,b,0,0,5,1,]],true,true\n")
    assert_refused(folder, ["evaluate", "f.csv"], "row 2", "'truth_los'", "']]'")


def test_unknown_compression_in_npz(folder: Path) -> None:
    """Unknown compression in an NPZ file is reported as unreadable; the importer failed."""
    packed = BytesIO()
    with ZipFile(packed, "w") as archive:
        archive.writestr("tau.npy", b"x" * 99)
    for at in (8, packed.getvalue().index(b"PK\x01\x02") + 10):  # the way of packing, in both headers
        packed.seek(at)
        packed.write(b"\x63")
    (folder / "h.npz").write_bytes(packed.getvalue())
    assert_refused(folder, ["convert", "h.npz", "--from", "sionna", "-o", "o.csv"], "h.npz", "not a complete NPZ file")


def test_converting_only_bad_rows(folder: Path) -> None:
    """Converting a file without a good row reports all rows; this was an internal error."""
    (folder / "m.csv").write_bytes(BEARINGS.encode() + b"1,\xff\xfe,0,0,0.5,0.1\n1,\xff\xff,0,0,0.5,0.1\n")
    assert_refused(folder, ["convert", "m.csv", "-o", "c.csv"], "row 1", "row 2", "2 bad rows in all")


def _parts(folder: Path) -> dict[str, bytes]:
    lines = (FIXTURES / "good_bearings.csv").read_text().splitlines(keepends=True)
    (folder / "in").mkdir()
    for place, name in enumerate(("a.csv", "b.csv")):
        (folder / "in" / name).write_text("".join([lines[0], *lines[1 + 24 * place : 25 + 24 * place]]))
    assert run_guarded(PARTED).code == 0
    return {path.name: path.read_bytes() for path in (folder / "out").iterdir()}


def test_changed_records_are_not_trusted(folder: Path) -> None:
    """Counts changed in a manifest are counted again; ``--resume`` used them."""
    whole = _parts(folder)
    manifest = folder / "out" / "_manifest.json"
    tree = json.loads(manifest.read_text())
    tree["parts"][1]["record"]["rows"] += 1
    manifest.write_text(json.dumps(tree))
    assert run_guarded([*PARTED, "--resume"]).code == 0
    assert {path.name: path.read_bytes() for path in (folder / "out").iterdir()} == whole


@pytest.fixture
def samples(folder: Path) -> Iterator[Path]:
    """Run a small experiment and return its file of samples."""
    with without_figures():
        assert run_guarded(CACHED).code == 0
        yield folder / "out" / "shen-table3.samples.parquet"


def test_changed_samples_are_refused(samples: Path, folder: Path) -> None:
    """Changed samples are reported, and drawn again with ``--overwrite``; they were used."""
    figure = (folder / "out" / "shen-table3.parquet").read_bytes()
    whole = samples.read_bytes()
    table = pa.parquet.read_table(samples)
    place = next(place for place, name in enumerate(table.column_names) if name != "condition")
    values = table.column(place).to_pylist()
    values[0] = (values[0] or 0) + 1
    column = pa.array(values, table.schema.field(place).type)
    changed = table.set_column(place, table.schema.field(place), column)
    pa.parquet.write_table(changed.replace_schema_metadata(table.schema.metadata), samples)
    assert_refused(folder, list(CACHED[:-2]), "shen-table3.samples.parquet", "damaged", "--overwrite")
    assert run_guarded([*CACHED, "--overwrite"]).code == 0
    assert samples.read_bytes() == whole
    assert (folder / "out" / "shen-table3.parquet").read_bytes() == figure


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_signals_while_arguments_are_parsed(number: int, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The exit code names the signal even while arguments are parsed; it was 130 for all."""

    class SlowWord(str):
        """An argument at whose parsing the signal comes."""

        __slots__ = ()

        def __len__(self) -> int:
            os.kill(os.getpid(), number)
            time.sleep(1.0)
            return super().__len__()

    monkeypatch.setattr("sys.argv", ["nlosctl", SlowWord("schema")])
    before = {other: signal.getsignal(other) for other in (signal.SIGTERM, signal.SIGHUP)}
    try:
        assert main.run() == 128 + number
    finally:
        for other, handler in before.items():
            signal.signal(other, handler)
