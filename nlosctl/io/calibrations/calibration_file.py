"""Calibrations from TOML, checked entry by entry, and to TOML."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from nlosctl.arrays import FloatArray
from nlosctl.contract.calibration import OFFSETS, Calibration, OffsetKind, SensorOffset
from nlosctl.contract.limits import LARGEST_NUMBER, parse_toml, read_limited
from nlosctl.errors import DataError, did_you_mean, hide_secrets
from nlosctl.io.calibrations.harmonic_entries import (
    HARMONIC,
    harmonic_values,
    harmonics_of,
    refuse_steep,
    stds_of_terms,
    term_keys,
)
from nlosctl.io.paths.locations import location, near_name
from nlosctl.io.scenes.scene_file import toml_value

__all__ = ["calibration_digest", "calibration_from_toml", "calibration_to_toml", "entry_values", "read_calibration"]

_TABLES = ("calibration", "sensor", "covariance")
_SYMMETRIC = 1e-9
"""Entries of a covariance that differ by more than this share of their variances are not symmetric."""

_DEVIATION = """
#  + sum over the orders m of cos_deg cos(m phi) + sin_deg sin(m phi), phi the true bearing less the heading"""

_NEGATIVE = 1e-6
"""Eigenvalues of correlations down to this much below zero are rounding."""


def read_calibration(name: str) -> Calibration:
    """Return the calibration in a file; raises DataError if it does not exist or is malformed."""
    path = location(name)
    try:
        text = read_limited(path, hide_secrets(str(path)))
    except OSError as error:
        raise DataError(f"{path}: the calibration can't be read: {error.strerror}{near_name(path)}") from error
    return replace(calibration_from_toml(text, hide_secrets(str(path))), source=hide_secrets(str(path)))


def calibration_from_toml(text: str, name: str) -> Calibration:
    """Return the calibration in TOML ``text``; ``name`` is the file's name, for messages.

    Offsets without a place in the covariance have their own variances. Raises DataError that names the key, with the
    value and what was expected.
    """
    tree = parse_toml(text, name)
    for key in tree:
        if key not in _TABLES:
            near = did_you_mean(key, _TABLES)
            raise DataError(f"{name}: unknown key {key!r}{near}; a calibration has [[sensor]] and [covariance]")
    tables = tree.get("sensor", [])
    if not isinstance(tables, list) or not tables or not all(isinstance(entry, dict) for entry in tables):
        raise DataError(f"{name}: sensor: expected tables headed [[sensor]], each with a name and an offset")
    kind = _kind_of(tables[0], f"{name}: sensor[0]")
    by = tuple(key for key in tables[0] if key not in _own_keys(kind))
    entries = tuple(_entry(entry, kind, by, f"{name}: sensor[{index}]") for index, entry in enumerate(tables))
    first: dict[tuple[str, ...], int] = {}
    for index, entry in enumerate(entries):
        if first.setdefault(entry.key, index) < index:
            raise DataError(
                f"{name}: sensor[{index}]: {_label(entry.key)} is sensor[{first[entry.key]}] already; give each sensor "
                "one entry"
            )
    harmonics = _harmonics(entries, kind, name)
    places = {key: number for number, key in enumerate(term_keys(entries, harmonics))}
    order, covariance = _covariance(tree.get("covariance", {}), places, f"{name}: covariance")
    size = 1 + 2 * harmonics
    stds = {index * size + term: std for index, entry in enumerate(entries) for term, std in stds_of_terms(entry)}
    more = [number for number in stds if number not in order]
    variances = np.array([stds[number] ** 2 for number in more])
    whole = np.zeros((len(order) + len(more),) * 2)
    whole[: len(order), : len(order)] = covariance
    np.fill_diagonal(whole[len(order) :, len(order) :], variances)
    return Calibration(kind=kind, entries=entries, by=by, order=(*order, *more), covariance=whole, harmonics=harmonics)


def _harmonics(entries: Sequence[SensorOffset], kind: str, name: str) -> int:
    """Return the number of harmonics of all entries; raise DataError if they differ, or a deviation is too steep."""
    harmonics = len(entries[0].harmonics)
    for index, entry in enumerate(entries):
        where = f"{name}: sensor[{index}].{HARMONIC}"
        if len(entry.harmonics) != harmonics:
            raise DataError(f"{where}: got {len(entry.harmonics)}, and sensor[0] has {harmonics}; give as many")
        if harmonics and kind != "bearings":
            raise DataError(f"{where}: {kind} have no harmonics; only bearings have")
        if harmonics:
            refuse_steep(entry, OFFSETS[kind].scale, where)
    return harmonics


def _kind_of(entry: Mapping[str, Any], where: str) -> str:
    kinds = [kind for kind, offset in OFFSETS.items() if offset.name in entry]
    names = [offset.name for offset in OFFSETS.values()]
    if len(kinds) != 1:
        near = next((hint for key in entry if (hint := did_you_mean(key, names))), "")
        got = " and ".join(OFFSETS[kind].name for kind in kinds) or "no offset"
        raise DataError(f"{where}: got {got}, expected one of {', '.join(names)}{near}")
    return kinds[0]


def _entry(entry: Mapping[str, Any], kind: str, by: tuple[str, ...], where: str) -> SensorOffset:
    quantity = OFFSETS[kind]
    if "name" not in entry:
        raise DataError(f"{where}.name: missing, expected text")
    own = _kind_of(entry, where)
    if own != kind:
        raise DataError(f"{where}: has {OFFSETS[own].name}, and sensor[0] {quantity.name}; give one kind of offset")
    given = tuple(key for key in entry if key not in _own_keys(kind))
    if sorted(given) != sorted(by):
        key = min({*given} ^ {*by})
        fault = "given" if key in given else "missing"
        raise DataError(f"{where}.{key}: {fault}, unlike in sensor[0]; give the same columns in all entries")
    name, *group = (_text(entry[key], f"{where}.{key}") for key in ("name", *by))
    std = _number(entry[quantity.std_name], f"{where}.{quantity.std_name}", 0.0) if quantity.std_name in entry else None
    scale = _number(entry.get("std_scale", 1.0), f"{where}.std_scale", 0.0)
    if scale == 0.0:
        raise DataError(f"{where}.std_scale: got 0, expected a number larger than 0")
    dof = _number(entry["std_dof"], f"{where}.std_dof", 0.0) if "std_dof" in entry else None
    offset = _number(entry[quantity.name], f"{where}.{quantity.name}")
    harmonics = harmonics_of(entry.get(HARMONIC, []), f"{where}.{HARMONIC}", _number)
    return SensorOffset(
        name=name, group=tuple(group), offset=offset, std=std, std_scale=scale, std_dof=dof, harmonics=harmonics
    )


def _own_keys(kind: str) -> tuple[str, ...]:
    """Return the keys of an entry that are not columns of the input."""
    return "name", "std_scale", "std_dof", HARMONIC, OFFSETS[kind].name, OFFSETS[kind].std_name


def _text(value: Any, where: str) -> str:
    if not isinstance(value, str | int | float) or isinstance(value, bool):
        raise DataError(f"{where}: got {value!r}, expected text")
    return str(value)


def _number(value: Any, where: str, least: float = -math.inf) -> float:
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    if not is_number or not least <= value or not abs(value) <= LARGEST_NUMBER:
        expected = "a finite number" if least == -math.inf else "a finite number of at least 0"
        raise DataError(f"{where}: got {value!r}, expected {expected}")
    return float(value)


def _covariance(table: Any, first: Mapping[tuple[str, ...], int], where: str) -> tuple[tuple[int, ...], FloatArray]:
    """Return the indices of the entries that a covariance is of, and the covariance (J, J)."""
    if not isinstance(table, dict) or not {*table} <= {"order", "matrix"} or len(table) == 1:
        raise DataError(f"{where}: got {sorted(table)}, expected order and matrix")
    if not table:
        return (), np.zeros((0, 0))
    order, rows = table["order"], table["matrix"]
    if not isinstance(order, list) or not isinstance(rows, list) or not all(isinstance(row, list) for row in rows):
        raise DataError(f'{where}: expected order = ["NAME", ...] and matrix = [[...], ...]')
    keys = [tuple(map(str, key)) if isinstance(key, list) else (str(key),) for key in order]
    for number, key in enumerate(keys):
        if key not in first or key in keys[:number]:
            fault = "is named twice" if key in first else "has no entry [[sensor]]"
            raise DataError(f"{where}.order[{number}]: {_label(key)} {fault}")
    if len(rows) != len(keys):
        raise DataError(f"{where}.matrix: got {len(rows)} rows, expected {len(keys)}, one for each of order")
    for number, row in enumerate(rows):
        if len(row) != len(keys):
            raise DataError(f"{where}.matrix[{number}]: got {len(row)} numbers, expected {len(keys)}")
    matrix = np.array(
        [[_number(value, f"{where}.matrix[{i}][{j}]") for j, value in enumerate(row)] for i, row in enumerate(rows)]
    ).reshape(len(keys), len(keys))
    _check_covariance(matrix, f"{where}.matrix")
    return tuple(first[key] for key in keys), np.asarray(0.5 * (matrix + matrix.T))


def _check_covariance(matrix: FloatArray, where: str) -> None:
    """Raise DataError for a negative variance, or a matrix that is not symmetric or has negative eigenvalues."""
    variance = np.diag(matrix)
    for index in np.flatnonzero(variance < 0.0).tolist():
        raise DataError(f"{where}[{index}][{index}]: got {variance[index]:g}, expected a variance of at least 0")
    size = np.sqrt(np.outer(variance, variance))
    wrong = np.argwhere(np.abs(matrix - matrix.T) > _SYMMETRIC * size)
    if wrong.size:
        i, j = wrong[0].tolist()
        raise DataError(f"{where}[{i}][{j}]: got {matrix[i, j]:g}, but {matrix[j, i]:g} in [{j}][{i}]: not symmetric")
    too_large = np.argwhere(np.abs(matrix) > (1.0 + _NEGATIVE) * size)
    if too_large.size:
        i, j = too_large[0].tolist()
        raise DataError(f"{where}[{i}][{j}]: got {matrix[i, j]:g}, larger than the variances allow; not a covariance")
    scale = np.divide(1.0, np.sqrt(variance), out=np.zeros(variance.shape), where=variance > 0.0)
    if variance.size and np.linalg.eigvalsh(0.5 * (matrix + matrix.T) * scale * scale[:, None])[0] < -_NEGATIVE:
        raise DataError(f"{where}: has negative eigenvalues: not a covariance")


def _label(key: Sequence[str]) -> str:
    return repr(key[0]) if len(key) == 1 else f"{key[0]!r} ({', '.join(key[1:])})"


def calibration_to_toml(calibration: Calibration, facts: Mapping[str, Any]) -> str:
    """Return the calibration as TOML text that reads back to the same numbers; ``facts`` are in [calibration]."""
    quantity = calibration.quantity
    blocks = [
        "# Offsets of sensors: measured = true + offset"
        + (", headings counter-clockwise" if calibration.kind == "bearings" else "")
        + (_DEVIATION if calibration.harmonics else ""),
        _block("[calibration]", facts),
    ]
    for entry in calibration.entries:
        blocks.append(_block("[[sensor]]", entry_values(entry, quantity, calibration.by)))
        blocks += [_block(f"[[sensor.{HARMONIC}]]", harmonic_values(part)) for part in entry.harmonics]
    if calibration.covariance is not None and calibration.order:
        names = term_keys(calibration.entries, calibration.harmonics)
        keys = [names[number] for number in calibration.order]
        order = ", ".join(toml_value(key[0] if len(key) == 1 else list(key)) for key in keys)
        rows = "\n".join(f"  {toml_value(row)}," for row in calibration.covariance.tolist())
        blocks.append(f"[covariance]  # {quantity.unit}2\norder = [{order}]\nmatrix = [\n{rows}\n]\n")
    return "\n".join(blocks)


def calibration_digest(calibration: Calibration) -> dict[str, str]:
    """Return the name of a calibration's file and the SHA-256 hash of its numbers, for the provenance."""
    text = calibration_to_toml(calibration, {})
    return {"name": calibration.source, "sha256": hashlib.sha256(text.encode("utf-8")).hexdigest()}


def entry_values(entry: SensorOffset, quantity: OffsetKind, by: Sequence[str]) -> dict[str, Any]:
    """Return an entry under its names in files; a std that is not determined is None."""
    group = dict(zip(by, entry.group, strict=True))
    return {
        "name": entry.name,
        **group,
        quantity.name: entry.offset,
        quantity.std_name: entry.std,
        "std_scale": entry.std_scale,
        "std_dof": entry.std_dof,
    }


def _block(head: str, values: Mapping[str, Any]) -> str:
    lines = (f"{name} = {_value(value)}" for name, value in values.items() if value is not None)
    return "\n".join([head, *lines, ""])


def _value(value: Any) -> str:
    return str(value) if isinstance(value, int) else toml_value(value)
