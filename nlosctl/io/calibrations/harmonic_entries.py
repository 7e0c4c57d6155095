"""Harmonics of deviations in calibration files: tables [[sensor.harmonic]] and terms of the covariance."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from nlosctl.contract.calibration import Harmonic, SensorOffset
from nlosctl.errors import DataError
from nlosctl.geometry.angles import deviation

__all__ = ["HARMONIC", "harmonic_values", "harmonics_of", "refuse_steep", "stds_of_terms", "term_keys", "term_names"]

HARMONIC = "harmonic"
_NAMES = {"cos_deg": "cos", "sin_deg": "sin", "cos_std_deg": "cos_std", "sin_std_deg": "sin_std"}
_DIRECTIONS = 720


def harmonics_of(tables: Any, where: str, number: Callable[..., float]) -> tuple[Harmonic, ...]:
    """Return the harmonics in the tables of an entry, of the orders 1, 2, ...

    ``number(value, where, least)`` checks a number. Raises DataError that names the key.
    """
    if not isinstance(tables, list) or not all(isinstance(table, dict) for table in tables):
        raise DataError(f"{where}: expected tables headed [[sensor.harmonic]], each with order, cos_deg and sin_deg")
    parts = []
    for index, table in enumerate(tables):
        here = f"{where}[{index}]"
        for key in table:
            if key not in ("order", *_NAMES):
                raise DataError(f"{here}.{key}: unknown key; a harmonic has order, {', '.join(_NAMES)}")
        if table.get("order") != index + 1 or isinstance(table["order"], bool):
            raise DataError(f"{here}.order: got {table.get('order')!r}, expected {index + 1}: orders are 1, 2, ...")
        missing = [name for name in ("cos_deg", "sin_deg") if name not in table]
        if missing:
            raise DataError(f"{here}.{missing[0]}: missing, expected a number of degrees")
        stds = {name: number(table[name], f"{here}.{name}", 0.0) for name in _NAMES if "std" in name and name in table}
        values = {name: number(table[name], f"{here}.{name}") for name in ("cos_deg", "sin_deg")}
        parts.append(Harmonic(order=index + 1, **{_NAMES[name]: value for name, value in {**values, **stds}.items()}))
    return tuple(parts)


def harmonic_values(part: Harmonic) -> dict[str, Any]:
    """Return a harmonic under its names in files; a std that is not determined is None."""
    return {"order": part.order, **{name: getattr(part, attribute) for name, attribute in _NAMES.items()}}


def term_keys(entries: Sequence[SensorOffset], harmonics: int) -> list[tuple[str, ...]]:
    """Return the keys of the terms in the order of a covariance: those of the entries, with the term if there are
    harmonics.
    """
    if not harmonics:
        return [entry.key for entry in entries]
    return [(*entry.key, name) for entry in entries for name in term_names(harmonics)]


def term_names(harmonics: int) -> list[str]:
    """Return the names of the terms of a deviation, such as "cos 1"."""
    return ["offset", *(f"{part} {order}" for order in range(1, harmonics + 1) for part in ("cos", "sin"))]


def refuse_steep(entry: SensorOffset, scale: float, where: str) -> None:
    """Raise DataError for a deviation so steep that two true directions have one bearing."""
    directions = np.linspace(-np.pi, np.pi, _DIRECTIONS, endpoint=False)
    slope = deviation(directions, np.array(entry.terms) * scale)[1]
    if slope.min() <= -1.0:
        at = np.degrees(directions[slope.argmin()])
        raise DataError(
            f"{where}: the deviation falls by {-slope.min():.3g} deg per degree at {at:.0f} deg, so that bearings turn "
            "back; expected less than 1"
        )


def stds_of_terms(entry: SensorOffset) -> list[tuple[int, float]]:
    """Return the numbers of the terms of an entry that have a standard deviation, each with it."""
    parts = (entry.std, *(std for part in entry.harmonics for std in (part.cos_std, part.sin_std)))
    return [(number, std) for number, std in enumerate(parts) if std is not None]
