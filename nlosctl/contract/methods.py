"""The specification of a method, to which a plugin's entry point refers."""

from __future__ import annotations

from collections.abc import Callable, Container, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

from nlosctl.arrays import FloatArray, Point
from nlosctl.contract.learning import Learning
from nlosctl.contract.results import Solution
from nlosctl.contract.scene import Scene
from nlosctl.contract.tables import ESTIMATES, FLAGS

__all__ = [
    "CONTRACT_VERSION",
    "HALF_CHI_SQUARE",
    "LEAST_HALF_CHI_SQUARE",
    "OLDEST_CONTRACT_VERSION",
    "CostAt",
    "Job",
    "Law",
    "MethodSpec",
    "contract_fault",
    "version_fault",
]

CONTRACT_VERSION = 1
"""The version of the contract that methods are written for; raised with every addition that a plugin may rely on."""

OLDEST_CONTRACT_VERSION = 1
"""The oldest version whose plugins still work; raised when something is taken away or changes its meaning."""

HALF_CHI_SQUARE = "half the chi-square of the residuals"
"""The ``cost`` of methods whose cost is that; others describe their own."""

LEAST_HALF_CHI_SQUARE = f"{HALF_CHI_SQUARE}, minimized"
"""The ``cost`` of methods that minimize it."""

Job = Literal["localize", "detect-ip", "identify-los"]

Law = Literal["frame", "order"]
"""The laws that a method may be exempt from: motions of the frame; permutations of the measurements."""


CostAt = Callable[[Any, Any, Point, float], FloatArray]
"""The negative log-likelihood of a batch under options at positions or of cells, see `MethodSpec.cost_at`."""


@dataclass(frozen=True, kw_only=True)
class MethodSpec:
    """A method, frozen.

    ``kind`` is the kind of measurement, ``options`` a frozen dataclass whose fields (declared with
    `nlosctl.contract.options.option`) are the method's parameters, ``flags`` the columns that it adds to the flags
    besides ``used``, ``cost`` a description of its cost, ``minimum_measurements`` the smallest number of rows it can
    solve. ``dimensions`` are those of the batches that it solves: 2, 3, or both. ``covariance_kinds`` states what its
    covariance may account for other than the noise, ``estimate_columns`` the optional columns of the estimates that it
    fills (``estimate_columns_with(options)`` those of an option), ``randomized`` whether it draws random numbers,
    ``traces`` whether it can return its steps, ``searches`` whether it stays within the search region, ``reads`` the
    optional columns that it uses. ``details`` are further columns of the flags if the batch wants details,
    ``flags_with(options)`` those of an option; ``flags_needing`` names, for some columns, the input column without
    which they have no values. ``remark(options)`` is what the summary states of a run. ``estimates`` is false for a
    detector that estimates nothing. ``learning`` is how it estimates options from the whole input, if it can.
    ``scales_std`` is whether it estimates the factor of unknown standard deviations, see `Batch.std`: then its fix
    does not depend on the factor, it returns the columns ``std_factor`` and ``std_dof`` in place of a chi-square, and
    `Status.STD_NOT_ESTIMABLE` for a fix whose factor is not determined. ``std_fault(options, pool)`` is why it can't
    with some options for a ``pool`` of `SolveOptions.estimate_std`, empty if it can. ``direct_rows(batch,
    options, known_m)`` of a robust method returns the likeliest position (B, D), or the known one, and the probability
    (B, K) of each row to be direct there, NaN without a position: the weights of its residuals for unknown standard
    deviations and offsets. ``path_rows(batch, options)`` is how the rows enter the likelihood of a path, each at a
    position of its own (`nlosctl.solvers.tracking.path_rows`); None: the method can't track. ``line_rows(batch,
    options)`` of a weighted linear fit returns its `nlosctl.solvers.bearings.line_fits.WeightedLines`, None where it
    has none, for weights of rows that share errors. ``cost_at(batch, options, points, cell_m)`` is the negative
    log-likelihood (B, P) at positions, D arrays (B, P) in the frame, apart from a constant of the snapshot, infinite
    where none is possible: the posterior of `nlosctl posterior`. Where ``cell_m`` > 0 it is that of the mean density of
    a square cell about each position, as closely as a wider standard deviation gives that. A height of the target that
    is held exactly is no coordinate: D is 2 then. ``contract_version`` is the version of this contract that a plugin
    was written for; built-in methods leave it out. ``solve(batch, options)`` is pure: it changes nothing and draws only
    from ``batch.seed``.
    """

    name: str
    kind: str
    job: Job
    summary: str
    reference: str
    options: type[Any]
    solve: Callable[[Any, Any], Solution]
    cost: str
    minimum_measurements: int
    dimensions: tuple[int, ...] = (2,)
    flags: tuple[str, ...] = ()
    flags_needing: Mapping[str, str] = field(default_factory=dict)
    details: tuple[str, ...] = ()
    flags_with: Callable[[Any], tuple[str, ...]] | None = None
    estimates: bool = True
    covariance_kinds: tuple[str, ...] = ()
    estimate_columns: tuple[str, ...] = ()
    estimate_columns_with: Callable[[Any], tuple[str, ...]] | None = None
    randomized: bool = False
    traces: bool = False
    searches: bool = False
    remark: Callable[[Any], str] | None = None
    reads: frozenset[str] = frozenset()
    exempt_from: frozenset[Law] = frozenset()
    learning: Learning | None = None
    scales_std: bool = False
    std_fault: Callable[[Any, str], str] | None = None
    direct_rows: Callable[..., tuple[FloatArray, FloatArray]] | None = None
    path_rows: Callable[[Any, Any], Any] | None = None
    line_rows: Callable[..., Any] | None = None
    cost_at: CostAt | None = None
    contract_version: int | None = None

    def flag_columns(
        self, options: Any, scene: Scene, given: Container[str], *, details: bool, dimension: int = 2
    ) -> tuple[str, ...]:
        """Return the columns that it adds to the flags under ``options``, with or without the details.

        Some require a horizon in the scene, three dimensions, or another column among those of the input (``given``).
        """
        asked_for = () if self.flags_with is None else self.flags_with(options)
        of_horizons = {column.name for column in FLAGS.columns if column.of_horizons}
        of_space = {column.name for column in FLAGS.columns if column.of_space}
        needs = self.flags_needing
        return tuple(
            name
            for name in (*self.flags, *asked_for, *(self.details if details else ()))
            if (scene.has_horizons(dimension) or name not in of_horizons)
            and (dimension == 3 or name not in of_space)
            and (name not in needs or needs[name] in given)
        )

    def all_estimate_columns(self, options: Any, dimension: int = 2) -> tuple[str, ...]:
        """Return the optional columns of the estimates that it fills under ``options`` in this dimension."""
        further = () if self.estimate_columns_with is None else self.estimate_columns_with(options)
        of_space = {column.name for column in ESTIMATES.columns if column.of_space}
        return tuple(name for name in (*self.estimate_columns, *further) if dimension == 3 or name not in of_space)

    @property
    def full_name(self) -> str:
        """The name of its entry point: ``kind.name``."""
        return f"{self.kind}.{self.name}"


def contract_fault(version: int | None) -> str:
    """Return why a plugin written for a version of the contract can't be used here; empty if it can."""
    return version_fault(version, CONTRACT_VERSION, OLDEST_CONTRACT_VERSION, "MethodSpec")


def version_fault(version: int | None, here: int, oldest: int, spec: str) -> str:
    """Return why a plugin for ``version`` can't be used by version ``here``, which supports ``oldest`` and later."""
    if version is None:
        return f"doesn't state its contract version: give its {spec} contract_version={here}"
    if version > here:
        return f"was written for contract version {version}, newer than {here} of this nlosctl: upgrade nlosctl"
    if version < oldest:
        return (
            f"was written for contract version {version}, older than {oldest}, the oldest that this nlosctl works "
            "with: upgrade the plugin, or install an older nlosctl"
        )
    return ""
