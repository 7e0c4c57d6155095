"""Directions relative to an anchor's boresight: the scene contains its position and heading."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from nlosctl.contract.formats import ForeignFile, UnfitError
from nlosctl.errors import DataError
from nlosctl.formats.scene_sensors import SceneSensors, position_columns

__all__ = ["anchor_values", "anchors_of"]


def anchors_of(file: ForeignFile) -> SceneSensors:
    """Return the scene's sensors; raise DataError if it has none."""
    if not file.scene.sensors:
        raise DataError(
            f"{file.name}: directions from a boresight need a scene with the anchors: `scene` FILE with [[sensor]], "
            f"name, position and heading_deg"
        )
    return SceneSensors(file)


def anchor_values(
    anchors: SceneSensors, name: str, clockwise_deg: float, time: Mapping[str, Any], field: str
) -> dict[str, object]:
    """Return sensor name, position and azimuth of a direction ``clockwise_deg`` from the anchor's boresight at a time.

    Raises UnfitError if the scene lacks the anchor at this time, or its heading.
    """
    anchor = anchors.at(name, time, field)
    if anchor.heading_deg is None:
        raise UnfitError(
            f"the scene's sensor {name!r} has no heading_deg: set the azimuth of its boresight (from +y or north)",
            field,
        )
    return {"sensor": name, **position_columns(anchor), "azimuth_deg": (anchor.heading_deg + clockwise_deg) % 360.0}
