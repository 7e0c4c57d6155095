"""Settings of a config file, and variables of the environment that set nothing."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import Any

from nlosctl.cli.options.settings import CONFIG_VARIABLE, Setting, SettingsCommand, options_of, variable_name
from nlosctl.contract.limits import LIMITS, SIZES, limit_variable, parse_toml, read_limited, size_variable
from nlosctl.errors import DataError, UsageError, did_you_mean
from nlosctl.io.paths.locations import location

__all__ = ["settings_of_file", "unknown_variables"]

_CONFIG = "config"
_ALL = "all"
_OTHER_VARIABLES = (CONFIG_VARIABLE, "NLOSCTL_DEBUG", "NLOSCTL_NO_PLUGINS")


def settings_of_file(context: Any, path: str) -> dict[str, Setting]:
    """Return the settings in the tables ``[all]`` and that of the command of a TOML file, which counts first.

    Every table must be that of a command, and every setting that of its command, in ``[all]`` of any.
    """
    content = _read(path)
    commands = context.find_root().command.commands
    for name in content:
        if name not in (*commands, _ALL):
            raise UsageError(f"--config {path}: no command {name!r}{did_you_mean(name, [*commands, _ALL])}")
    known = {name: option for name, option in options_of(context.command).items() if name != _CONFIG}
    of_all = set().union(*(options_of(command) for command in commands.values() if hasattr(command, "params")))
    settings = {}
    for table, allowed in ((_ALL, of_all - {_CONFIG}), (context.info_name, set(known))):
        section = content.get(table, {})
        if not isinstance(section, dict):
            raise UsageError(f"--config {path}: {table}: got {section!r}, expected a table [{table}]")
        for key, value in section.items():
            option = key.replace("_", "-")
            if option not in allowed:
                raise UsageError(f"--config {path}: [{table}] has no setting {key!r}{did_you_mean(key, allowed)}")
            if option in known:
                repeatable = bool(getattr(known[option], "multiple", False))
                given = _value(value, repeatable=repeatable)
                settings[str(known[option].name)] = Setting(value=given, source=f"config {path}")
    return settings


def _read(path: str) -> dict[str, Any]:
    try:
        text = read_limited(location(path), f"--config {path}")
    except OSError as error:
        raise DataError(f"--config {path}: {error.strerror}") from error
    return parse_toml(text, f"--config {path}")


def _value(setting: Any, *, repeatable: bool) -> Any:
    if isinstance(setting, dict):
        return [f"{key}={_text(item)}" for key, item in setting.items()]
    return [setting] if repeatable and not isinstance(setting, list) else setting


def _text(value: object) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)


def unknown_variables(commands: Mapping[str, Any]) -> list[str]:
    """Return a line for each variable NLOSCTL_... without effect: a misspelt name would remain unnoticed."""
    given = [variable for variable in sorted(os.environ) if variable.startswith("NLOSCTL_")]
    known = {
        variable_name(name, option)
        for name, command in commands.items()
        if given and isinstance(command, SettingsCommand)
        for option in options_of(command)
    }
    known.update(_OTHER_VARIABLES, map(limit_variable, LIMITS), map(size_variable, SIZES))
    unknown = [variable for variable in given if variable not in known]
    return [f"nlosctl: {variable} sets nothing{did_you_mean(variable, known)}" for variable in unknown]
