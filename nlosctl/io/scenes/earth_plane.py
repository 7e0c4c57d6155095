"""The plane on the earth that a scene's frame tells."""

from __future__ import annotations

from functools import lru_cache

from nlosctl.contract.scene import EarthFrame
from nlosctl.geometry.earth import EarthPlane

__all__ = ["plane_of"]


@lru_cache(maxsize=64)
def plane_of(frame: EarthFrame) -> EarthPlane:
    """Return the plane of a frame; raises UsageError without pyproj, or where the CRS is of no use."""
    return EarthPlane(
        crs=frame.crs,
        origin_lat_deg=frame.origin_lat_deg,
        origin_lon_deg=frame.origin_lon_deg,
        rotation_deg=frame.rotation_deg,
    )
