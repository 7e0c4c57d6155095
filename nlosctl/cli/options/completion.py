"""Shell completion: names of methods, parameters, columns and formats. Imports light modules only."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from textwrap import shorten

import typer

__all__ = [
    "complete_column",
    "complete_command",
    "complete_exporter",
    "complete_format",
    "complete_importer",
    "complete_kind",
    "complete_method",
    "complete_method_name",
    "complete_parameter",
    "complete_scenario",
    "complete_table",
    "complete_view",
]

Offer = tuple[str, str]

_WIDTH = 70
"""Longer help would be wrapped, and fish and zsh would offer the words of its second line."""


def complete_method(ctx: typer.Context, incomplete: str) -> list[Offer]:
    """Offer the methods for the command's job, of the kind in ``--kind`` if given."""
    return sorted(set(_starting(incomplete, _methods(ctx.info_name or "", ctx.params.get("kind")))))


def complete_method_name(incomplete: str) -> list[Offer]:
    """Offer all methods."""
    return sorted(set(_starting(incomplete, _methods("", None))))


def complete_parameter(ctx: typer.Context, incomplete: str) -> list[Offer]:
    """Offer ``KEY=`` for the parameters of the methods, or of the scenario, named so far."""
    from nlosctl.cli.options.source_index import glance

    offers: dict[str, str] = {}
    for module, attribute in _specs(ctx):
        offers.update((f"{name}=", meaning) for name, meaning in glance(module, attribute).options)
    return list(_starting(incomplete, offers.items()))


def complete_scenario(incomplete: str) -> list[Offer]:
    """Offer the scenarios."""
    from nlosctl.scenarios.catalogue import scenarios

    return list(_starting(incomplete, ((name, "") for name in scenarios())))


def complete_importer(incomplete: str) -> list[Offer]:
    """Offer the importers of other programs' files, and ``auto``."""
    return [*_starting(incomplete, [("auto", "by content")]), *_formats("import", incomplete)]


def complete_exporter(incomplete: str) -> list[Offer]:
    """Offer the exporters of estimates."""
    return _formats("export", incomplete)


def _formats(way: str, incomplete: str) -> list[Offer]:
    from nlosctl import registry

    entries = [entry for entry in registry.format_entries() if entry.kind == way]
    return list(_starting(incomplete, ((entry.name, entry.distribution) for entry in entries)))


def complete_table(incomplete: str) -> list[Offer]:
    """Offer the tables of the contract."""
    from nlosctl.contract.tables import TABLES

    return list(_starting(incomplete, ((table.name, table.title) for table in TABLES.values())))


def complete_kind(incomplete: str) -> list[Offer]:
    """Offer the kinds of measurement."""
    from nlosctl.contract.tables import KINDS

    return list(_starting(incomplete, ((table.name, table.title) for table in KINDS.values())))


def complete_column(ctx: typer.Context, incomplete: str) -> list[Offer]:
    """Offer ``NAME=`` for the columns of measurement files, of the kind in ``--kind`` if given."""
    from nlosctl.contract.tables import KINDS

    kind = ctx.params.get("kind")
    tables = [KINDS[kind]] if kind in KINDS else list(KINDS.values())
    offers = {
        f"{name}=": column.meaning
        for table in tables
        for column in table.all_columns
        for name in (column.name, *(spelling.name for spelling in column.spellings))
    }
    return list(_starting(incomplete, offers.items()))


def complete_format(incomplete: str) -> list[Offer]:
    """Offer the formats of table files."""
    from nlosctl.io.paths.locations import FileFormat

    return list(_starting(incomplete, ((format.value, format.title) for format in FileFormat)))


def complete_view(incomplete: str) -> list[Offer]:
    """Offer the views of ``plot``."""
    from nlosctl.plotting.catalogue import VIEWS

    return list(_starting(incomplete, ((view.name, view.shows) for view in VIEWS.values())))


def complete_command(ctx: typer.Context, incomplete: str) -> list[Offer]:
    """Offer the program's commands."""
    commands = getattr(ctx.find_root().command, "commands", {})
    return list(_starting(incomplete, ((name, "") for name in commands)))


def _starting(incomplete: str, offers: Iterable[Offer]) -> Iterator[Offer]:
    return ((name, shorten(help, _WIDTH)) for name, help in offers if name.startswith(incomplete))


def _methods(job: str, kind: str | None) -> Iterator[Offer]:
    """Yield the methods of a kind for a job, and those whose source does not state a job."""
    from nlosctl import registry
    from nlosctl.cli.options.source_index import glance

    jobs = ("localize", "detect-ip", "identify-los")
    for entry in registry.entries():
        done = glance(entry.entry_point.module, entry.entry_point.attr).job if job in jobs else ""
        if (not done or done == job) and kind in (None, entry.kind):
            yield entry.name, ""


def _specs(ctx: typer.Context) -> Iterator[tuple[str, str]]:
    """Yield module and attribute of each method or scenario named."""
    from nlosctl import registry
    from nlosctl.scenarios.catalogue import scenario_module

    if "scenario" in ctx.params:  # an unfinished option leaves the arguments in ctx.args
        words = [ctx.params["scenario"], *ctx.args]
        yield from ((module, "SCENARIO") for module in map(scenario_module, words) if module is not None)
        return
    if "target" in ctx.params and "source" in ctx.params:
        names = (ctx.params["source"], ctx.params["target"])
        for entry in registry.format_entries():
            if entry.name == names[entry.kind == "export"]:
                yield entry.entry_point.module, entry.entry_point.attr
        return
    named = ctx.params.get("method") or []
    for entry in registry.entries():
        if entry.name in named or entry.full_name in named:
            yield entry.entry_point.module, entry.entry_point.attr
