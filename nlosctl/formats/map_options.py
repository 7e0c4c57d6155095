"""The options that the exporters of maps share."""

from __future__ import annotations

from dataclasses import dataclass

from nlosctl.contract.options import option

__all__ = ["MapOptions"]


@dataclass(frozen=True, kw_only=True)
class MapOptions:
    """What of each estimate is drawn."""

    ellipse: float = option(
        0.95, meaning="share of Gaussian errors that the ellipses hold", minimum=0.0, maximum=1.0, exclusive=True
    )
    vertices: int = option(72, meaning="vertices of an ellipse", minimum=8, maximum=3600)
