"""What steers a run of methods over measurements."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

from nlosctl.contract.fields import Field, SensorsField
from nlosctl.errors import UsageError

__all__ = ["RunSettings"]


@dataclass(frozen=True, kw_only=True)
class RunSettings:
    """What steers a run but changes no method: see the options of ``nlosctl localize``."""

    seed: int = 0
    jobs: int = 1
    block_size: int = 8192
    alternatives: int = 1
    carry: tuple[str, ...] = ()
    field: Field = dataclasses.field(default_factory=SensorsField)
    target_z_m: float | None = None
    want_estimates: bool = True
    want_flags: bool = False
    want_details: bool = False
    want_trace: bool = False
    ellipse: float | None = None
    add: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for name, least in (("seed", 0), ("jobs", 1), ("block_size", 1), ("alternatives", 1)):
            if getattr(self, name) < least:
                raise UsageError(f"{name} must be an int of at least {least}. Got {getattr(self, name)!r} instead.")
        if self.ellipse is not None and not 0.0 < self.ellipse < 1.0:
            raise UsageError(f"--ellipse must be a probability between 0 and 1. Got {self.ellipse!r} instead.")
