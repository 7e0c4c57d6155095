"""How paths are found: the motion, gaps, smoothing or filtering."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from nlosctl.contract.options import option, parse_options
from nlosctl.contract.windows import parse_window
from nlosctl.errors import UsageError
from nlosctl.solvers.tracking.assigned_fixes import AssociationRule

__all__ = ["TrackOptions", "track_options"]

DENSITY = "acceleration_psd"
_UNITS = 1e-6


@dataclass(frozen=True, kw_only=True)
class MotionOptions:
    """Parameters of the motion."""

    acceleration_psd: float | None = option(
        None, unit="m2/s3", meaning="power spectral density of the white acceleration, per axis"
    )


@dataclass(frozen=True, kw_only=True)
class AssociationOptions:
    """Parameters of ``associate``."""

    speed_std_m_s: float = option(
        10.0, unit="m/s", minimum=0.0, exclusive=True, meaning="standard deviation of a new track's velocity, per axis"
    )
    gate_probability: float = option(
        1e-4, minimum=0.0, maximum=1.0, exclusive=True, meaning="probability that a target is outside its track's gate"
    )
    misses: int = option(5, minimum=1, meaning="snapshots in a row without its target after which a track ends")


_OF_ASSOCIATION = tuple(field.name for field in dataclasses.fields(AssociationOptions))


@dataclass(frozen=True, kw_only=True)
class TrackOptions:
    """``density`` is q in m2/s3, None: estimated; a gap longer than ``gap_s`` begins a new track.

    ``causal``: each state given the rows until then, else given all rows. ``association`` is how targets are assigned
    to tracks, None where columns separate them.
    """

    density: float | None
    gap_s: float = math.inf
    causal: bool = False
    association: AssociationRule | None = None

    @property
    def covariance_kind(self) -> str:
        """What the covariances are given."""
        return "filtered" if self.causal else "smoothed"

    def as_dict(self) -> dict[str, Any]:
        """Return the options as plain values for the provenance."""
        gap = {} if math.isinf(self.gap_s) else {"gap_s": self.gap_s}
        density = "estimated" if self.density is None else self.density
        rule = {} if self.association is None else {"associate": dataclasses.asdict(self.association)}
        return {DENSITY: density, **gap, **rule, "covariance_kind": self.covariance_kind}


def track_options(
    parameters: Mapping[str, Any],
    *,
    gap: str | None,
    causal: bool,
    estimate_acceleration: bool,
    associate: bool = False,
) -> tuple[TrackOptions, dict[str, Any]]:
    """Return the options of a track, and the parameters that are left for the method; raises UsageError."""
    own = {name: value for name, value in parameters.items() if name == DENSITY}
    matching = {name: value for name, value in parameters.items() if associate and name in _OF_ASSOCIATION}
    rest = {name: value for name, value in parameters.items() if name not in own and name not in matching}
    density = parse_options(MotionOptions, own, "track").acceleration_psd
    if (density is None) != estimate_acceleration:
        fault = "both set it; give one" if estimate_acceleration else "is needed: give a number, or estimate it"
        raise UsageError(
            f"`parameters` {DENSITY} {'and' if estimate_acceleration else 'or'} `estimate_acceleration` {fault}"
        )
    if density is not None and not 0.0 < density < math.inf:
        raise UsageError(
            f"`parameters` {DENSITY} must be a finite number larger than 0 (m2/s3); a small one is nearly a "
            f"constant velocity. Got {density:g} instead."
        )
    gap_s = math.inf
    if gap is not None:
        width = parse_window(gap, "`gap`")
        if not isinstance(width, int):
            raise UsageError(f"`gap` must be a time with its unit, such as 60s or 5min. Got {gap!r} instead.")
        gap_s = width * _UNITS
    rule = None
    if associate:
        if density is None:
            raise UsageError(f"`associate` predicts where targets will be: it needs `parameters` {DENSITY}")
        of = parse_options(AssociationOptions, matching, "associate")
        rule = AssociationRule(density=density, **dataclasses.asdict(of))
    return TrackOptions(density=density, gap_s=gap_s, causal=causal, association=rule), rest
