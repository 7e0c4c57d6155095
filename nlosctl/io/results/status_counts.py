"""Counts of the statuses of estimates, over a whole file."""

from __future__ import annotations

from collections import Counter
from contextlib import closing
from dataclasses import dataclass, field

import pyarrow.compute as pc

from nlosctl.contract.tables import ESTIMATES
from nlosctl.io.results.plot_inputs import PlotInput
from nlosctl.io.results.reader import PlainReader

__all__ = ["StatusCounts", "count_statuses"]


@dataclass(frozen=True, kw_only=True)
class StatusCounts:
    """Rows of a file of estimates, and their statuses by method: without further alternatives."""

    rows: int
    by_method: dict[str, Counter[str]] = field(default_factory=dict)


def count_statuses(file: PlotInput) -> StatusCounts:
    """Return how often each status occurs, by method, in one pass; each target counts, its further alternatives not."""
    rows, counts = 0, dict[str, Counter[str]]()
    with closing(PlainReader(file.input(), ESTIMATES)) as reader:
        for table in reader.batches():
            rows += table.num_rows
            best = table.select(["method", "status"]).filter(pc.equal(table.column("alternative"), 0))
            found = best.group_by(["method", "status"]).aggregate([([], "count_all")])
            for row in found.to_pylist():
                counts.setdefault(str(row["method"]), Counter())[str(row["status"])] += row["count_all"]
    return StatusCounts(rows=rows, by_method=counts)
