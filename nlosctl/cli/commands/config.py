"""``nlosctl config``: the effective settings and their sources."""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Sequence
from typing import Annotated, Any

import typer

from nlosctl.cli.examples import CommandWithUsage, epilog_of
from nlosctl.cli.options.completion import complete_command
from nlosctl.cli.options.config_file import unknown_variables
from nlosctl.cli.options.declarations import CONFIG_HELP, Debug, Json
from nlosctl.cli.options.settings import (
    CONFIG_VARIABLE,
    Setting,
    SettingsCommand,
    add_source,
    command_settings,
    long_name,
    options_of,
)
from nlosctl.cli.terminal import print_json, print_message, print_table
from nlosctl.errors import UsageError, did_you_mean

__all__ = ["config_app"]

config_app = typer.Typer(help="Show the effective settings and their sources.", no_args_is_help=True)


@config_app.command(
    "show", cls=CommandWithUsage, epilog=epilog_of("config show"), context_settings={"ignore_unknown_options": True}
)
def show(
    context: typer.Context,
    command: Annotated[
        str | None,
        typer.Argument(metavar="COMMAND", autocompletion=complete_command, help="A command; default: all of them."),
    ] = None,
    flags: Annotated[
        list[str] | None, typer.Argument(metavar="FLAG", help="Flags of the command, as they would be passed.")
    ] = None,
    config: Annotated[
        str | None,
        typer.Option("--config", metavar="FILE", envvar=CONFIG_VARIABLE, show_envvar=False, help=CONFIG_HELP),
    ] = None,
    json: Json = False,
    debug: Debug = False,
) -> None:
    """Show the settings of a command with their sources: flag > environment > config > default.

    Without COMMAND, show the settings of all commands that differ from the defaults. Put FLAGS that this command has
    too (--json, --config, --debug) after '--'.
    """
    root = context.find_root()
    everything: dict[str, Any] = root.command.commands  # type: ignore[attr-defined]
    commands = {name: inner for name, inner in everything.items() if isinstance(inner, SettingsCommand)}
    if command is not None and command not in commands:
        raise UsageError(f"no command {command!r}{did_you_mean(command, commands)}; there are: {', '.join(commands)}")
    rows: list[dict[str, Any]] = []
    for name in commands if command is None else [command]:
        inner = type(context)(commands[name], info_name=name, parent=root)
        settings = list(_settings(inner, flags or [], config))
        rows += settings if command is not None else [row for row in settings if row["source"] != "default"]
    if command is None:
        for line in unknown_variables(commands):
            print_message(line)
    if json:
        print_json(rows)
    elif not rows:
        print_message("every setting is its default")
    else:
        print_table([{**row, "value": _shown(row["value"])} for row in rows], ["command", "setting", "value", "source"])


def _settings(context: Any, flags: Sequence[str], config: str | None) -> Iterator[dict[str, Any]]:
    """Yield a row for each option of the context's command, with its value checked as the command does."""
    given, _, _ = context.command.make_parser(context).parse_args(args=list(flags))
    known = command_settings(context, config)
    if config is not None and "config" not in known:
        known["config"] = Setting(value=config, source="flag")
    context.params["config"] = config
    context.default_map = {name: setting.value for name, setting in known.items()}
    for parameter in options_of(context.command).values():
        value, origin = parameter.consume_value(context, given)
        context.set_parameter_source(parameter.name, origin)
        source = {"COMMANDLINE": "flag", "DEFAULT": "default"}.get(origin.name)
        if source is None:
            source = known[str(parameter.name)].source
        yield {
            "command": context.info_name,
            "setting": long_name(parameter),
            "value": _checked(parameter, context, value),
            "source": source,
        }


def _checked(parameter: Any, context: Any, value: Any) -> Any:
    """Return the value in the option's type; an error names the source of the value, as the command does."""
    try:
        return parameter.process_value(context, value)
    except Exception as error:
        add_source(error, context)
        raise


def _shown(value: Any) -> str:
    if isinstance(value, list | tuple):
        return shlex.join(map(str, value))
    return "" if value is None else str(value).lower() if isinstance(value, bool) else str(value)
