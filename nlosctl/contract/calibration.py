"""Calibrations: the offset of each sensor, the covariance of the offsets, and factors of standard deviations.

The deviation of an array of bearings has harmonics beside its offset, see `nlosctl.geometry.angles`. Imports no
numpy: the options of a run name this class.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import pi, sqrt

TYPE_CHECKING = False
if TYPE_CHECKING:
    from nlosctl.arrays import FloatArray

__all__ = ["OFFSETS", "Calibration", "Harmonic", "OffsetKind", "SensorOffset"]

_MOST_SECTORS, _SECTORS, _MOST_ROWS = 360, 24, 2000
"""Most and fewest sectors of a turn, and so many of all sensors."""


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
class Harmonic:
    """The part of an array's deviation that repeats ``order`` times a turn: its cosine and sine, in degrees.

    Standard deviations are None where the coefficient is not determined.
    """

    order: int
    cos: float = 0.0
    sin: float = 0.0
    cos_std: float | None = None
    sin_std: float | None = None


@dataclass(frozen=True, kw_only=True)
class SensorOffset:
    """The offset of a sensor, and the factor ``std_scale`` of its stated standard deviations.

    ``group`` are the values of the calibration's columns, in their order, for which the entry holds. ``std`` is None
    where the offset is not determined; both are in the unit of files, see `OffsetKind`. ``std_dof`` are the degrees of
    freedom that the factor was estimated with, None if it is exact. ``harmonics`` are those of the orders 1, 2, ... of
    its deviation.
    """

    name: str
    group: tuple[str, ...] = ()
    offset: float = 0.0
    std: float | None = None
    std_scale: float = 1.0
    std_dof: float | None = None
    harmonics: tuple[Harmonic, ...] = ()

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
    def terms(self) -> tuple[float, ...]:
        """The offset, and the cosine and sine of each harmonic."""
        return (self.offset, *(term for part in self.harmonics for term in (part.cos, part.sin)))

    @property
    def key(self) -> tuple[str, ...]:
        """The name and the group."""
        return (self.name, *self.group)


@dataclass(frozen=True, kw_only=True, eq=False)
class Calibration:
    """The offsets of the sensors of one kind of measurement, by name and by the values of the columns ``by``.

    All entries have as many ``harmonics``, so that each has T = 1 + 2 ``harmonics`` terms, numbered by the entry, then
    the term. ``covariance`` (J, J) is that of the terms ``order`` (numbers), in squares of the unit of files.
    ``source`` is the file that it is from.
    """

    kind: str
    entries: tuple[SensorOffset, ...] = ()
    by: tuple[str, ...] = ()
    order: tuple[int, ...] = ()
    covariance: FloatArray | None = None
    source: str = "the calibration"
    harmonics: int = 0

    @property
    def quantity(self) -> OffsetKind:
        """The names and the unit of the offsets."""
        return OFFSETS[self.kind]

    @property
    def terms(self) -> int:
        """The number of terms of an entry."""
        return 1 + 2 * self.harmonics

    @property
    def sectors(self) -> int:
        """The number of sectors of a turn that errors are correlated by: 1 where they do not depend on the direction.

        Within a sector of the direction relative to the heading the error of the deviation is that of its middle.
        """
        return 1 if not self.harmonics else max(min(_MOST_SECTORS, _MOST_ROWS // max(len(self.entries), 1)), _SECTORS)

    def correlated(self) -> FloatArray:
        """Return the covariance of all entries, each in all `sectors`, in squares of the unit of the column.

        Zeros where it is unknown.
        """
        import numpy as np

        whole = np.zeros((len(self.entries) * self.terms,) * 2)
        if self.covariance is not None and self.order:
            whole[np.ix_(self.order, self.order)] = self.covariance * self.quantity.scale**2
        if not self.harmonics or not self.entries:
            return whole
        from nlosctl.geometry.angles import deviation, deviation_terms

        edges = np.linspace(-pi, pi, 2 * self.sectors + 1)
        per_term = np.zeros((len(self.entries), self.sectors, whole.shape[0]))
        for number, entry in enumerate(self.entries):
            of = slice(number * self.terms, (number + 1) * self.terms)
            _, slope = deviation(edges[1::2], np.array(entry.terms) * self.quantity.scale)
            per_term[number, :, of] = deviation_terms(edges[1::2], self.terms) / (1.0 + slope[:, None])
        rows = per_term.reshape(-1, whole.shape[0])
        return np.asarray(rows @ whole @ rows.T)
