"""Type-based clustering of unlabelled echoes (Liang, Zeng, Li): from echoes to unique structured sets."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np

from nlosctl.arrays import IntArray
from nlosctl.contract.options import option
from nlosctl.solvers.echoes.echoes import Echoes
from nlosctl.solvers.echoes.structured_sets import StructuredSets, build_sets, unique_sets
from nlosctl.solvers.echoes.targets import IdentificationOptions
from nlosctl.solvers.echoes.type_sets import Gate, cross_all, find_seeds, gather_circles

__all__ = ["ClusteringOptions", "cluster_echoes", "echoes_of_sets"]


@dataclass(frozen=True, kw_only=True)
class ClusteringOptions(IdentificationOptions):
    """Parameters that the clustering methods share."""

    unique: Literal["points", "circles"] = option(
        "points", meaning="what two targets may not share: a crossing point (as the paper has it), or a circle"
    )


def cluster_echoes(echoes: Echoes, gate: Gate, options: ClusteringOptions) -> tuple[StructuredSets, Iterator[int]]:
    """Return the structured sets of a snapshot, and the places of the unique ones by rising spread."""
    table = cross_all(echoes, options.gap_tolerance_m, gate)
    circles, seeds = gather_circles(table, find_seeds(table))
    sets = build_sets(table, circles, seeds)
    return sets, unique_sets(sets, options.unique)


def echoes_of_sets(echoes: Echoes, sets: StructuredSets, chosen: list[int]) -> IntArray:
    """Return the echo (T, N) that each chosen set takes of each sensor."""
    return sets.circles[np.array(chosen, dtype=np.int64)] - np.arange(echoes.sensors) * echoes.most
