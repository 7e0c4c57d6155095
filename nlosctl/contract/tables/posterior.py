"""The columns of posterior maps."""

from __future__ import annotations

from nlosctl.contract.tables.columns import Column, Table

__all__ = ["POSTERIOR"]

POSTERIOR = Table(
    name="posterior",
    title="Posterior: the probability of the position on a grid of square cells, a row per cell",
    columns=(
        Column(name="snapshot", type="identifier", nullable=True, meaning="as in the measurements; in maps of all"),
        Column(name="x_m", type="number", unit="m", required=True, meaning="centre of the cell"),
        Column(name="y_m", type="number", unit="m", required=True, meaning="centre of the cell"),
        Column(name="probability", type="number", required=True, meaning="of the cell; those of a snapshot sum to 1"),
        Column(
            name="hpd",
            type="number",
            required=True,
            meaning="share of the smallest highest-density region that holds the cell, itself included",
        ),
    ),
)
