"""Type-based clustering of unlabelled echoes for an unknown number of targets."""

from __future__ import annotations

from dataclasses import dataclass

from nlosctl.contract.batches import RangeBatch
from nlosctl.contract.methods import LEAST_HALF_CHI_SQUARE, MethodSpec
from nlosctl.contract.options import option
from nlosctl.contract.results import Solution
from nlosctl.solvers.echoes.echoes import Echoes
from nlosctl.solvers.echoes.structured_sets import ClusteringOptions, cluster_echoes, cut_at_elbow, echoes_of_sets
from nlosctl.solvers.echoes.targets import IDENTIFICATION_FLAGS, IdentifiedEchoes, identify
from nlosctl.solvers.echoes.type_sets import Gate

__all__ = ["METHOD", "ExtendedTypeClusteringOptions", "solve"]


@dataclass(frozen=True, kw_only=True)
class ExtendedTypeClusteringOptions(ClusteringOptions):
    """Parameters of ``extended-tca``."""

    eta: float = option(
        unit="m", minimum=0.0, exclusive=True, meaning="elbow threshold: the rise of the spread that ends the targets"
    )


def solve(batch: RangeBatch, options: ExtendedTypeClusteringOptions) -> Solution:
    """Find targets among unlabelled echoes: the unique structured sets before the elbow of the spread; (2)-(7).

    Every target needs an echo at every sensor. At least one target is identified if there is a structured set.
    """

    def find(echoes: Echoes, gate: Gate) -> IdentifiedEchoes:
        sets, kept = cluster_echoes(echoes, gate, options)
        return IdentifiedEchoes(echoes_of_sets(echoes, sets, cut_at_elbow(sets, kept, options.eta)))

    return identify(batch, options, find)


METHOD = MethodSpec(
    name="extended-tca",
    kind="ranges",
    job="identify-los",
    summary="type-based clustering, the number of targets from the elbow of the spread",
    reference="Liang, Zeng, Li, equations (2)-(9)",
    options=ExtendedTypeClusteringOptions,
    solve=solve,
    cost=LEAST_HALF_CHI_SQUARE,
    minimum_measurements=3,
    flags=IDENTIFICATION_FLAGS,
)
