"""Where the options of a command take their values from: flag > environment > config file > default."""

from __future__ import annotations

import os
import shlex
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import typer
from typer.core import TyperCommand

from nlosctl.contract.limits import parse_toml, read_limited
from nlosctl.errors import DataError, UsageError, did_you_mean
from nlosctl.io.paths.locations import location

__all__ = [
    "CONFIG_VARIABLE",
    "Setting",
    "SettingsCommand",
    "command_settings",
    "long_name",
    "options_of",
    "take_config",
    "tell_source",
    "variable_name",
]

_CONFIG = "config"
CONFIG_VARIABLE = "NLOSCTL_CONFIG"
"""Names the config file of all commands."""


@dataclass(frozen=True, kw_only=True)
class Setting:
    """A value that an option takes where no flag gives one, and where it comes from, in words."""

    value: Any
    source: str


class SettingsCommand(TyperCommand):
    """A command whose options take their defaults from ``NLOSCTL_<COMMAND>_<OPTION>`` and from the config file."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Parse the words of the command line with the environment beneath them; ``--config`` goes beneath that."""
        if ctx.resilient_parsing:
            return super().parse_args(ctx, args)
        settings = _from_environment(ctx.command, ctx.info_name or "", os.environ)
        ctx.default_map = {name: setting.value for name, setting in settings.items()}
        try:
            return super().parse_args(ctx, args)
        except Exception as error:
            tell_source(error, ctx)
            raise


def take_config(context: typer.Context, value: str | None) -> str | None:
    """Put the config file's settings beneath those of the environment: the callback of ``--config``."""
    if value is not None:
        given = {name: setting.value for name, setting in _from_file(context, value).items()}
        context.default_map = {**given, **(context.default_map or {})}
    return value


def command_settings(context: Any, config: str | None) -> dict[str, Setting]:
    """Return what the environment and the config file set, by the parameter's name, for the context's command."""
    from_environment = _from_environment(context.command, context.info_name, os.environ)
    if config is None and _CONFIG in from_environment:
        config = from_environment[_CONFIG].value
    return {**({} if config is None else _from_file(context, config)), **from_environment}


def options_of(command: Any) -> dict[str, Any]:
    """Return the options of a command by their long names, without dashes."""
    return {long_name(parameter): parameter for parameter in command.params if str(parameter.opts[0]).startswith("-")}


def long_name(parameter: Any) -> str:
    """Return the long name of an option, without its dashes."""
    return max((str(word).lstrip("-") for word in parameter.opts), key=len)


def variable_name(command: str, option: str) -> str:
    """Return the environment variable of a command's option."""
    return f"NLOSCTL_{command}_{option}".upper().replace("-", "_").replace(" ", "_")


def tell_source(error: Exception, context: Any) -> None:
    """Add to the complaint about a value where it comes from, unless it was given as a flag."""
    name = getattr(getattr(error, "param", None), "name", None)
    source = None if name is None else context.get_parameter_source(name)
    if getattr(source, "name", "") != "DEFAULT_MAP" or not hasattr(error, "message"):
        return
    setting = command_settings(context, context.params.get(_CONFIG)).get(str(name))
    if setting is not None:
        error.message = f"{str(error.message).rstrip('.')} ({setting.source})."


def _from_environment(command: Any, name: str, environment: Mapping[str, str]) -> dict[str, Setting]:
    settings = {}
    for option, parameter in options_of(command).items():
        variables = [variable_name(name, option), *([CONFIG_VARIABLE] if option == _CONFIG else [])]
        for variable in filter(environment.get, variables):
            text = environment[variable]
            value = _words(text, variable) if getattr(parameter, "multiple", False) else text
            settings[str(parameter.name)] = Setting(value=value, source=f"environment {variable}")
            break
    return settings


def _words(text: str, variable: str) -> list[str]:
    """Return the words of a repeatable option's variable, as a shell would part them."""
    try:
        return shlex.split(text)
    except ValueError as error:
        raise UsageError(f"{variable}: {str(error).lower()} in {text!r}; words with blanks go in quotes") from error


def _from_file(context: Any, path: str) -> dict[str, Setting]:
    """Return the settings of the command's table in a TOML file; every table must be that of a command."""
    content = _read(path)
    commands = context.find_root().command.commands
    for name in content:
        if name not in commands:
            raise UsageError(f"--config {path}: no command {name!r}{did_you_mean(name, commands)}")
    command = context.info_name
    section = content.get(command, {})
    if not isinstance(section, dict):
        raise UsageError(f"--config {path}: {command}: got {section!r}, expected a table headed [{command}]")
    known = {name: option for name, option in options_of(context.command).items() if name != _CONFIG}
    settings = {}
    for key, value in section.items():
        parameter = known.get(key.replace("_", "-"))
        if parameter is None:
            raise UsageError(f"--config {path}: [{command}] has no setting {key!r}{did_you_mean(key, known)}")
        repeatable = bool(getattr(parameter, "multiple", False))
        settings[str(parameter.name)] = Setting(value=_value(value, repeatable=repeatable), source=f"config {path}")
    return settings


def _read(path: str) -> dict[str, Any]:
    try:
        text = read_limited(location(path), f"--config {path}")
    except OSError as error:
        raise DataError(f"--config {path}: {error.strerror}") from error
    return parse_toml(text, f"--config {path}")


def _value(setting: Any, *, repeatable: bool) -> Any:
    if isinstance(setting, dict):
        return [f"{word}={_text(item)}" for word, item in setting.items()]
    return [setting] if repeatable and not isinstance(setting, list) else setting


def _text(value: object) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)
