"""Arguments of the run on a corrupted file, by target: its own job, or another command that reads it."""

from __future__ import annotations

import random
from collections.abc import Callable
from importlib.util import find_spec

from other_seeds import CACHED, PARTED
from seed_files import FIXTURES, SeedFile

__all__ = ["Words", "words_of"]

Words = tuple[tuple[str, ...], tuple[str, ...]]
"""The arguments of a run, and the files that it writes."""

_METHODS = {
    "bearings": ("ls", "stansfield", "mixture-ml", "suppress", "sequential", "stansfield-focused"),
    "ranges": ("ml", "sr-ls", "r-ls", "mixture-ml"),
    "triplets": ("chi2", "ml", "joint", "tdaj"),
    "echoes": ("assignment",),
    "horizon": ("ls", "stansfield", "ml"),
}
_ON_EARTH = ("--origin", "47.4,8.5") if find_spec("pyproj") else ("--param", "metres=true")


def words_of(file: SeedFile, chance: random.Random) -> Words:
    """Return the arguments of the run on a file."""
    return _WAYS.get(file.target, _of_table)(file, chance)


def _of_table(file: SeedFile, chance: random.Random) -> Words:
    share = chance.random()
    scene = ("--scene", str(FIXTURES / "good_over_the_horizon.scene.toml")) if file.kind == "horizon" else ()
    if share < 0.10:
        return ("validate", file.name, "-q", *scene), ()
    if share < 0.16 and file.job == "localize":
        return ("bound", file.name, "-o", "b.csv", "-q", *scene), ("b.csv",)
    if share < 0.20:
        return ("evaluate", file.name, "-q"), ()
    if share < 0.28:
        output = chance.choice(("f.arrow", "f.arrow", "c.parquet", "c.csv.gz", "c.jsonl"))
        return ("convert", file.name, "-o", output, "-q", *scene), (output,)
    if share < 0.285:
        return ("plot", file.name, "-o", "p.svg", "-q", *scene), ("p.svg",)
    aside = ("--bad-rows", "bad.arrow") if share > 0.6 else ()
    method = ("-m", chance.choice(_METHODS[file.kind])) if chance.random() < 0.5 else ()
    tables = ("-o", "e.arrow", "--flags-out", "f.arrow") if file.job == "localize" else ("-o", "f.arrow")
    if file.job != "localize" and share > 0.8:
        tables = (*tables, "--estimates-out", "e.arrow")
    words = (file.job, file.name, *method, *tables, "-q", "--jobs", "1", *scene, *aside)
    return words, tuple(word for word in words if word.endswith(".arrow") and word != file.name)


def _of_scene(file: SeedFile, chance: random.Random) -> Words:
    if file.job == "convert":
        return _imported(file, chance)
    table = {"bearings": "good_bearings.csv", "horizon": "good_over_the_horizon.csv"}[file.kind]
    return ("localize", str(FIXTURES / table), "--scene", file.name, "-o", "e.csv", "-q", "--jobs", "1"), ("e.csv",)


def _of_config(file: SeedFile, chance: random.Random) -> Words:
    table = str(FIXTURES / "good_bearings.csv")
    return ("localize", table, "--config", file.name, "-o", "e.csv", "-q", "--jobs", "1"), ("e.csv",)


def _of_polygon(file: SeedFile, chance: random.Random) -> Words:
    table = str(FIXTURES / "good_ranges.csv")
    words = ("localize", table, "-m", "mixture-ml", "--field", f"polygon:{file.name}", "--jobs", "1")
    return (*words, "-o", "e.csv", "-q"), ("e.csv",)


def _imported(file: SeedFile, chance: random.Random) -> Words:
    """Return the arguments of an import, sometimes with a window, bad lines set aside, or other parameters."""
    log = file.name if file.target == "import" else file.beside[0][0]
    parameters = [word for parameter in file.parameters for word in ("--param", parameter)]
    if file.kind == "sionna" and chance.random() < 0.4:
        parameters += ["--param", "kind=triplets", "--param", "target=0,4.2"]
    elif file.kind not in ("sionna", "wildlife") and chance.random() < 0.3:
        parameters += ["--window", chance.choice(("0.1s", "2min", "all", "1e-6us"))]
    aside = ("--bad-rows", "bad.arrow") if chance.random() < 0.4 else ()
    words = ("convert", log, "--from", file.kind, *parameters, "-o", "o.arrow", "-q", *aside)
    return words, tuple(word for word in words if word.endswith(".arrow"))


def _of_estimates(file: SeedFile, chance: random.Random) -> Words:
    share = chance.random()
    if share < 0.4:
        return ("evaluate", file.name, "-q", "--json"), ()
    if share < 0.5:
        output = chance.choice(("c.parquet", "c.csv", "c.arrow", "c.jsonl.gz"))
        return ("convert", file.name, "-o", output, "-q"), (output,)
    if share < 0.53:
        return ("plot", file.name, "-o", "p.svg", "-q"), ("p.svg",)
    output = chance.choice(("o.geojson", "o.geojson", "o.kml", "o.czml", "o.geoparquet"))
    return ("convert", file.name, "-o", output, "-q", *_ON_EARTH), (output,)


def _of_manifest(file: SeedFile, chance: random.Random) -> Words:
    return (*PARTED, *chance.choice((("--resume",), ("--resume",), ("--overwrite",), ()))), ()


def _of_cache(file: SeedFile, chance: random.Random) -> Words:
    return (*CACHED, *(("--overwrite",) if chance.random() < 0.4 else ())), ()


_WAYS: dict[str, Callable[[SeedFile, random.Random], Words]] = {
    "scene": _of_scene,
    "config": _of_config,
    "polygon": _of_polygon,
    "import": _imported,
    "estimates": _of_estimates,
    "manifest": _of_manifest,
    "cache": _of_cache,
}
