"""Directions relative to an anchor's boresight: the scene contains its position and heading."""

from __future__ import annotations

from nlosctl.contract.formats import ForeignFile, UnfitError
from nlosctl.contract.scene import Sensor
from nlosctl.errors import DataError, did_you_mean

__all__ = ["anchor_values", "anchors_of"]


def anchors_of(file: ForeignFile) -> dict[str, Sensor]:
    """Return the scene's sensors by name; raise DataError if it has none."""
    if not file.scene.sensors:
        raise DataError(
            f"{file.name}: directions from a boresight need a scene with the anchors: `scene` FILE with [[sensor]], "
            f"name, position and heading_deg"
        )
    return file.scene.stationary_sensors("the importer")


def anchor_values(anchors: dict[str, Sensor], name: str, clockwise_deg: float, field: str) -> dict[str, object]:
    """Return sensor name, position and azimuth of a direction ``clockwise_deg`` from the anchor's boresight.

    Raises UnfitError if the scene lacks the anchor or its heading.
    """
    if name not in anchors:
        raise UnfitError(f"the scene has no sensor {name[:60]!r}{did_you_mean(name, anchors)}", field)
    anchor = anchors[name]
    if anchor.heading_deg is None:
        raise UnfitError(
            f"the scene's sensor {name!r} has no heading_deg: set the azimuth of its boresight (from +y or north)",
            field,
        )
    return {
        "sensor": name,
        "sensor_x_m": anchor.position[0],
        "sensor_y_m": anchor.position[1],
        "sensor_z_m": anchor.z_m,
        "azimuth_deg": (anchor.heading_deg + clockwise_deg) % 360.0,
    }
