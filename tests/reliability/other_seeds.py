"""Seed files other than tables of measurements: logs of other programs, estimates, polygons, manifests, caches."""

from __future__ import annotations

import io
import os
import shutil
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, redirect_stdout
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet
from guarded_run import run_guarded
from seed_files import FIXTURES, SeedFile

from nlosctl.io.parts.run_folder import RunFolder
from nlosctl.reproduce.store import SampleStore

__all__ = ["CACHED", "PARTED", "expected_folder", "other_seeds", "without_figures"]

PARTED = ("localize", "in", "--scene", str(FIXTURES / "good_bearings.scene.toml"), "-o", "out/", "-q", "--jobs", "1")
CACHED = ("reproduce", "shen-table3", "-n", "20", "-o", "out", "-q", "--json")
_LOGS = {
    "kraken-csv": ("kraken_app.csv", ("bearing_std_deg=3",)),
    "kraken-xml": ("df_aggregator.xml", ("bearing_std_deg=3",)),
    "uudf": ("u_connect_locate.log", ("bearing_std_deg=3",)),
    "anchor-azimuths": ("anchor_azimuths.csv", ("bearing_std_deg=3", "tag=tag")),
    "uwb": ("uwb_ranges.csv", ("variance=variance",)),
    "wildlife": ("bear_bearings.csv", ("bearing_std_deg=3",)),
    "sionna": ("sionna_paths.npz", ("bearing_std_deg=3", "range_std_m=0.3")),
}
_POLYGON = b"# a field\nx_m,y_m\n-900.0,-900.0\n900.5,-900\n900,900 # a corner\n-9e2,900\n"


def other_seeds() -> Iterator[SeedFile]:
    """Yield the seeds of the targets import, estimates, polygon, manifest and cache."""
    yield from _logs()
    yield SeedFile(target="polygon", kind="ranges", job="localize", name="p.csv", content=_POLYGON)
    with _empty_folder() as folder:
        yield from _estimates(folder)
    with _empty_folder() as folder:
        yield from _parts(folder)
    with _empty_folder() as folder:
        yield from _cache(folder)


def _logs() -> Iterator[SeedFile]:
    for importer, (name, parameters) in _LOGS.items():
        content = (FIXTURES / "formats" / name).read_bytes()
        scene = FIXTURES / "formats" / f"{Path(name).stem}.scene.toml"
        beside = ((scene.name, scene.read_bytes()),) if scene.exists() else ()
        form: dict[str, Any] = {"kind": importer, "job": "convert", "parameters": parameters}
        yield SeedFile(target="import", name=name, content=content, beside=beside, **form)
        if beside:
            log = ((name, content),)
            yield SeedFile(target="scene", name=scene.name, content=scene.read_bytes(), beside=log, **form)
        if importer == "sionna":
            yield SeedFile(target="import", name="paths.parquet", content=_traced(), **form)


def _traced() -> bytes:
    table = pa.table(
        {
            "rx": ["a", "a", "b", "b"],
            "tx": [7, 7, 7, 8],
            "tau": np.array([5.0, 7.0, 5.0, 6.0]) / 299792458.0,
            "phi_r": [np.arctan2(4.0, 3.0), np.pi / 2, 0.5, 1.5],
            "phi_t": [0.1, 3.1, -2.0, 0.0],
            "rx_x": [0.0, 0.0, 1.0, 1.0],
            "rx_y": [0.0] * 4,
            "tx_x": [3.0, 3.0, 3.0, 9.0],
            "tx_y": [4.0] * 4,
            "interactions": [0, 1, 1, 2],
            "vertex_x": [0.0] * 4,
            "vertex_y": [4.0] * 4,
        }
    )
    sink = io.BytesIO()
    pa.parquet.write_table(table, sink)
    return sink.getvalue()


def _estimates(folder: Path) -> Iterator[SeedFile]:
    """Yield outputs of the program that evaluate, plot and convert read."""
    table = "".join((FIXTURES / "good_bearings.csv").read_text().splitlines(keepends=True)[:60])
    (folder / "m.csv").write_text(table)
    scene = ("--scene", str(FIXTURES / "good_bearings.scene.toml"))
    lines = {
        "estimates": ("localize", "m.csv", "-m", "ml", "-m", "ls", *scene),
        "flags": ("identify-los", str(FIXTURES / "good_echoes.csv")),
        "bound": ("bound", "m.csv", *scene),
    }
    for kind, line in lines.items():
        for name in ("plain.csv", "plain.parquet", "plain.arrow", "zipped.jsonl.gz"):
            _run([*line, "-o", f"{kind}-{name}", "-q"])
            content = (folder / f"{kind}-{name}").read_bytes()
            yield SeedFile(target="estimates", kind=kind, job="evaluate", name=name, content=content)


def _parts(folder: Path) -> Iterator[SeedFile]:
    """Yield the manifest of a run into a folder, and the plan and the records of one that was interrupted."""
    lines = (FIXTURES / "good_bearings.csv").read_text().splitlines(keepends=True)
    (folder / "in").mkdir()
    for place, name in enumerate(("a.csv", "b.csv", "c.csv")):
        (folder / "in" / name).write_text("".join([lines[0], *lines[1 + 24 * place : 25 + 24 * place]]))
    for path in (folder / "in").iterdir():
        os.utime(path, ns=(10**18, 10**18))
    _run(PARTED)
    yield from _each_of(folder, ["out/_manifest.json"], PARTED)
    shutil.rmtree(folder / "out")
    with _stopped_before_joining(RunFolder):
        _run(PARTED)
    (folder / "out" / "_unfinished" / "000002.json").unlink()
    yield from _each_of(folder, ["out/_unfinished/plan.json", "out/_unfinished/000001.json"], PARTED)


def _cache(folder: Path) -> Iterator[SeedFile]:
    with without_figures():
        _run(CACHED)
        yield from _each_of(folder, ["out/shen-table3.samples.parquet"], CACHED)
        shutil.rmtree(folder / "out")
        with _stopped_before_joining(SampleStore):
            _run(CACHED)
    (folder / "out" / "shen-table3.parquet").unlink()
    yield from _each_of(folder, ["out/shen-table3.parts/0000-00000.parquet"], CACHED)


@cache
def expected_folder(target: str) -> dict[str, bytes]:
    """Return the files in ``out`` after a successful run of the target manifest or cache."""
    with _empty_folder() as folder:
        (file, *_) = list(_parts(folder) if target == "manifest" else _cache(folder))
    return {name: content for name, content in (*file.beside, (file.name, file.content)) if name.startswith("out/")}


def _each_of(folder: Path, names: Sequence[str], line: Sequence[str]) -> Iterator[SeedFile]:
    target = "cache" if line is CACHED else "manifest"
    files = {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    for name in names:
        beside = tuple((other, content) for other, content in files.items() if other != name)
        yield SeedFile(target=target, kind=Path(name).stem, job=line[0], name=name, content=files[name], beside=beside)


@contextmanager
def _stopped_before_joining(keeper: Any) -> Iterator[None]:
    """Stop a run after all its parts are kept, before they are joined."""
    finish, keeper.finish = keeper.finish, lambda *_: None
    try:
        yield
    finally:
        keeper.finish = finish


@contextmanager
def without_figures() -> Iterator[None]:
    """Skip the figures, which take most of the time of a small experiment."""
    from nlosctl.reproduce import run

    draw, run._pictures = run._pictures, lambda *_: []
    try:
        yield
    finally:
        run._pictures = draw


@contextmanager
def _empty_folder() -> Iterator[Path]:
    before = Path.cwd()
    with tempfile.TemporaryDirectory() as name:
        os.chdir(name)
        try:
            yield Path(name)
        finally:
            os.chdir(before)


def _run(words: Sequence[str]) -> None:
    with redirect_stdout(io.StringIO()):
        ending = run_guarded(words, seconds=60)
    assert ending.code == 0, ending
