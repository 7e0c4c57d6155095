"""Every option, command and method that a message names exists, on the command that prints it."""

from __future__ import annotations

import ast
import dataclasses
import logging
import re
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

import pytest
import typer
from cli_support import Outcome

from nlosctl import registry
from nlosctl.cli.main import app
from nlosctl.cli.options.settings import options_of, with_flags
from nlosctl.contract.batches import BearingBatch

Cli = Callable[..., Outcome]

PACKAGE = Path(__file__).parents[2] / "nlosctl"
COMMANDS: dict[str, Any] = typer.main.get_command(app).commands  # type: ignore[attr-defined]
FLAGS = {name: {"help", *options_of(command)} for name, command in COMMANDS.items() if not hasattr(command, "commands")}
GROUPED = {name: command for name, command in COMMANDS.items() if hasattr(command, "commands")}
FLAGS |= {
    name: {"help"}.union(*(options_of(command) for command in [group, *group.commands.values()]))
    for name, group in GROUPED.items()
}
OTHER_PROGRAMS = ("mlr ", "pytest ", "duckdb ")
OF_OTHER_COMMANDS = {"schema": {"add"}}
"""Options of other commands: the table of a command states by which of them a column is requested."""


@cache
def texts(path: Path) -> list[tuple[int, str]]:
    """The texts of a module that may be printed: constants without docstrings, f-strings without their values."""
    return list(_texts(path))


def _texts(path: Path) -> Iterator[tuple[int, str]]:
    tree = ast.parse(path.read_text(encoding="utf-8"))
    documented = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    parts = {id(value) for node in ast.walk(tree) if isinstance(node, ast.JoinedStr) for value in node.values}
    for node in ast.walk(tree):
        if isinstance(node, ast.JoinedStr):
            yield node.lineno, "".join(str(v.value) if isinstance(v, ast.Constant) else "X" for v in node.values)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in documented | parts:
            yield node.lineno, node.value


def named_flags(text: str) -> list[tuple[str, str]]:
    """The flags in a printed text, each with the last command before it, empty without one."""
    named = []
    for match in re.finditer(r"(?<![\w-])--([a-z][a-z0-9-]+)", text):
        commands = re.findall("|".join(rf"(?<![\w-]){name}(?![\w-])" for name in FLAGS), text[: match.start()])
        named.append((match[1], commands[-1] if commands else ""))
    return named


@pytest.mark.parametrize("path", sorted((PACKAGE / "cli" / "commands").glob("*.py")), ids=lambda path: path.stem)
def test_commands_name_their_own_options(path: Path) -> None:
    """An option in a text of a command is one of this command, or of the command that the text names."""
    own = {"solve": ("localize", "detect-ip", "identify-los")}.get(path.stem, (path.stem,))
    for line, text in texts(path):
        for flag, command in named_flags(text):
            names = (*own, command) if command else own
            known = OF_OTHER_COMMANDS.get(path.stem, set()).union(*(FLAGS.get(name, set()) for name in names))
            assert flag in known, f"{path.name}:{line}: --{flag} in {text!r}"


def test_settings_and_options_in_messages_exist() -> None:
    """A setting in backquotes, as lower layers name it, becomes an option of some command; a literal one is one."""
    everywhere = set().union(*FLAGS.values()) | {"version", "install-completion", "show-completion"}
    count = 0
    for path in PACKAGE.rglob("*.py"):
        if {"testing", "reproduce", "api"} & set(path.parts):
            continue
        for line, text in texts(path):
            if any(program in text for program in OTHER_PROGRAMS):
                continue
            for flag, _ in named_flags(with_flags(text.replace("`float`", "").replace("--no-ranges", ""))):
                count += 1
                assert flag in everywhere, f"{path}:{line}: --{flag} in {text!r}"
    assert count > 100


def test_methods_in_messages_exist() -> None:
    """A method that a message advises is registered."""
    known = {entry.name for entry in registry.entries()}
    for path in PACKAGE.rglob("*.py"):
        for line, text in texts(path):
            for name in re.findall(r"try `method` ([a-z-]+)", text):
                assert name in known, f"{path}:{line}: {name}"


def test_estimates_list_the_extensions_of_maps(cli: Cli) -> None:
    """An unknown extension of estimates lists those of maps; of measurements, which no map takes, it does not."""
    drawn = cli("simulate", "ring", "-n", 2, "-q", "--format", "csv").out
    message = cli("localize", "-", "-o", "x.gpkg", stdin=drawn).err
    assert all(extension in message for extension in (".parquet", ".geojson", ".kml", ".czml", ".geoparquet"))
    assert ".kml" not in cli("simulate", "ring", "-n", 2, "-o", "x.gpkg").err


def test_metres_as_geojson(cli: Cli) -> None:
    """The hint on a map of plain metres works where it says."""
    drawn = cli("simulate", "ring", "-n", 2, "-q", "--format", "csv").out
    outcome = cli("localize", "-", "-o", "x.geojson", stdin=drawn)
    assert "convert also writes plain metres as geojson, with --param metres=true" in outcome.err
    assert cli("localize", "-", "-q", "-o", "e.csv", stdin=drawn).code == 0
    assert cli("convert", "e.csv", "-o", "x.geojson", "--param", "metres=true").code == 0


def test_evaluate_notes_options_without_effect(cli: Cli) -> None:
    """``--alternatives`` with flags and ``--ospa-*`` without targets are noted; with effect they are not."""
    drawn = cli("simulate", "ring", "-n", 20, "-q", "--format", "csv").out
    words = ("localize", "-", "-q", "-m", "mixture-ml", "-o", "e.csv", "--flags-out", "f.csv")
    assert cli(*words, stdin=drawn).code == 0
    assert "no effect on estimates: --ospa-order, --ospa-cutoff-m" in cli(
        "evaluate", "e.csv", "--ospa-order", 1, "--ospa-cutoff-m", 5
    ).err  # fmt: skip
    assert "no effect on flags: --alternatives best" in cli("evaluate", "f.csv", "--alternatives", "best").err
    assert "no effect" not in cli("evaluate", "e.csv", "--alternatives", "best").err


def test_the_report_has_version_and_settings(cli: Cli, tmp_path: Path) -> None:
    """``--report`` records the version of the program, the methods with their parameters, and the seed."""
    drawn = cli("simulate", "ring", "-n", 2, "-q", "--format", "csv").out
    report = cli("localize", "-", "-q", "--seed", 7, "-o", "e.csv", "--report", "r.json", stdin=drawn)
    assert report.code == 0
    import json

    content = json.loads((tmp_path / "r.json").read_text())
    assert content["version"]
    assert content["settings"]["seed"] == 7
    assert content["settings"]["methods"][0]["name"] == "bearings.ml"


def test_the_page_lists_the_arrays_of_a_batch() -> None:
    """docs/writing-a-method.md names every field of `BearingBatch`."""
    page = (PACKAGE.parent / "docs" / "writing-a-method.md").read_text(encoding="utf-8")
    assert [field.name for field in dataclasses.fields(BearingBatch) if f"`{field.name}`" not in page] == []


@pytest.mark.parametrize("on_earth", [False, True])
def test_the_preview_fits_80_columns(capsys: pytest.CaptureFixture[str], on_earth: bool) -> None:
    """Northings, ellipse, rows used and status of an estimate stand on one line of 80 columns."""
    import pyarrow as pa

    from nlosctl.cli.terminal import Preview

    row = {"snapshot": "2024-06-10 06:13:19", "method": "ml", "target": 0, "alternative": 0, "x_m": 533987.25}
    row |= {"y_m": 5172222.5, "cov_xx_m2": 9.0, "cov_xy_m2": 0.0, "cov_yy_m2": 4.0, "n_measurements": 4, "n_used": 3}
    row |= {"used_share": 0.75, "cost": 1.0, "fit_p_value": 0.5, "status": "outside_field"}
    if on_earth:
        row |= {"lat_deg": 47.3800001, "lon_deg": 8.56, "frame": "47 8"}
    preview = Preview()
    preview.write(pa.Table.from_pylist([row]))
    preview.show()
    lines = capsys.readouterr().out.rstrip().splitlines()
    assert max(map(len, lines)) <= 78
    place = ("47.380000", "8.560000") if on_earth else ("533987.25", "5172222.50")
    assert all(word in lines[1] for word in (*place, "7.34 x 4.9", "3/4", "outside_field"))


def test_matplotlib_does_not_warn_about_its_cache() -> None:
    """Warnings of matplotlib on where it caches fonts are not printed."""
    pytest.importorskip("matplotlib")
    import nlosctl.plotting.library  # noqa: F401

    assert logging.getLogger("matplotlib").getEffectiveLevel() == logging.ERROR
