"""Type-based clustering of unlabelled echoes for a known number of targets."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import islice

from nlosctl.contract.batches import RangeBatch
from nlosctl.contract.methods import LEAST_HALF_CHI_SQUARE, MethodSpec
from nlosctl.contract.options import option
from nlosctl.contract.results import Solution
from nlosctl.solvers.echoes.echoes import Echoes
from nlosctl.solvers.echoes.structured_sets import ClusteringOptions, cluster_echoes, echoes_of_sets
from nlosctl.solvers.echoes.targets import IDENTIFICATION_FLAGS, IdentifiedEchoes, identify
from nlosctl.solvers.echoes.type_sets import Gate

__all__ = ["METHOD", "TypeClusteringOptions", "solve"]


@dataclass(frozen=True, kw_only=True)
class TypeClusteringOptions(ClusteringOptions):
    """Parameters of ``tca``."""

    targets: int = option(minimum=1, meaning="number of targets in every snapshot")


def solve(batch: RangeBatch, options: TypeClusteringOptions) -> Solution:
    """Find that many targets among unlabelled echoes: the unique structured sets of least spread.

    Every target needs an echo at every sensor. Fewer targets where there are fewer unique sets.
    """

    def find(echoes: Echoes, gate: Gate) -> IdentifiedEchoes:
        sets, kept = cluster_echoes(echoes, gate, options)
        return IdentifiedEchoes(echoes_of_sets(echoes, sets, list(islice(kept, options.targets))))

    return identify(batch, options, find)


METHOD = MethodSpec(
    name="tca",
    kind="ranges",
    job="identify-los",
    summary="type-based clustering for a known number of targets",
    reference="Liang, Li 2023; Liang, Zeng, Li, section III.A, equations (2)-(5)",
    options=TypeClusteringOptions,
    solve=solve,
    cost=LEAST_HALF_CHI_SQUARE,
    minimum_measurements=3,
    flags=IDENTIFICATION_FLAGS,
)
