"""The page that tells all claims of the papers with our numbers, verdicts, errata and pictures."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from itertools import groupby
from pathlib import Path

from nlosctl.io.writers.byte_output import write_text
from nlosctl.reproduce.outcome import ClaimRow
from nlosctl.reproduce.run import Outcome
from nlosctl.reproduce.verdicts import Verdict
from nlosctl.version import __version__

__all__ = ["write_page"]

_PICTURES = "figures"

_HEAD = """\
# What the papers claim, and what we get

Made by `make papers` (`nlosctl reproduce all -o out/papers --page docs/papers.md`) with {version}, from the trials
told below; nothing here is written by hand. A number of ours stands with its Monte-Carlo standard error. The verdict is
*reproduced* where the number lies in the range that the claim allows (the printed digits, or what the words of the text
mean), give or take three standard errors. It is *no numbers in the text* where the text gives nothing that could be
wrong: most of the papers' figures are curves without a table. Rows in italics are not the papers': they tell what we
recommend instead, on the same trials.
"""


def write_page(path: Path, outcomes: Sequence[Outcome]) -> None:
    """Write the page to ``path`` and copy the pictures to a folder ``figures`` beside it.

    Raises DataError where it can't be written.
    """
    _copy_pictures(path, outcomes)
    parts = [_HEAD.format(version=f"nlosctl {__version__}"), _summary(outcomes)]
    for _, group in groupby(outcomes, key=lambda outcome: outcome.experiment.paper.name):
        parts.append(_paper(list(group)))
    write_text(str(path), "\n".join(parts))


def _copy_pictures(path: Path, outcomes: Sequence[Outcome]) -> None:
    folder = path.parent / _PICTURES
    folder.mkdir(exist_ok=True)
    for outcome in outcomes:
        for file in outcome.files:
            if file.suffix == ".svg":
                shutil.copyfile(file, folder / file.name)


def _summary(outcomes: Sequence[Outcome]) -> str:
    lines = ["| paper | figures and tables | claims | reproduced | not reproduced | no numbers in the text |"]
    lines.append("|---|---|---|---|---|---|")
    for _, group in groupby(outcomes, key=lambda outcome: outcome.experiment.paper.name):
        own = list(group)
        rows = [row for outcome in own for row in outcome.rows if row.verdict is not None]
        counts = [sum(row.verdict == verdict for row in rows) for verdict in Verdict]
        cells = [own[0].experiment.paper.reference, len(own), len(rows), *counts]
        lines.append(f"| {' | '.join(map(str, cells))} |")
    return "\n".join([*lines, ""])


def _paper(outcomes: Sequence[Outcome]) -> str:
    paper = outcomes[0].experiment.paper
    parts = [f"## {paper.reference}\n"]
    failed = [row for outcome in outcomes for row in outcome.rows if row.verdict == Verdict.NOT_REPRODUCED]
    if failed:
        parts.append("What does not reproduce:\n")
        parts += map(_failure, failed)
        parts.append("")
    parts += [_experiment(outcome) for outcome in outcomes]
    if paper.errata:
        parts += ["### Where the text is in error\n", "| where | printed | right |", "|---|---|---|"]
        parts += [f"| {_text(slip.where)} | {_text(slip.printed)} | {_text(slip.right)} |" for slip in paper.errata]
        parts.append("")
    return "\n".join(parts)


def _failure(row: ClaimRow) -> str:
    said = f"- {_text(row.claim)} (`{row.experiment}`, {_text(row.where)}): paper {_text(row.paper)}, ours {row.told}."
    return f"{said} {_text(row.note)}".rstrip()


def _experiment(outcome: Outcome) -> str:
    experiment = outcome.experiment
    counted = f"{outcome.trials} {'trials' if experiment.random else 'places'}"
    lines = [
        f"### {experiment.name}: {experiment.title}\n",
        f"`nlosctl reproduce {experiment.name}`: {counted} in each of {len(experiment.conditions)} conditions, "
        f"seed {outcome.seed}.\n",
        "| claim | where | paper | ours | verdict |",
        "|---|---|---|---|---|",
        *map(_row, outcome.rows),
        "",
    ]
    notes = list(dict.fromkeys(row.note for row in outcome.rows if row.note))
    lines += [f"- {_text(note)}" for note in notes]
    if any(file.suffix == ".svg" for file in outcome.files):
        lines += [*([""] if notes else []), f"![{experiment.title}]({_PICTURES}/{experiment.name}.svg)"]
    return "\n".join([*lines, ""])


def _row(row: ClaimRow) -> str:
    if row.verdict is None:
        return f"| *{_text(row.claim)}* | | | {row.told} | |"
    said = f"**{row.verdict}**" if row.verdict == Verdict.NOT_REPRODUCED else row.verdict
    return f"| {_text(row.claim)} | {_text(row.where)} | {_text(row.paper)} | {row.told} | {said} |"


def _text(words: str) -> str:
    """Return words that Markdown takes as they are within a table."""
    return words.replace("|", "\\|").replace("*", "\\*").replace("<", "&lt;").replace("_", "\\_")
