"""``nlosctl evaluate``: estimates or flags against ground truth."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from nlosctl.cli.options.declarations import ConfigFile, Debug, FailIf, Inputs, Json, Quiet, Truth
from nlosctl.cli.options.settings import takes_options
from nlosctl.cli.terminal import Preview, Terminal, print_json, print_message, print_table
from nlosctl.contract.run_options import InputOptions, OutputOptions
from nlosctl.errors import UsageError

if TYPE_CHECKING:
    from nlosctl.pipeline.evaluate.groups import Evaluation

__all__ = ["evaluate"]

_CONDITION_MET = 4
_TEXT = "text"


@takes_options()
def evaluate(
    inputs: Inputs,
    read: InputOptions,
    write: OutputOptions,
    *,
    truth: Truth = None,
    estimates: Annotated[
        str | None,
        typer.Option(
            "--estimates", metavar="FILE", rich_help_panel="Input", help="Estimates of the same identify-los run."
        ),
    ] = None,
    ospa_order: Annotated[
        float,
        typer.Option("--ospa-order", metavar="P", min=1.0, rich_help_panel="Method", help="Order p of OSPA and GOSPA."),
    ] = 2.0,
    ospa_cutoff_m: Annotated[
        float,
        typer.Option(
            "--ospa-cutoff-m", metavar="M", rich_help_panel="Method", help="Cutoff c of OSPA and GOSPA, in metres."
        ),
    ] = 20.0,
    alternatives: Annotated[
        Literal["first", "best"],
        typer.Option(
            "--alternatives",
            rich_help_panel="Method",
            help="Alternative that counts: the first, or the nearest to the truth.",
        ),
    ] = "first",
    by: Annotated[
        list[str],
        typer.Option(
            "--by",
            metavar="NAME",
            rich_help_panel="Method",
            help="Treat each value of a column separately, such as a tag or session. Repeatable.",
        ),
    ] = [],  # noqa: B006 - typer copies it
    fail_if: FailIf = [],  # noqa: B006 - typer copies it
    config: ConfigFile = None,
    json: Json = False,
    quiet: Quiet = False,
    debug: Debug = False,
) -> int:
    """Compare estimates (or flags) with ground truth: RMSE, bias, percentiles, NEES, ellipse coverage, by method.

    Flags of identify-los with --estimates: number of targets, exact identification, precision and recall, OSPA and
    GOSPA, matched RMSE, cases (i) to (vi). Flags with --by sensor, without a truth: mean, std and autocorrelation of
    residuals over their standard deviations, and share of outliers, which show the need of a calibration. A row
    without a fix lowers the fix rate and counts as infinite in the percentiles; RMSE, bias and NEES are of the rows
    with a fix. A terminal gets a line per metric (so does any output with --format text), a pipe or -o a table with a
    row per method and swept values, for plot. Exit codes: 0 done, 1 bad data or files, 2 usage error, 4 a --fail-if
    condition is met.
    """
    from nlosctl.jobs.evaluate import evaluate, evaluation_report

    as_text = write.format == _TEXT or Preview.wanted(write) is not None
    if write.format == _TEXT and write.output != "-":
        raise UsageError("--format text goes to standard output; leave out -o")
    evaluation, reasons = evaluate(
        inputs,
        read,
        write,
        truth=truth,
        estimates=estimates,
        ospa_order=ospa_order,
        ospa_cutoff_m=ospa_cutoff_m,
        best_alternative=alternatives == "best",
        by=by,
        fail_if=fail_if,
        wants_table=not as_text and (write.output != "-" or not json),
    )
    report = evaluation_report(evaluation, reasons)
    if json:
        print_json(report)
    elif as_text:
        _render(evaluation)
    Terminal(quiet).show_report([f"note: {note}" for note in evaluation.notes], report, write)
    for reason in reasons:
        print_message(f"nlosctl: {reason}")
    return _CONDITION_MET if reasons else 0


def _render(evaluation: Evaluation) -> None:
    """Print a column per group, a row per figure: readable however many figures there are."""
    groups = list(evaluation.groups)
    if len(groups) > 1 and evaluation.overall is not None:
        groups.append({"method": "overall", **evaluation.overall})
    titles = [_title(group, number) for number, group in enumerate(groups)]
    names = [name for name, value in groups[-1].items() if _is_metric(name, value)]
    if evaluation.of == "residuals":
        by_group = zip(titles, groups, strict=True)
        print_table(
            [{"group": title, **{name: _figure(of[name]) for name in names}} for title, of in by_group],
            ["group", *names],
        )
        return
    rows: list[dict[str, Any]] = [
        {"figure": name, **{title: _figure(group[name]) for title, group in zip(titles, groups, strict=True)}}
        for name in names
    ]
    words = dict.fromkeys(word for group in groups for word in group.get("statuses", {}))
    for word in words:
        counts = {title: str(group["statuses"].get(word, 0)) for title, group in zip(titles, groups, strict=True)}
        rows.append({"figure": f"status {word}", **counts})
    print_table(rows, ["figure", *titles])


def _is_metric(name: str, value: object) -> bool:
    from nlosctl.pipeline.evaluate.groups import is_label

    return isinstance(value, int | float) and not is_label(name)


def _title(group: dict[str, Any], number: int) -> str:
    from nlosctl.pipeline.evaluate.groups import group_title

    return group_title(group) or ("all" if number == 0 else f"group {number}")


def _figure(value: float) -> str:
    return str(value) if isinstance(value, int) else "-" if math.isnan(value) else f"{value:.6g}"
