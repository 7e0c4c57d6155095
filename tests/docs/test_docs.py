"""The documents name what there is, and lead to what is there."""

from __future__ import annotations

import importlib
import json
import re
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import typer.main
import yaml
from doc_pages import run_shell

from nlosctl import registry
from nlosctl.cli.main import app
from nlosctl.cli.main import run as run_program
from nlosctl.cli.shared.papers import papers_of
from nlosctl.contract.statuses import Status
from nlosctl.scenarios.catalogue import scenarios
from nlosctl.version import __version__

ROOT = Path(__file__).parents[2]
WRITTEN = [path for path in sorted((ROOT / "docs").rglob("*.md")) if path.name != "commands.md"]  # that is generated
DOCUMENTS = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *WRITTEN]
PROGRAM = typer.main.get_command(app)


def commands(command: Any = PROGRAM, name: str = "nlosctl") -> Iterator[tuple[str, Any]]:
    """Yield every command by its full name, groups too."""
    yield name, command
    for word, inner in getattr(command, "commands", {}).items():
        yield from commands(inner, f"{name} {word}")


COMMANDS = dict(commands())
OPTIONS = [(name, option) for name, command in COMMANDS.items() for option in command.params]


def all_text() -> str:
    """Return all documents as one text."""
    return "\n".join(path.read_text(encoding="utf-8") for path in DOCUMENTS)


@pytest.mark.parametrize("word", [name.split()[-1] for name in COMMANDS if name != "nlosctl"])
def test_every_command_is_in_the_documents(word: str) -> None:
    """README or docs mention every command there is, as code."""
    assert re.search(rf"`[^`\n]*\b{word}\b[^`\n]*`|^    .*\bnlosctl .*\b{word}\b", all_text(), re.MULTILINE)


def test_the_readme_lists_the_commands() -> None:
    """The README's table of commands has each command, and none that there is not."""
    table = re.search(r"\| command \| job \|\n\|.*\n((?:\|.*\n)+)", (ROOT / "README.md").read_text(encoding="utf-8"))
    assert table is not None
    listed = re.findall(r"^\| `([\w-]+)`", table[1], re.MULTILINE)
    assert sorted(listed) == sorted(PROGRAM.commands)  # type: ignore[attr-defined]


def test_every_built_in_method_is_in_the_readme() -> None:
    """The README tells every built-in method, and when to use it."""
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    built_in = [entry.name for entry in registry.entries() if entry.distribution == "nlosctl"]
    assert [name for name in built_in if f"| `{name}` |" not in text] == []


@pytest.mark.parametrize(("name", "option"), OPTIONS, ids=lambda value: getattr(value, "name", value))
def test_every_option_has_help(name: str, option: Any) -> None:
    """Every option and argument of every command says what it does."""
    text = getattr(option, "help", None)
    assert text, f"{name}: {option.name} has no help"
    assert text[0].isupper() or text.startswith("-")
    assert text.rstrip()[-1] in ".)", f"{name}: {option.name}: {text!r} is no sentence"


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_says_what_it_does(name: str) -> None:
    """Every command has a text that begins with its job."""
    assert COMMANDS[name].help


@pytest.mark.parametrize("name", [name for name, command in COMMANDS.items() if command.callback and name != "nlosctl"])
def test_every_command_that_tells_has_json(name: str) -> None:
    """``--json`` is on every command that tells something; one that writes a file has ``--output`` instead."""
    words = [word for option in COMMANDS[name].params for word in option.opts]
    assert "--json" in words or "--output" in words
    assert "--output" not in words or "--json" in words or {"--report", "--format"} & set(words)


@pytest.mark.parametrize("name", [name for name, command in COMMANDS.items() if not hasattr(command, "commands")])
def test_every_command_has_debug(name: str) -> None:
    """``--debug`` is on every command, and ``--quiet`` on each that takes settings from a config file."""
    words = [word for option in COMMANDS[name].params for word in option.opts]
    assert "--debug" in words
    assert ("--quiet" in words) == ("--config" in words) or name == "nlosctl config show"


def test_an_option_means_the_same_everywhere() -> None:
    """An option that several commands have has one help text and short form; ``--alternatives`` has two jobs.

    ``reproduce`` writes a folder, and its trials are of each condition; ``plot`` writes a picture.
    """
    known: dict[str, tuple[str, tuple[str, ...], str]] = {}
    for name, option in OPTIONS:
        if name == "nlosctl" or not option.opts[0].startswith("--") or option.name == "alternatives":
            continue
        own = {"nlosctl reproduce": ("output", "trials"), "nlosctl plot": ("output", "format")}
        if option.name in own.get(name, ()):
            continue
        told = (option.help, tuple(option.opts))
        first = known.setdefault(option.opts[0], (*told, name))
        assert told == first[:2], f"{option.opts[0]}: {name} and {first[2]} differ"


def links(path: Path) -> list[str]:
    """Return the links of a document that point into the repository."""
    found = re.findall(r"\[[^\]]*\]\(([^)\s]+)\)", path.read_text(encoding="utf-8"))
    return [link for link in found if not re.match(r"[a-z]+:", link)]


@pytest.mark.parametrize("path", DOCUMENTS, ids=lambda path: path.name)
def test_links_point_at_what_is_there(path: Path) -> None:
    """Every link into the repository has its file, and its heading where it names one."""
    for link in links(path):
        target, _, heading = link.partition("#")
        file = (path.parent / target) if target else path
        assert file.exists(), f"{path.name}: {link}"
        if heading:
            headings = re.findall(r"^#+ (.+)$", file.read_text(encoding="utf-8"), re.MULTILINE)
            assert heading in [re.sub(r"[^\w\- ]", "", text.lower()).replace(" ", "-") for text in headings]


def test_there_are_links_to_check() -> None:
    """The README leads to the conventions, the architecture and how to write a method."""
    assert {"docs/conventions.md", "docs/architecture.md", "docs/writing-a-method.md"} <= set(links(ROOT / "README.md"))


@pytest.mark.parametrize("status", Status, ids=lambda status: status.word)
def test_every_status_is_in_the_conventions(status: Status) -> None:
    """docs/conventions.md lists each status word with the meaning that the code has, and what is null."""
    text = (ROOT / "docs" / "conventions.md").read_text(encoding="utf-8")
    row = re.search(rf"^\| `{status.word}` \| (.+) \| (\w+) \| (.+) \|$", text, re.MULTILINE)
    assert row is not None
    meaning = re.sub(r" \([^)]*\)", "", row[1])
    assert status.meaning.startswith(meaning)
    assert (row[2] == "yes") == status.has_position
    assert (row[3] != "null") == status.has_covariance


def examples() -> list[tuple[str, str]]:
    """Return every command line that stands in a code block of a document."""
    lines = []
    for path in DOCUMENTS:
        text = path.read_text(encoding="utf-8").replace("\\\n", " ")
        for line in re.findall(r"^(?:    |\$ )(nlosctl .+)$", text, re.MULTILINE):
            lines += [(path.name, part.strip()) for part in line.split(" | ") if part.strip().startswith("nlosctl")]
    return lines


@pytest.mark.parametrize(("document", "line"), examples())
def test_examples_use_options_there_are(document: str, line: str) -> None:
    """Every command line in the documents names a command and options that exist."""
    words = line.split("#")[0].split()
    name = "nlosctl"
    for word in words[1:]:
        name = f"{name} {word}" if f"{name} {word}" in COMMANDS else name
    named = [name, *(f"nlosctl {word}" for word in words[3:4] if name == "nlosctl config show")]
    parameters = [parameter for each in named if each in COMMANDS for parameter in COMMANDS[each].params]
    known = {option for parameter in parameters for option in (*parameter.opts, *parameter.secondary_opts)}
    given = [word.partition("=")[0] for word in words if re.match(r"--?[a-zA-Z]", word)]
    assert name != "nlosctl" or not [word for word in words[1:] if not word.startswith("-")], f"{document}: {line}"
    assert [word for word in given if word not in known | {"--help", "-h"}] == [], f"{document}: {line}"


def test_the_readmes_small_file_is_solved(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsysbinary: pytest.CaptureFixture[bytes]
) -> None:
    """The little table in the README is a good file."""
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    block = re.search(r"^    snapshot,.*\n(?:    .*\n)+", text, re.MULTILINE)
    assert block is not None
    monkeypatch.chdir(tmp_path)
    Path("m.csv").write_text(re.sub(r"^    ", "", block[0], flags=re.MULTILINE))
    assert run_program(["localize", "m.csv", "-q"]) == 0
    assert b",ok" in capsysbinary.readouterr().out


def test_references_of_methods_are_in_the_bibliography() -> None:
    """docs/references.bib is there and names the authors that methods and scenarios refer to."""
    text = (ROOT / "docs" / "references.bib").read_text(encoding="utf-8").lower()
    built_in = [entry for entry in registry.entries() if entry.distribution == "nlosctl"]
    references = [registry.load(entry).reference for entry in built_in]
    references += [spec.reference for spec in scenarios().values() if spec.reference != "generic"]
    authors = {reference.split(",")[0].split()[0].lower() for reference in references}
    assert [author for author in authors if author not in text] == []


def test_the_bibliography_is_whole() -> None:
    """Every entry of docs/references.bib ends with its brace before the next begins, and has a title and authors."""
    entries = re.split(r"^@", (ROOT / "docs" / "references.bib").read_text(encoding="utf-8"), flags=re.MULTILINE)[1:]
    assert len(entries) > 5
    for entry in entries:
        assert entry.count("{") == entry.count("}"), entry
        assert entry.rstrip().endswith("}")
        assert re.search(r"^  author +=", entry, re.MULTILINE)
        assert re.search(r"^  title +=", entry, re.MULTILINE)


@pytest.mark.parametrize("entry", [one for one in registry.entries() if one.distribution == "nlosctl"], ids=str)
def test_every_method_names_its_paper_and_place(entry: registry.MethodEntry) -> None:
    """``methods show`` tells the paper in full, and the section or equation in it."""
    reference = registry.load(entry).reference
    assert papers_of(reference)
    assert re.search(r"equations? \(\d+\)|[Ss]ections? [IVX\d]|Algorithm \d", reference)
    plain = re.sub(r"[{}]", "", (ROOT / "docs" / "references.bib").read_text(encoding="utf-8"))
    for paper in papers_of(reference):
        title = paper.split(", ")[1:]
        assert any(part in plain for part in title if len(part) > 20), paper


def test_the_citation_file_is_that_of_this_version() -> None:
    """CITATION.cff names the version, the licence and the entity that wrote it."""
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert citation["cff-version"] == "1.2.0"
    assert {"message", "title", "authors"} <= citation.keys()
    assert citation["authors"] == [{"name": "The nlosctl developers"}]
    assert (citation["version"], citation["license"]) == (__version__, project["license"])


def test_the_changelog_tells_this_version() -> None:
    """The changelog has the version that the package has, or what is unreleased."""
    from nlosctl import __version__

    text = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    assert f"## [{__version__}]" in text or "## [Unreleased]" in text


def test_the_installed_program_is_there() -> None:
    """The entry point of pyproject.toml names a function that there is."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    module, _, function = project["scripts"]["nlosctl"].partition(":")
    assert callable(getattr(importlib.import_module(module), function))


def readme_block(begin: str) -> str:
    """Return an indented block of the README from the line that begins so."""
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    block = re.search(rf"^    {begin}(?:.*\n    )*.*\n", text, re.MULTILINE)
    assert block is not None
    return re.sub(r"^    ", "", block[0], flags=re.MULTILINE)


def test_a_users_own_file_becomes_positions_on_earth(tmp_path: Path) -> None:
    """With the README's line alone a log with headers of its own, compass bearings and places on earth is solved."""
    rows = ["Time,Station,Lat,Lon,Bearing,Quality"]
    for time, turn in (("2026-05-01 10:00:00", 0.0), ("2026-05-01 10:00:10", 1.0)):
        for name, place, azimuth in (
            ("Alpha", "47.3700,8.5400", 110.2),
            ("Bravo", "47.4000,8.6000", 198.8),
            ("Charlie", "47.3300,8.6200", 317.8),
        ):
            rows.append(f"{time},{name},{place},{azimuth + turn},85")
    (tmp_path / "drive.csv").write_text("\n".join(rows) + "\n")
    line = readme_block("nlosctl localize drive.csv --column sensor=Station")
    done = run_shell(line, tmp_path)
    assert done.returncode == 0, done.stderr
    features = json.loads((tmp_path / "fixes.geojson").read_text())["features"]
    points = [one for one in features if one["geometry"]["type"] == "Point"]
    assert [point["properties"]["status"] for point in points] == ["ok", "ok"]
    assert points[0]["geometry"]["coordinates"] == pytest.approx([8.58, 47.36], abs=0.002)


def test_the_readmes_pipeline_runs(tmp_path: Path) -> None:
    """The pipeline on the README's first screen ends with 0 as it stands."""
    done = run_shell(readme_block("nlosctl simulate ring"), tmp_path)
    assert done.returncode == 0, done.stderr
    assert len(done.stdout.splitlines()) == 4
