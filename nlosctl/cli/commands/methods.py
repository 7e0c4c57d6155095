"""``nlosctl methods``: which methods there are, what one is, and whether all of them load."""

from __future__ import annotations

from typing import Annotated, Any

import typer

from nlosctl.cli.options.completion import complete_method_name
from nlosctl.cli.options.declarations import Debug, Json
from nlosctl.cli.shared.papers import papers_of
from nlosctl.cli.shared.terminal import print_json, print_table
from nlosctl.errors import MethodError, UsageError, did_you_mean

__all__ = ["methods_app"]

methods_app = typer.Typer(help="List the methods, show one, or check that all of them load.")


@methods_app.callback(invoke_without_command=True)
def list_methods(
    context: typer.Context,
    check: Annotated[bool, typer.Option("--check", help="Import every method; exit 1 if one fails.")] = False,
    json: Json = False,
    debug: Debug = False,
) -> None:
    """List the installed methods by kind of measurement, without importing any."""
    if context.invoked_subcommand is not None:
        return
    from nlosctl import registry

    entries = registry.entries()
    rows = [{"kind": e.kind, "name": e.name, "distribution": e.distribution, "version": e.version} for e in entries]
    failed = 0
    if check:
        for row, entry in zip(rows, entries, strict=True):
            row["check"] = _check(entry)
            failed += row["check"] != "ok"
    if json:
        print_json(rows)
    else:
        print_table(rows, ["kind", "name", "distribution", "version", *(["check"] if check else [])])
    if failed:
        raise MethodError(f"{failed} of {len(entries)} methods can't be used")


@methods_app.command("show")
def show_method(
    name: Annotated[
        str, typer.Argument(metavar="NAME", autocompletion=complete_method_name, help="Method, as NAME or KIND.NAME.")
    ],
    json: Json = False,
    debug: Debug = False,
) -> None:
    """Show a method: kind, columns, parameters with unit, default and meaning, reference, distribution."""
    from nlosctl import registry

    known = registry.entries()
    matches = [entry for entry in known if name in (entry.name, entry.full_name)]
    if not matches:
        names = sorted({entry.name for entry in known})
        raise UsageError(f"no method {name!r}{did_you_mean(name, names)}; there are: {', '.join(names)}")
    described = [_describe(entry) for entry in matches]
    if json:
        print_json(described if len(described) > 1 else described[0])
        return
    for description in described:
        _render(description)


def _check(entry: Any) -> str:
    from nlosctl import registry

    try:
        registry.load(entry)
    except MethodError as error:
        return str(error)
    return "ok"


def _describe(entry: Any) -> dict[str, Any]:
    from nlosctl import registry
    from nlosctl.contract.options import describe_options
    from nlosctl.contract.tables import KINDS

    spec = registry.load(entry)
    return {
        "name": spec.name,
        "kind": spec.kind,
        "job": spec.job,
        "summary": spec.summary,
        "reference": spec.reference,
        "papers": papers_of(spec.reference),
        "distribution": f"{entry.distribution} {entry.version}",
        "required_columns": [column.name for column in KINDS[spec.kind].required],
        "minimum_measurements": spec.minimum_measurements,
        "cost": spec.cost,
        "flags": ["used", *spec.flags],
        "details": list(spec.details),
        "covariance_kinds": list(spec.covariance_kinds),
        "randomized": spec.randomized,
        "parameters": describe_options(spec.options),
    }


def _render(description: dict[str, Any]) -> None:
    parameters = description.pop("parameters")
    for key, value in description.items():
        shown = ("; " if key == "papers" else ", ").join(map(str, value)) if isinstance(value, list) else str(value)
        if shown:
            typer.echo(f"{key.replace('_', ' '):22s}{shown}")
    typer.echo("parameters")
    rows = [
        {
            "name": item["name"],
            "type": item["type"] + (f" in {item['bounds']}" if item["bounds"] else ""),
            "unit": item["unit"],
            "default": "required" if item["required"] else str(item["default"]),
            "meaning": item["meaning"],
        }
        for item in parameters
    ]
    print_table(rows, ["name", "type", "unit", "default", "meaning"])
