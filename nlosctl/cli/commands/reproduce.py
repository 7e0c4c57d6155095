"""``nlosctl reproduce``: a table or figure of one of the papers, theirs beside ours."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from nlosctl.cli.options.declarations import ConfigFile, Debug, Json, Quiet
from nlosctl.cli.options.settings import takes_options
from nlosctl.cli.terminal import Terminal, print_json, print_table
from nlosctl.contract.run_options import OutputOptions, SolveOptions
from nlosctl.errors import UsageError

if TYPE_CHECKING:
    from nlosctl.reproduce.experiment import Experiment
    from nlosctl.reproduce.outcome import ClaimRow
    from nlosctl.reproduce.run import Outcome

__all__ = ["reproduce"]


@takes_options(jobs=1)
def reproduce(
    names: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="NAME",
            help="Figures or tables, such as song-fig8; a paper; or all. Without it, list them.",
            show_default=False,
        ),
    ] = None,
    *,
    options: SolveOptions,
    write: OutputOptions,
    output: Annotated[
        str | None,
        typer.Option(
            "--output",
            "-o",
            metavar="FOLDER",
            rich_help_panel="Output",
            help="Folder of results, figures and samples; an interrupted run continues.",
            show_default=False,
        ),
    ] = None,
    trials: Annotated[
        int | None,
        typer.Option(
            "--trials",
            "-n",
            metavar="N",
            min=1,
            rich_help_panel="Method",
            help="Trials per condition; default: set by the experiment.",
        ),
    ] = None,
    quick: Annotated[
        bool,
        typer.Option(
            "--quick", rich_help_panel="Method", help="Few trials: seconds instead of minutes, larger errors."
        ),
    ] = False,
    page: Annotated[
        str | None,
        typer.Option(
            "--page",
            metavar="FILE",
            rich_help_panel="Output",
            help="Also write a Markdown page, with figures/ beside it.",
        ),
    ] = None,
    config: ConfigFile = None,
    json: Json = False,
    quiet: Quiet = False,
    debug: Debug = False,
) -> None:
    """Run the Monte Carlo simulation of a paper's figure or table and compare its claims with our results.

    Each of our numbers has a Monte Carlo standard error; the verdict allows three of them, and is "undecided" where
    they are too large (with --quick, often). The same seed gives the same files for any number of jobs, interrupted or
    not.

    Parameters (-p bearing_std_deg=0.5,2) replace those of the paper: the figure's numbers are printed, without claims.
    """
    if not names:
        if options.parameters or output is not None or page is not None or trials is not None or quick:
            raise UsageError("name a figure or table, or all; 'nlosctl reproduce' alone lists them")
        _list(json)
        return
    if quick and trials is not None:
        raise UsageError("--quick and --trials both set the number of trials; give one")
    if page is not None and options.parameters:
        raise UsageError("--page compares with the papers, and --param is for parameters of your own; leave one out")
    if page is not None and output is None:
        raise UsageError("--page needs -o FOLDER for the results and figures")
    from nlosctl.io.writers.output_set import check_targets
    from nlosctl.reproduce.catalogue import chosen_names, find_experiment
    from nlosctl.reproduce.run import output_folder
    from nlosctl.reproduce.variation import varied

    experiments = [varied(find_experiment(name), options.parameters) for name in chosen_names(names)]
    check_targets([page], overwrite=write.overwrite, inputs=[])
    folder = None if output is None else output_folder(output)
    terminal = Terminal(quiet=quiet)
    try:
        outcomes = _run(
            experiments,
            folder,
            terminal,
            quick=quick,
            trials=trials,
            seed=options.seed,
            jobs=options.jobs,
            overwrite=write.overwrite,
        )
    except KeyboardInterrupt:
        if folder is not None:
            terminal.note(f"finished chunks are kept in {folder}; the same command continues from them")
        raise
    missing = next((outcome.without_pictures for outcome in outcomes if outcome.without_pictures), None)
    if missing:
        terminal.note(f"no figures: {missing}")
    if page is not None:
        from nlosctl.reproduce.page import write_page

        write_page(Path(page), outcomes, overwrite=write.overwrite)
    _print(outcomes, json)


def _run(
    experiments: list[Experiment],
    folder: Path | None,
    terminal: Terminal,
    *,
    quick: bool,
    trials: int | None,
    seed: int,
    jobs: int,
    overwrite: bool,
) -> list[Outcome]:
    from nlosctl.pipeline.engine.workers import usable_jobs
    from nlosctl.reproduce.run import run_experiment

    outcomes = []
    for experiment in experiments:
        with terminal.progress(experiment.name, unit="trials") as progress:
            outcome = run_experiment(
                experiment,
                seed=seed,
                trials=trials or (experiment.quick_trials if quick else experiment.trials),
                folder=folder,
                overwrite=overwrite,
                jobs=usable_jobs(jobs),
                progress=progress,
            )
        outcomes.append(outcome)
        _note(terminal, outcome)
    return outcomes


def _note(terminal: Terminal, outcome: Outcome) -> None:
    total = outcome.trials * len(outcome.experiment.conditions)
    there = ""
    if outcome.resumed:
        there = ", all done before" if outcome.resumed == total else f", {outcome.resumed} of them done before"
    conditions = f"{outcome.trials} trials in each of {len(outcome.experiment.conditions)} conditions"
    files = "".join(f"\n  {path}" for path in outcome.files)
    terminal.note(f"{outcome.experiment.name}: {conditions}, seed {outcome.seed}{there}{files}")


def _list(json: bool) -> None:
    from nlosctl.reproduce.catalogue import experiment_names, find_experiment

    rows = []
    for experiment in map(find_experiment, experiment_names()):
        rows.append(
            {
                "name": experiment.name,
                "title": experiment.title,
                "paper": experiment.paper.reference,
                "conditions": len(experiment.conditions),
                "trials": experiment.trials,
                "quick_trials": experiment.quick_trials,
            }
        )
    if json:
        print_json(rows)
    else:
        print_table(rows, ["name", "title", "paper", "conditions", "trials"])


def _print(outcomes: list[Outcome], json: bool) -> None:
    rows = [row for outcome in outcomes for row in outcome.rows]
    plain = [outcome for outcome in outcomes if not outcome.rows]
    if json:
        numbers = [{"name": outcome.experiment.name, **row} for outcome in plain for row in _numbers(outcome)]
        print_json([*numbers, *map(_as_json, rows)])
        return
    for outcome in plain:
        _print_numbers(outcome)
    if not rows:
        return
    print_table(
        [
            {
                "name": row.experiment,
                "claim": row.claim,
                "paper": row.paper,
                "allowed": row.allowed,
                "ours": row.ours_text,
                "verdict": row.verdict or "beside the paper",
            }
            for row in rows
        ],
        ["name", "claim", "paper", "allowed", "ours", "verdict"],
    )


def _numbers(outcome: Outcome) -> list[dict[str, Any]]:
    """Return a row per condition: an experiment with other parameters than the paper's has no claims."""
    columns = {name: values.tolist() for name, values in outcome.numbers.items()}
    return [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]


def _print_numbers(outcome: Outcome) -> None:
    rows = [{name: value for name, value in row.items() if not name.endswith("_se")} for row in _numbers(outcome)]
    text = [{name: f"{v:.6g}" if isinstance(v, float) else str(v) for name, v in row.items()} for row in rows]
    print_table(text, [*text[0]])


def _as_json(row: ClaimRow) -> dict[str, Any]:
    return {
        "name": row.experiment,
        "claim": row.claim,
        "where": row.where,
        "paper": row.paper,
        "allowed": row.allowed,
        "ours": row.ours if math.isfinite(row.ours) else None,
        "standard_error": row.standard_error,
        "unit": row.unit,
        "verdict": row.verdict,
        "note": row.note,
    }
