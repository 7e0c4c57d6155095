"""``nlosctl evaluate``: estimates or flags against truth."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from nlosctl.cli.options.declarations import (
    ConfigFile,
    Debug,
    Format,
    InputFormat,
    Inputs,
    Json,
    Output,
    Overwrite,
    Quiet,
    Report,
)
from nlosctl.cli.shared.reading import open_output
from nlosctl.cli.shared.terminal import Preview, print_json, print_table, tell, tell_report, write_report
from nlosctl.errors import UsageError
from nlosctl.io.paths.locations import Location

if TYPE_CHECKING:
    from nlosctl.io.writers.output_set import OutputSet
    from nlosctl.pipeline.evaluate.evaluate import Evaluation

__all__ = ["evaluate"]

_CONDITION_MET = 4
_TEXT = "text"


def evaluate(
    inputs: Inputs,
    truth: Annotated[
        str | None,
        typer.Option("--truth", metavar="FILE", help="True positions (snapshot, truth_x_m, truth_y_m) by snapshot."),
    ] = None,
    estimates: Annotated[
        str | None,
        typer.Option("--estimates", metavar="FILE", help="Estimates that belong to flags of identify-los."),
    ] = None,
    ospa_order: Annotated[float, typer.Option("--ospa-order", min=1.0, help="Order p of OSPA and GOSPA.")] = 2.0,
    ospa_cutoff_m: Annotated[
        float, typer.Option("--ospa-cutoff-m", metavar="M", help="Cutoff c of OSPA and GOSPA.")
    ] = 20.0,
    alternatives: Annotated[
        Literal["first", "best"],
        typer.Option("--alternatives", help="Which alternative counts: the first, or the one nearest to the truth."),
    ] = "first",
    fail_if: Annotated[
        list[str],
        typer.Option(
            "--fail-if",
            metavar="CONDITION",
            help="Exit 4 if a figure of some method meets it: 'rmse_m>5', of one method: 'ml:rmse_m>5'. Repeatable.",
        ),
    ] = [],  # noqa: B006 - typer copies it
    output: Output = "-",
    format: Format = None,
    input_format: InputFormat = None,
    json: Json = False,
    report: Report = None,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
    debug: Debug = False,
    config: ConfigFile = None,
) -> int:
    """Hold estimates (or flags) against the truth: RMSE, bias, percentiles, NEES, ellipse coverage, by method.

    Flags of identify-los with --estimates: number of targets right, exact identification, precision and recall, OSPA
    and GOSPA, matched RMSE, cases (i) to (vi). A row without a fix counts in the fix rate and is infinite in the
    percentiles; RMSE, bias and NEES are of the rows with one. A terminal gets a line per figure (so does any output
    with --format text), a pipe or -o a table with a row per method and swept values, as plot draws it. Exit codes: 0
    done, 1 bad data or files, 2 the words of the command line, 4 a --fail-if condition is met.
    """
    from nlosctl.io.paths.inputs import expand_inputs
    from nlosctl.io.paths.locations import format_named
    from nlosctl.io.results.evaluation_arrays import TruthTable
    from nlosctl.io.writers.output_set import OutputSet, check_targets
    from nlosctl.pipeline.evaluate.evaluate import evaluate_inputs
    from nlosctl.pipeline.evaluate.evaluate_targets import evaluate_targets
    from nlosctl.pipeline.evaluate.fail_conditions import parse_condition

    conditions = [parse_condition(words) for words in fail_if]
    given = expand_inputs(inputs, None if input_format is None else format_named(input_format))
    paths = [part.path for table in given for part in table.parts if part.path is not None]
    check_targets([output, None if report == "-" else report], overwrite=overwrite, inputs=paths)
    if estimates is not None:
        if len(given) > 1:
            raise UsageError("--estimates goes with one file of flags; evaluate several one by one")
        if not ospa_cutoff_m > 0.0:
            raise UsageError(f"--ospa-cutoff-m must be larger than 0. Got {ospa_cutoff_m:g} instead.")
        evaluation = evaluate_targets(given[0], expand_inputs([estimates])[0], order=ospa_order, cutoff_m=ospa_cutoff_m)
    else:
        truth_table = None if truth is None else TruthTable(expand_inputs([truth])[0])
        evaluation = evaluate_inputs(given, truth=truth_table, best_alternative=alternatives == "best")
    reasons = [reason for condition in conditions for reason in condition.reasons(evaluation.groups)]
    content = {"of": evaluation.of, "groups": evaluation.groups, "overall": evaluation.overall, "failed": reasons}
    if json:
        print_json(content)
    with OutputSet() as outputs:
        if output != "-" or not json:
            _write(evaluation, output, format, overwrite, paths, outputs)
        write_report(report, content, outputs)
    tell_report(report, content)
    for reason in reasons:
        tell(f"nlosctl: {reason}")
    return _CONDITION_MET if reasons else 0


def _write(
    evaluation: Evaluation,
    output: str,
    format: str | None,
    overwrite: bool,
    inputs: Sequence[Location],
    outputs: OutputSet,
) -> None:
    from nlosctl.io.results.tables import score_table

    if format == _TEXT and output != "-":
        raise UsageError("--format text goes to standard output; leave out -o")
    if format == _TEXT or Preview.wanted(output, format) is not None:
        _render(evaluation)
        return
    table = score_table(evaluation.of, evaluation.groups)
    writer = open_output(output, table.schema, format_name=format, overwrite=overwrite, inputs=inputs, metadata={})
    outputs.take(writer).write(table)


def _render(evaluation: Evaluation) -> None:
    """Print a column per group, a row per figure: readable however many figures there are."""
    groups = list(evaluation.groups)
    if len(groups) > 1:
        groups.append({"method": "overall", **evaluation.overall})
    titles = [_title(group, number) for number, group in enumerate(groups)]
    names = [name for name, value in evaluation.overall.items() if isinstance(value, int | float)]
    rows: list[dict[str, Any]] = [
        {"figure": name, **{title: _figure(group[name]) for title, group in zip(titles, groups, strict=True)}}
        for name in names
    ]
    words = dict.fromkeys(word for group in groups for word in group.get("statuses", {}))
    for word in words:
        counts = {title: str(group["statuses"].get(word, 0)) for title, group in zip(titles, groups, strict=True)}
        rows.append({"figure": f"status {word}", **counts})
    print_table(rows, ["figure", *titles])


def _title(group: dict[str, Any], number: int) -> str:
    from nlosctl.pipeline.evaluate.evaluate import group_title

    return group_title(group) or ("all" if number == 0 else f"group {number}")


def _figure(value: float) -> str:
    return str(value) if isinstance(value, int) else "-" if math.isnan(value) else f"{value:.6g}"
