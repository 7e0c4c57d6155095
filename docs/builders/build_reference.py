"""Write docs/commands.md and man/nlosctl.1 from the commands themselves: ``make reference``."""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterator
from pathlib import Path
from types import UnionType
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

import typer.main

from nlosctl.cli.examples import EXAMPLES
from nlosctl.cli.main import app
from nlosctl.cli.options.settings import SettingsCommand, long_name, variable_name
from nlosctl.version import __version__

ROOT = Path(__file__).parents[2]

_HEAD = """\
# Commands

All commands with their arguments and options, generated from the program by `make reference`; `man nlosctl` shows the
same. [settings.md](settings.md) explains config file, environment and completion.
"""


def commands(command: Any, name: str) -> Iterator[tuple[str, Any]]:
    """Yield every command with its full name; groups without options are left out."""
    inner = getattr(command, "commands", {})
    if not inner or command.params:
        yield name, command
    for word, further in inner.items():
        yield from commands(further, f"{name} {word}")


def program() -> Any:
    """The program as its parser sees it."""
    return typer.main.get_command(app)


def all_commands() -> list[tuple[str, Any]]:
    """The program and its commands, with their full names."""
    return list(commands(program(), "nlosctl"))


def paragraphs(text: str | None) -> list[str]:
    """The paragraphs of a help text, each as one line."""
    return [" ".join(part.split()) for part in re.split(r"\n\s*\n", inspect.cleandoc(text or ""))]


def is_option(parameter: Any) -> bool:
    """Whether a parameter is an option, not an argument."""
    return str(parameter.opts[0]).startswith("-")


def value_name(parameter: Any, command: Any) -> str:
    """Name of an option's value, such as ``FILE``; empty for an on/off option."""
    if getattr(parameter, "is_flag", False):
        return ""
    annotation: Any = get_type_hints(command.callback).get(parameter.name)
    if parameter.metavar:
        return str(parameter.metavar)
    while get_origin(annotation) in (list, Union, UnionType):
        annotation = get_args(annotation)[0]
    if get_origin(annotation) is Literal:
        return "|".join(map(str, get_args(annotation)))
    return {bool: "", int: "INTEGER", float: "NUMBER"}.get(annotation, "TEXT")


def default(parameter: Any) -> str:
    """The default as text; empty without a default."""
    value = parameter.default
    if isinstance(value, list | tuple):
        value = " ".join(map(str, value))
    return "" if value is None or value == "" or isinstance(value, bool) else str(value)


def usage(name: str, command: Any) -> str:
    """The usage line of a command."""
    arguments = [argument_name(parameter) for parameter in command.params if not is_option(parameter)]
    return " ".join([name, "[OPTIONS]", *(["COMMAND ..."] if name == "nlosctl" else arguments)])


def argument_name(parameter: Any) -> str:
    """Name of an argument in the usage line."""
    name = str(parameter.metavar or parameter.name.upper())
    name = name if parameter.required or name.startswith("[") else f"[{name}]"
    return f"{name}..." if parameter.nargs == -1 and "..." not in name else name


def panel_of(parameter: Any) -> str | None:
    """The panel of an option in the help, None for arguments and for options without a panel."""
    return getattr(parameter, "rich_help_panel", None) if is_option(parameter) else None


def option_words(parameter: Any) -> list[str]:
    """The spellings of an option, short ones first."""
    return sorted([*parameter.opts, *parameter.secondary_opts], key=lambda word: (word.startswith("--"), word))


def markdown() -> str:
    """The reference as Markdown."""
    blocks = [_HEAD]
    for name, command in all_commands():
        blocks.append(f"## {name}\n\n    {usage(name, command)}\n\n" + "\n\n".join(paragraphs(command.help)) + "\n")
        rows, panel = [], None
        for parameter in command.params:
            if panel_of(parameter) not in (panel, None):
                panel = panel_of(parameter)
                rows.append(f"| **{panel}** | | |")
            words = option_words(parameter) if is_option(parameter) else [argument_name(parameter)]
            value = value_name(parameter, command) if is_option(parameter) else ""
            usage_text = ", ".join(f"`{word}`" for word in words) + (f" `{value}`" if value else "")
            rows.append(f"| {cell(usage_text)} | {cell(paragraphs(parameter.help)[0])} | {cell(default(parameter))} |")
        blocks.append("| argument or option | what it does | default |\n|---|---|---|\n" + "\n".join(rows) + "\n")
        if examples := EXAMPLES.get(name.removeprefix("nlosctl ")):
            blocks.append("Examples:\n\n" + "\n".join(f"    {example}" for example in examples) + "\n")
        if isinstance(command, SettingsCommand):
            example = variable_name(name.split()[-1], long_name(next(filter(is_option, command.params))))
            blocks.append(f"Environment: `{variable_name(name.split()[-1], '')}<OPTION>`, such as `{example}`.\n")
    return "\n".join(blocks)


def cell(text: str) -> str:
    """Text escaped for a cell of a Markdown table."""
    return text.replace("|", "\\|")


def manual() -> str:
    """The reference as a manual page, in the man macros of troff."""
    whole = program()
    lines = [
        f'.TH NLOSCTL 1 "" "nlosctl {__version__}" "User Commands"',
        ".SH NAME",
        f"nlosctl \\- {troff(paragraphs(whole.help)[0][0].lower() + paragraphs(whole.help)[0][1:].rstrip('.'))}",
        ".SH SYNOPSIS",
        *(
            f"\\fB{troff(name)}\\fR{troff(usage(name, command).removeprefix(name))}\n.br"
            for name, command in all_commands()
        ),
        ".SH DESCRIPTION",
        troff("Files of measurements in, files of estimates and flags out. 'COMMAND --help' prints the same text."),
        ".SH COMMANDS",
    ]
    for name, command in all_commands():
        lines += [f".SS {troff(usage(name, command))}"]
        for number, paragraph in enumerate(paragraphs(command.help)):
            lines += [*([".PP"] if number else []), troff(paragraph)]
        panel = None
        for parameter in command.params:
            if panel_of(parameter) not in (panel, None):
                panel = panel_of(parameter)
                lines += [".PP", f"\\fB{troff(panel or '')}\\fR"]
            words = option_words(parameter) if is_option(parameter) else [argument_name(parameter)]
            value = value_name(parameter, command) if is_option(parameter) else ""
            bold = ", ".join(f"\\fB{troff(word)}\\fR" for word in words)
            value = f" \\fI{troff(value)}\\fR" if value else ""
            ending = f" [default: {default(parameter)}]" if default(parameter) else ""
            lines += [".TP", bold + value, troff(paragraphs(parameter.help)[0] + ending)]
        if examples := EXAMPLES.get(name.removeprefix("nlosctl ")):
            lines += [".PP", "Examples:", ".PP", ".nf", *map(troff, examples), ".fi"]
    lines += [".SH EXIT STATUS", troff(paragraphs(whole.epilog)[0]), ".SH ENVIRONMENT"]
    for variable, meaning in (
        (
            "NLOSCTL_<COMMAND>_<OPTION>",
            "An option of a command; several words, split as by a shell, for a repeatable one.",
        ),
        ("NLOSCTL_CONFIG", "The config file, as --config."),
        ("NLOSCTL_NO_PLUGINS", "1: only built-in methods."),
        ("NLOSCTL_DEBUG", "1: print a traceback with an error."),
        ("NO_COLOR", "Any value: no colours."),
    ):
        lines += [".TP", f"\\fB{troff(variable)}\\fR", troff(meaning)]
    return "\n".join(lines) + "\n"


def troff(text: str) -> str:
    """Text escaped for troff."""
    text = (
        text.replace("\\", "\\e").replace("-", "\\-").replace("'", "\\(aq").replace("`", "\\(ga").replace("^", "\\(ha")
    )
    return f"\\&{text}" if text.startswith((".", "'")) else text


REFERENCES = {ROOT / "docs" / "commands.md": markdown, ROOT / "man" / "nlosctl.1": manual}


def main() -> None:
    """Write both files."""
    for path, text in REFERENCES.items():
        path.parent.mkdir(exist_ok=True)
        path.write_text(text(), encoding="utf-8")


if __name__ == "__main__":
    main()
