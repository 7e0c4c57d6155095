"""Calibrations: the offset of each sensor, the covariance of the offsets, and factors of standard deviations.

Imports no numpy: the options of a run name this class.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import pi, sqrt

TYPE_CHECKING = False
if TYPE_CHECKING:
    from nlosctl.arrays import FloatArray

__all__ = ["OFFSETS", "Calibration", "OffsetKind", "SensorOffset"]


_LEAST_DOF = 3.0
"""With fewer degrees of freedom a factor of standard deviations counts as if it had these."""


@dataclass(frozen=True, kw_only=True)
class OffsetKind:
    """The offset of a kind of measurement: its names and unit in files, and the contract's column that it changes.

    The measurement in ``column`` is the true value plus the offset; ``scale`` converts the offset to the unit of the
    column.
    """

    name: str
    std_name: str
    unit: str
    column: str
    scale: float = 1.0


OFFSETS = {
    "bearings": OffsetKind(
        name="heading_offset_deg", std_name="heading_std_deg", unit="deg", column="bearing_rad", scale=pi / 180.0
    ),
    "ranges": OffsetKind(name="range_offset_m", std_name="range_offset_std_m", unit="m", column="range_m"),
    "arrivals": OffsetKind(name="arrival_offset_m", std_name="arrival_offset_std_m", unit="m", column="arrival_m"),
}
"""By kind of measurement. A heading's offset is counter-clockwise, like bearings."""


@dataclass(frozen=True, kw_only=True)
class SensorOffset:
    """The offset of a sensor, and the factor ``std_scale`` of its stated standard deviations.

    ``group`` are the values of the calibration's columns, in their order, for which the entry holds. ``std`` is None
    where the offset is not determined; both are in the unit of files, see `OffsetKind`. ``std_dof`` are the degrees of
    freedom that the factor was estimated with, None if it is exact.
    """

    name: str
    group: tuple[str, ...] = ()
    offset: float = 0.0
    std: float | None = None
    std_scale: float = 1.0
    std_dof: float | None = None

    @property
    def std_factor(self) -> float:
        """The factor of standard deviations that accounts for the error of ``std_scale``: that of Student's t.

        With d degrees of freedom the variance of t is d / (d - 2), the mean of 1 / f^2 over estimates f^2 of 1.
        """
        if self.std_dof is None:
            return self.std_scale
        dof = max(self.std_dof, _LEAST_DOF)
        return self.std_scale * sqrt(dof / (dof - 2.0))

    @property
    def key(self) -> tuple[str, ...]:
        """The name and the group."""
        return (self.name, *self.group)


@dataclass(frozen=True, kw_only=True, eq=False)
class Calibration:
    """The offsets of the sensors of one kind of measurement, by name and by the values of the columns ``by``.

    ``covariance`` (J, J) is that of the offsets of the entries ``order`` (indices), in squares of the unit of files.
    ``source`` is the file that it is from.
    """

    kind: str
    entries: tuple[SensorOffset, ...] = ()
    by: tuple[str, ...] = ()
    order: tuple[int, ...] = ()
    covariance: FloatArray | None = None
    source: str = "the calibration"

    @property
    def quantity(self) -> OffsetKind:
        """The names and the unit of the offsets."""
        return OFFSETS[self.kind]

    def correlated(self) -> FloatArray:
        """Return the covariance (E, E) of all entries, in squares of the unit of the column; zeros where unknown."""
        import numpy as np

        whole = np.zeros((len(self.entries),) * 2)
        if self.covariance is not None and self.order:
            whole[np.ix_(self.order, self.order)] = self.covariance * self.quantity.scale**2
        return whole
