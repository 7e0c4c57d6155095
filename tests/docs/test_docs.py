"""The pages: every command, option, status, paper and link that they name exists, and none is missing."""

from __future__ import annotations

import importlib
import re
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import typer.main
import yaml

from nlosctl import registry
from nlosctl.cli.commands.methods import papers_of
from nlosctl.cli.main import app
from nlosctl.contract.statuses import Status
from nlosctl.scenarios.catalogue import scenarios
from nlosctl.version import __version__

ROOT = Path(__file__).parents[2]
WRITTEN = [path for path in sorted((ROOT / "docs").rglob("*.md")) if path.name != "commands.md"]
DOCUMENTS = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *WRITTEN]
PROGRAM = typer.main.get_command(app)


def commands(command: Any = PROGRAM, name: str = "nlosctl") -> Iterator[tuple[str, Any]]:
    """Yield every command with its full name, groups included."""
    yield name, command
    for word, inner in getattr(command, "commands", {}).items():
        yield from commands(inner, f"{name} {word}")


COMMANDS = dict(commands())
OPTIONS = [(name, option) for name, command in COMMANDS.items() for option in command.params]


def all_text() -> str:
    """All pages as one text."""
    return "\n".join(path.read_text(encoding="utf-8") for path in DOCUMENTS)


@pytest.mark.parametrize("word", [name.split()[-1] for name in COMMANDS if name != "nlosctl"])
def test_every_command_is_in_the_documents(word: str) -> None:
    """README or docs mention every command, as code."""
    assert re.search(rf"`[^`\n]*\b{word}\b[^`\n]*`|^.*\bnlosctl .*\b{word}\b", all_text(), re.MULTILINE)


@pytest.mark.parametrize(("name", "option"), OPTIONS, ids=lambda value: getattr(value, "name", value))
def test_every_option_has_help(name: str, option: Any) -> None:
    """Every option and argument of every command has help that begins with a capital and ends with a stop."""
    text = getattr(option, "help", None)
    assert text, f"{name}: {option.name} has no help"
    assert text[0].isupper() or text.startswith("-")
    assert text.rstrip()[-1] in ".)", f"{name}: {option.name}: {text!r} is not a sentence"


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_has_help(name: str) -> None:
    """Every command has a help text."""
    assert COMMANDS[name].help


@pytest.mark.parametrize("name", [name for name, command in COMMANDS.items() if command.callback and name != "nlosctl"])
def test_every_command_that_reports_has_json(name: str) -> None:
    """``--json`` is on every command that prints a report; one that writes a file has ``--output`` instead."""
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
    """An option that several commands share has one help text and one short form.

    Exceptions: ``--alternatives`` (two meanings), output and trials of ``reproduce`` (a folder; trials per condition),
    output and format of ``plot`` (a picture), output of ``report`` (a page), ``--show`` of ``convert`` (a format
    instead of a scenario).
    """
    known: dict[str, tuple[str, tuple[str, ...], str]] = {}
    for name, option in OPTIONS:
        if name == "nlosctl" or not option.opts[0].startswith("--") or option.name == "alternatives":
            continue
        own = {
            "nlosctl reproduce": ("output", "trials"),
            "nlosctl plot": ("output", "format"),
            "nlosctl report": ("output",),
            "nlosctl convert": ("show",),
        }
        if option.name in own.get(name, ()):
            continue
        declared = (option.help, tuple(option.opts))
        first = known.setdefault(option.opts[0], (*declared, name))
        assert declared == first[:2], f"{option.opts[0]}: {name} and {first[2]} differ"


def links(path: Path) -> list[str]:
    """The links of a page that point into the repository."""
    targets = re.findall(r"\[[^\]]*\]\(([^)\s]+)\)", path.read_text(encoding="utf-8"))
    return [link for link in targets if not re.match(r"[a-z]+:", link)]


@pytest.mark.parametrize("path", DOCUMENTS, ids=lambda path: path.name)
def test_links_have_targets(path: Path) -> None:
    """The file of every link into the repository exists, and so does its heading."""
    for link in links(path):
        target, _, heading = link.partition("#")
        file = (path.parent / target) if target else path
        assert file.exists(), f"{path.name}: {link}"
        if heading:
            headings = re.findall(r"^#+ (.+)$", file.read_text(encoding="utf-8"), re.MULTILINE)
            assert heading in [re.sub(r"[^\w\- ]", "", text.lower()).replace(" ", "-") for text in headings]


def test_the_readme_links_to_the_main_pages() -> None:
    """The README links to the conventions, the architecture and the guide to writing a method."""
    assert {"docs/conventions.md", "docs/architecture.md", "docs/writing-a-method.md"} <= set(links(ROOT / "README.md"))


@pytest.mark.parametrize("status", Status, ids=lambda status: status.word)
def test_every_status_is_in_the_conventions(status: Status) -> None:
    """docs/conventions.md lists each status with the meaning that the code states, and which numbers are null."""
    text = (ROOT / "docs" / "conventions.md").read_text(encoding="utf-8")
    row = re.search(rf"^\| `{status.word}` \| (.+) \| (\w+) \| (.+) \|$", text, re.MULTILINE)
    assert row is not None
    meaning = re.sub(r" \([^)]*\)", "", row[1])
    assert status.meaning.startswith(meaning)
    assert (row[2] == "yes") == status.has_position
    assert (row[3] != "null") == status.has_covariance


def examples() -> list[tuple[str, str]]:
    """Every command line in the code blocks of the pages, with the name of its page.

    CONTRIBUTING.md, whose recipes add a command, is left out: test_contributing.py runs it.
    """
    lines = []
    for path in DOCUMENTS:
        if path.name == "CONTRIBUTING.md":
            continue
        text = path.read_text(encoding="utf-8").replace("\\\n", " ")
        for line in re.findall(r"^(?:    |\$ )?(nlosctl .+)$", text, re.MULTILINE):
            lines += [(path.name, part.strip()) for part in line.split(" | ") if part.strip().startswith("nlosctl")]
    return lines


@pytest.mark.parametrize(("document", "line"), examples())
def test_examples_use_existing_options(document: str, line: str) -> None:
    """Every command line on a page names a command and options that exist."""
    words = line.split("#")[0].split()
    name = "nlosctl"
    for word in words[1:]:
        name = f"{name} {word}" if f"{name} {word}" in COMMANDS else name
    named = [name, *(f"nlosctl {word}" for word in words[3:4] if name == "nlosctl config show")]
    parameters = [parameter for each in named if each in COMMANDS for parameter in COMMANDS[each].params]
    known = {option for parameter in parameters for option in (*parameter.opts, *parameter.secondary_opts)}
    used = [word.partition("=")[0] for word in words if re.match(r"--?[a-zA-Z]", word)]
    assert name != "nlosctl" or not [word for word in words[1:] if not word.startswith("-")], f"{document}: {line}"
    assert [word for word in used if word not in known | {"--help", "-h"}] == [], f"{document}: {line}"


def test_references_of_methods_are_in_the_bibliography() -> None:
    """docs/references.bib has the authors whom methods and scenarios cite."""
    text = (ROOT / "docs" / "references.bib").read_text(encoding="utf-8").lower()
    built_in = [entry for entry in registry.entries() if entry.distribution == "nlosctl"]
    references = [registry.load(entry).reference for entry in built_in]
    references += [spec.reference for spec in scenarios().values() if spec.reference != "generic"]
    authors = {reference.split(",")[0].split()[0].lower() for reference in references}
    assert [author for author in authors if author not in text] == []


def test_the_bibliography_is_complete() -> None:
    """Every entry of docs/references.bib has balanced braces, a title and authors."""
    entries = re.split(r"^@", (ROOT / "docs" / "references.bib").read_text(encoding="utf-8"), flags=re.MULTILINE)[1:]
    assert len(entries) > 5
    for entry in entries:
        assert entry.count("{") == entry.count("}"), entry
        assert entry.rstrip().endswith("}")
        assert re.search(r"^  author +=", entry, re.MULTILINE)
        assert re.search(r"^  title +=", entry, re.MULTILINE)


@pytest.mark.parametrize("entry", [entry for entry in registry.entries() if entry.distribution == "nlosctl"], ids=str)
def test_every_method_cites_paper_and_equation(entry: registry.MethodEntry) -> None:
    """``methods show`` prints the full reference of the paper, and the section or equation."""
    reference = registry.load(entry).reference
    assert papers_of(reference)
    assert re.search(r"equations? \(\d+\)|[Ss]ections? [IVX\d]|Algorithm \d", reference)
    plain = re.sub(r"[{}]", "", (ROOT / "docs" / "references.bib").read_text(encoding="utf-8"))
    for paper in papers_of(reference):
        parts = paper.split(", ")[1:]
        assert any(part in plain for part in parts if len(part) > 20), paper


def test_the_citation_file_has_this_version() -> None:
    """CITATION.cff states the version, the licence and the authors."""
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert citation["cff-version"] == "1.2.0"
    assert {"message", "title", "authors"} <= citation.keys()
    assert citation["authors"] == [{"name": "The nlosctl developers"}]
    assert (citation["version"], citation["license"]) == (__version__, project["license"])


def test_the_changelog_has_this_version() -> None:
    """The changelog has a section for the version of the package, or one for unreleased changes."""
    text = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    assert f"## [{__version__}]" in text or "## [Unreleased]" in text


def test_the_entry_point_exists() -> None:
    """The entry point of pyproject.toml names a function that exists."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    module, _, function = project["scripts"]["nlosctl"].partition(":")
    assert callable(getattr(importlib.import_module(module), function))
