"""Names of the experiments. A new one is a file with an ``EXPERIMENT`` and an item here."""

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
    "lenth": ("coverage",),
}
"""Figures and tables by paper, in the order of the paper."""
_SHARED_MODULES = {
    "liang": {"table1": "tables", "table2": "tables"},
    "shen": {"fig5": "roc", "fig6": "roc", "fig7": "roc"},
}
"""Modules with several experiments, each a constant named after its item; others are modules PAPER.ITEM."""


def experiment_names() -> list[str]:
    """Return the names of all experiments; imports none."""
    return [f"{paper}-{item}" for paper, items in _ITEMS.items() for item in items]


def find_experiment(name: str) -> Experiment:
    """Return the experiment ``name``; raise UsageError with the nearest name if it is unknown."""
    if name not in experiment_names():
        raise UsageError(
            f"no figure or table {name!r}{did_you_mean(name, experiment_names())}; 'nlosctl reproduce' lists them"
        )
    paper, _, item = name.partition("-")
    shared = _SHARED_MODULES.get(paper, {}).get(item)
    module = import_module(f"nlosctl.reproduce.{paper}.{shared or item}")
    experiment: Experiment = getattr(module, item.upper() if shared else "EXPERIMENT")
    return experiment


def chosen_names(words: Sequence[str]) -> list[str]:
    """Return the chosen names, each once: a word is a name, a paper (all of its items), or ``all``."""
    names: list[str] = []
    for word in words:
        items = [name for name in experiment_names() if word in ("all", name.partition("-")[0])]
        names += items or [find_experiment(word).name]
    return list(dict.fromkeys(names))
