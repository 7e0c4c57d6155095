"""The options of a command: derived from the option classes; values from flag > environment > config file > default."""

from __future__ import annotations

import dataclasses
import functools
import inspect
import os
import re
import shlex
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, get_args, get_type_hints

import typer

from nlosctl.cli.examples import CommandWithUsage
from nlosctl.cli.options import completion
from nlosctl.contract.run_options import PANELS, Flag, InputOptions, OutputOptions, SolveOptions, flags_of
from nlosctl.errors import UsageError

__all__ = [
    "CONFIG_VARIABLE",
    "Setting",
    "SettingsCommand",
    "add_source",
    "command_settings",
    "key_values",
    "long_name",
    "options_of",
    "take_config",
    "takes_options",
    "variable_name",
    "with_flags",
]

_CONFIG = "config"
_SETTING = re.compile(r"`([a-z][a-z0-9_]*)(?:\['([a-z][a-z0-9_]*)'\])?`")
CONFIG_VARIABLE = "NLOSCTL_CONFIG"
"""The environment variable with the config file of all commands."""


@dataclass(frozen=True, kw_only=True)
class Setting:
    """The value of an option without a flag, and a description of its source."""

    value: Any
    source: str


class SettingsCommand(CommandWithUsage):
    """A command whose options default to ``NLOSCTL_<COMMAND>_<OPTION>``, then to the config file."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Parse the arguments with defaults from the environment; the callback of ``--config`` adds the config file."""
        if ctx.resilient_parsing:
            return super().parse_args(ctx, args)
        settings = _from_environment(ctx.command, ctx.info_name or "", os.environ)
        ctx.default_map = {name: setting.value for name, setting in settings.items()}
        try:
            return super().parse_args(ctx, args)
        except Exception as error:
            add_source(error, ctx)
            raise


def take_config(context: typer.Context, value: str | None) -> str | None:
    """Add the settings of the config file as defaults after those of the environment: the callback of ``--config``."""
    if value is not None:
        from nlosctl.cli.options.config_file import settings_of_file

        given = {name: setting.value for name, setting in settings_of_file(context, value).items()}
        context.default_map = {**given, **(context.default_map or {})}
    return value


def command_settings(context: Any, config: str | None) -> dict[str, Setting]:
    """Return the settings of environment and config file for the context's command, by parameter name."""
    from_environment = _from_environment(context.command, context.info_name, os.environ)
    if config is None and _CONFIG in from_environment:
        config = from_environment[_CONFIG].value
    if config is None:
        return from_environment
    from nlosctl.cli.options.config_file import settings_of_file

    return {**settings_of_file(context, config), **from_environment}


def options_of(command: Any) -> dict[str, Any]:
    """Return the options of a command by their long names, without dashes."""
    return {long_name(parameter): parameter for parameter in command.params if str(parameter.opts[0]).startswith("-")}


def long_name(parameter: Any) -> str:
    """Return the long name of an option, without its dashes."""
    return max((str(word).lstrip("-") for word in parameter.opts), key=len)


def variable_name(command: str, option: str) -> str:
    """Return the environment variable of a command's option."""
    return f"NLOSCTL_{command}_{option}".upper().replace("-", "_").replace(" ", "_")


def add_source(error: Exception, context: Any) -> None:
    """Add the source of an invalid value to the error, unless the source is a flag."""
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
            value = _split(text, variable) if getattr(parameter, "multiple", False) else text
            settings[str(parameter.name)] = Setting(value=value, source=f"environment {variable}")
            break
    return settings


def _split(text: str, variable: str) -> list[str]:
    """Split the variable of a repeatable option as a shell does."""
    try:
        return shlex.split(text)
    except ValueError as error:
        raise UsageError(f"{variable}: {str(error).lower()} in {text!r}; quote words with blanks") from error


def takes_options(**defaults: Any) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Return a decorator for commands: a parameter of an options class becomes the flags that its fields declare.

    The command receives the object. ``defaults`` replace defaults of options, by name. All flags are in the order of
    their panels.
    """

    def decorate(command: Callable[..., Any]) -> Callable[..., Any]:
        name = command.__name__.replace("_", "-")
        hints = get_type_hints(command, include_extras=True)
        classes: dict[str, Any] = {key: hint for key, hint in hints.items() if dataclasses.is_dataclass(hint)}
        flags = {
            key: [(option, flag) for option, flag in flags_of(options) if name in flag.commands.split()]
            for key, options in classes.items()
        }

        @functools.wraps(command)
        def call(context: typer.Context, **parsed: Any) -> Any:
            by_flag = {key for key in parsed if getattr(context.get_parameter_source(key), "name", "") == "COMMANDLINE"}
            made = {key: options(**_values(flags[key], parsed, by_flag)) for key, options in classes.items()}
            return command(**parsed, **made)

        own = inspect.signature(command).parameters.values()
        parameters = [
            parameter.replace(annotation=hints[parameter.name], kind=inspect.Parameter.KEYWORD_ONLY)
            for parameter in own
            if parameter.name not in classes
        ]
        for key, options in classes.items():
            types = get_type_hints(options)
            parameters += [_parameter(option, flag, types[option.name], defaults) for option, flag in flags[key]]
        parameters.sort(key=_panel_index)
        given = inspect.Parameter("context", inspect.Parameter.KEYWORD_ONLY, annotation=typer.Context)
        parameters.append(given)
        call.__signature__ = inspect.Signature(parameters, return_annotation=hints["return"])  # type: ignore[attr-defined]
        call.__annotations__ = {option.name: option.annotation for option in parameters} | {"return": hints["return"]}
        return call

    return decorate


def _values(
    flags: Sequence[tuple[dataclasses.Field[Any], Flag]], parsed: dict[str, Any], by_flag: Collection[str]
) -> dict[str, Any]:
    """Return the options that ``parsed`` values set, and remove those values from ``parsed``.

    A key of a mapping that is not ``by_flag``, but of the environment or a config file, is a default.
    """
    values: dict[str, Any] = {}
    for option, flag in flags:
        value = parsed.pop(_parameter_name(option, flag))
        if flag.key:
            given = {} if value is None or flag.parse is None else {flag.key: flag.parse(value)}
            name = option.name if _parameter_name(option, flag) in by_flag else f"default_{option.name}"
            if not given.keys().isdisjoint(values.get(name, {})):
                raise UsageError(f"{flag.name} and another option set the same quantity; give one of them")
            values[name] = {**values.get(name, {}), **given}
        elif flag.parse is not None:
            if value != flag.text:
                values[option.name] = flag.parse(value)
        elif isinstance(value, list):
            is_mapping = option.default_factory is dict
            values[option.name] = key_values(value, flag.name) if is_mapping else tuple(value)
        else:
            values[option.name] = value
    return values


def _parameter(option: dataclasses.Field[Any], flag: Flag, hint: Any, defaults: Mapping[str, Any]) -> inspect.Parameter:
    """Return the parser's parameter for a flag."""
    default = defaults.get(option.name, option.default)
    kind: Any
    if flag.key:
        kind, default = float | None, None
    elif flag.parse is not None:
        kind, default = str, flag.text
    elif isinstance(default, tuple) or option.default_factory is dict:
        kind, default = list[str], [] if option.default_factory is dict else list(default)
    else:
        kind = str | None if default is None and str in get_args(hint) else hint
    declared = typer.Option(
        flag.name,
        *([flag.short] if flag.short else []),
        help=flag.help,
        metavar=flag.metavar,
        min=flag.minimum,
        max=flag.maximum,
        autocompletion=getattr(completion, f"complete_{flag.complete}") if flag.complete else None,
        rich_help_panel=flag.panel,
    )
    return inspect.Parameter(
        _parameter_name(option, flag),
        inspect.Parameter.KEYWORD_ONLY,
        default=default,
        annotation=Annotated[kind, declared],
    )


def _parameter_name(option: dataclasses.Field[Any], flag: Flag) -> str:
    return flag.name.removeprefix("--").replace("-", "_") if flag.key else option.name


def _panel_index(parameter: inspect.Parameter) -> int:
    """Return the position of a parameter's panel; arguments come first."""
    panel = next((getattr(item, "rich_help_panel", None) for item in parameter.annotation.__metadata__), None)
    return PANELS.index(panel) if panel in PANELS else -1


def key_values(items: Sequence[str], flag: str) -> dict[str, str]:
    """Return ``KEY=VALUE`` items as a dictionary; raises UsageError for another form or a repeated key."""
    pairs: dict[str, str] = {}
    for item in items:
        key, equals, value = item.partition("=")
        if not equals or not key:
            raise UsageError(f"{flag} takes KEY=VALUE. Got {item!r} instead.")
        if key in pairs:
            raise UsageError(f"{flag} {key} is given twice")
        pairs[key] = value
    return pairs


def with_flags(text: str) -> str:
    """Return a message with the settings that it names in backquotes as flags: ```overwrite``` as ``--overwrite``.

    A key of a setting has its own flag: ```constants['range_std_m']``` is ``--range-std-m``.
    """
    return _SETTING.sub(lambda match: _flag_names().get(match[2] or match[1], f"--{match[1].replace('_', '-')}"), text)


@functools.cache
def _flag_names() -> dict[str, str]:
    options = [pair for group in (InputOptions, SolveOptions, OutputOptions) for pair in flags_of(group)]
    return {flag.key or option.name: flag.name for option, flag in options}
