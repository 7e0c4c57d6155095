"""Which experiments there are. A new one is a file with an ``EXPERIMENT`` and a word here."""

from __future__ import annotations

from collections.abc import Sequence
from importlib import import_module
from typing import TYPE_CHECKING

from nlosctl.errors import UsageError, did_you_mean

if TYPE_CHECKING:
    from nlosctl.reproduce.experiment import Experiment

__all__ = ["chosen_names", "experiment_names", "find_experiment"]

_ITEMS = {
    "song": ("fig5", "fig6", "fig7", "fig8", "fig9"),
    "madhow": ("fig2", "fig3", "fig4", "fig5", "fig6", "fig7", "fig8", "fig9", "fig10", "fig11"),
    "liang": ("fig2", "fig3", "fig4", "table1", "table2"),
    "shen": ("fig4", "fig5", "fig6", "fig7", "fig8", "table1", "table3", "table4", "table5"),
}
"""Figures and tables by paper, in the order of the paper; the module is ``PAPER_ITEM``."""


def experiment_names() -> list[str]:
    """Return the names of all experiments; imports none."""
    return [f"{paper}-{item}" for paper, items in _ITEMS.items() for item in items]


def find_experiment(name: str) -> Experiment:
    """Return the experiment ``name``; raise UsageError with the nearest name where there is none."""
    if name not in experiment_names():
        raise UsageError(
            f"no figure or table {name!r}{did_you_mean(name, experiment_names())}; 'nlosctl reproduce' lists them"
        )
    experiment: Experiment = import_module(f"nlosctl.reproduce.{name.replace('-', '.', 1)}").EXPERIMENT
    return experiment


def chosen_names(words: Sequence[str]) -> list[str]:
    """Return the names that words choose, each once: a name, a paper (all of it), or ``all``."""
    names: list[str] = []
    for word in words:
        items = [name for name in experiment_names() if word in ("all", name.partition("-")[0])]
        names += items or [find_experiment(word).name]
    return list(dict.fromkeys(names))
