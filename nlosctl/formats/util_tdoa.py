"""Differences of ranges between pairs of anchors, as in the UTIL UWB data set: windows of time are snapshots.

A line has ``t_tdoa`` (s), ``idA``, ``idB`` and ``tdoa_meas``, the distance to anchor idB minus that to anchor idA in
metres, beside columns of other sensors, which fill the same lines independently: cells that are empty belong to
others. The anchors are sensors of the scene named by their numbers, 0 to 7, or the surveyed ones of a file.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from nlosctl.contract.formats import BadLine, ForeignFile, ImporterSpec, Row, UnfitError
from nlosctl.contract.limits import LARGEST_NUMBER
from nlosctl.contract.options import option
from nlosctl.formats.epochs import WINDOW_MEANING, in_epochs, parse_window
from nlosctl.formats.fields import KEEP_MEANING, kept_cells, lines, listed, number
from nlosctl.formats.positions_file import Positions, line_fault, of_places, of_scene, opened
from nlosctl.formats.tables import open_table

__all__ = ["FORMAT"]

_NEEDED = ("t_tdoa", "idA", "idB", "tdoa_meas")
_CURE = "`parameters` anchors=FILE with the surveyed positions, such as an0_p,x,y,z in each line"
_SURVEYED = re.compile(r"an(\d+)_p")


@dataclass(frozen=True, kw_only=True)
class UtilOptions:
    """The anchors, and settings that the log does not contain."""

    anchors: str | None = option(None, meaning="survey with an0_p,x,y,z in metres in each line; default: the scene")
    window: str = option("0.1s", meaning=WINDOW_MEANING)
    arrival_std_m: float | None = option(
        None,
        meaning="standard deviation of every difference; otherwise set it in the next command",
        unit="m",
        minimum=0.0,
        exclusive=True,
    )
    keep: str | None = option(None, meaning=KEEP_MEANING)


def _rows(file: ForeignFile, options: UtilOptions) -> Iterator[Row | BadLine]:
    positions = of_scene(file, _CURE) if options.anchors is None else _surveyed(options.anchors)
    keep = listed(options.keep)

    def parse(line: int, cells: Mapping[str, str]) -> Row | None:
        if not cells["t_tdoa"]:
            return None
        time_s = number(cells["t_tdoa"], "t_tdoa")
        time = {"time_s": time_s}
        first, second = (_anchor(cells[name], name) for name in ("idA", "idB"))
        reference = positions(first, time, "idA")
        values: dict[str, Any] = {
            "sensor": second,
            **positions(second, time, "idB"),
            "tdoa_m": number(cells["tdoa_meas"], "tdoa_meas", -LARGEST_NUMBER, LARGEST_NUMBER),
            "arrival_std_m": options.arrival_std_m,
            "reference": first,
            **{name.replace("sensor", "reference"): value for name, value in reference.items()},
            **time,
        }
        return Row(line=line, epoch_s=time_s, values=values, kept=kept_cells(cells, keep))

    rows = open_table(file).rows([*_NEEDED, *keep], parse)
    yield from in_epochs(rows, parse_window(options.window, "importer 'util-tdoa'"), file, "")


def _anchor(text: str, name: str) -> str:
    """Return the name of an anchor by its number, which may be written as 7.0."""
    value = number(text, name, 0.0, 1e6)
    if not value.is_integer():
        raise UnfitError(f"got {text!r}, expected the number of an anchor", name)
    return str(int(value))


def _surveyed(path: str) -> Positions:
    places = {}
    with opened(path) as file:
        for line, text in lines(file):
            cells = [cell.strip() for cell in text.split(",")]
            anchor = _SURVEYED.fullmatch(cells[0])
            if anchor is None:
                continue
            try:
                if len(cells) != 4:
                    raise UnfitError(f"got {len(cells)} fields, expected {cells[0]},x,y,z")
                x, y, z = (number(cell, axis, -1e9, 1e9) for cell, axis in zip(cells[1:], "xyz", strict=True))
            except UnfitError as unfit:
                raise line_fault(path, line, unfit) from None
            places[anchor[1]] = {"sensor_x_m": x, "sensor_y_m": y, "sensor_z_m": z}
    return of_places(path, places)


FORMAT = ImporterSpec(
    name="util-tdoa",
    summary="Range differences of pairs of anchors (UTIL UWB data set: t_tdoa, idA, idB, tdoa_meas)",
    reference="UTIL, arXiv 2203.14471, and utiasDSL/util-uwb-dataset, log_to_csv.py (columns), visual_tdoa3.py (sign), "
    "anchor_const1_survey.txt (anchors)",
    options=UtilOptions,
    kind=lambda options: "arrivals",
    rows=_rows,
    begins_like=r"t_tdoa\s*,\s*idA\s*,\s*idB\s*,\s*tdoa_meas\b",
    extra={"sensor_z_m": "number", "reference_z_m": "number", "time_s": "number"},
)
"""The specification of the importer."""
