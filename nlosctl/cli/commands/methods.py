"""``nlosctl methods``: list, show and check the installed methods."""

from __future__ import annotations

from typing import Annotated, Any

import typer

from nlosctl.cli.examples import CommandWithUsage, epilog_of
from nlosctl.cli.options.completion import complete_method_name
from nlosctl.cli.options.declarations import Debug, Json
from nlosctl.cli.terminal import print_json, print_table
from nlosctl.errors import MethodError, UsageError, did_you_mean

__all__ = ["methods_app", "papers_of"]

_PAPERS = {
    "Song, Willett, Zhou 2013": "X. Song, P. Willett, S. Zhou, Bearings-Only Localization with NLOS Reflected AoAs, "
    "Journal of Advances in Information Fusion, 2013",
    "Stansfield 1947": "R. G. Stansfield, Statistical Theory of DF Fixing, Journal of the IEE 14(15), 762-770, 1947",
    "Liang, Zeng, Li": "Y. Liang, C. Zeng, H. Li, LOS Path Identification in Multipath Environments with an Unknown "
    "Number of Passive Targets, Stevens Institute of Technology",
    "Liang, Li 2023": "Y. Liang, H. Li, LOS Signal Identification for Passive Multi-Target Localization in Multipath "
    "Environments, IEEE Signal Processing Letters 30, 1597-1601, 2023",
    "Beck, Stoica, Li 2008": "A. Beck, P. Stoica, J. Li, Exact and Approximate Solutions of Source Localization "
    "Problems, IEEE Transactions on Signal Processing 56(5), 1770-1778, 2008",
    "Chan, Ho 1994": "Y.-T. Chan, K. C. Ho, A Simple and Efficient Estimator for Hyperbolic Location, IEEE "
    "Transactions on Signal Processing 42(8), 1905-1915, 1994",
    "Pattipati, Deb, Bar-Shalom, Washburn 1992": "K. R. Pattipati, S. Deb, Y. Bar-Shalom, R. B. Washburn, A New "
    "Relaxation Algorithm and Passive Sensor Data Association, IEEE Transactions on Automatic Control 37(2), 198-213, "
    "1992",
    "Shen, Molisch 2012": "J. Shen, A. F. Molisch, Indirect Path Detection Based on Wireless Propagation "
    "Measurements, IEEE Transactions on Wireless Communications, 2012, doi:10.1109/TWC.2012.112012.120104",
    "Ananthasubramaniam, Madhow": "B. Ananthasubramaniam, U. Madhow, Cooperative Localization Using Angle of Arrival "
    "Measurements: Sequential Algorithms and Non-Line-of-Sight Suppression, University of California, Santa Barbara",
}
"""The papers that the references of the built-in methods name (docs/references.bib has them for BibTeX)."""

methods_app = typer.Typer(
    help="List the methods, show one, or check that all of them load.", epilog=epilog_of("methods")
)


@methods_app.callback(invoke_without_command=True)
def list_methods(
    context: typer.Context,
    check: Annotated[
        bool, typer.Option("--check", rich_help_panel="Run", help="Import every method; exit 1 if one fails.")
    ] = False,
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
        raise MethodError(f"{failed} of {len(entries)} methods cannot be used")


@methods_app.command("show", cls=CommandWithUsage, epilog=epilog_of("methods show"))
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
        "parameters": [
            {**item, "estimable": spec.learning is not None and item["name"] in spec.learning.options}
            for item in describe_options(spec.options)
        ],
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
            "type": item["type"]
            + (f" in {item['bounds']}" if item["bounds"] else "")
            + (" or estimate" if item["estimable"] else ""),
            "unit": item["unit"],
            "default": "required" if item["required"] else str(item["default"]),
            "meaning": item["meaning"],
        }
        for item in parameters
    ]
    print_table(rows, ["name", "type", "unit", "default", "meaning"])


def papers_of(reference: str) -> list[str]:
    """Return the papers that a reference names, in full; none for a plugin's own."""
    return [paper for key, paper in _PAPERS.items() if key in reference]
