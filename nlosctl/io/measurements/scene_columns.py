"""Columns that refer to the scene: sensor positions, reflector names, directions from north, sensors in circles."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from nlosctl.arrays import FloatArray, IntArray
from nlosctl.contract.limits import LARGEST_NUMBER
from nlosctl.contract.scene import CircleReflector, EarthFrame, PlaneReflector, Scene, SphereReflector
from nlosctl.contract.tables import Column
from nlosctl.errors import did_you_mean
from nlosctl.io.measurements.column_mapping import NULL_CODE, ColumnPlan, MappedColumn, NameCodes
from nlosctl.io.measurements.completion.geometry_stds import SENSOR_STD
from nlosctl.io.measurements.row_checks import TICKS, Describe, Fault, as_float64, got, is_null, null_mask
from nlosctl.io.readers.base import text_at
from nlosctl.io.scenes.scene_file import plane_of
from nlosctl.models.circle_rows import misplaced_sensors

__all__ = ["SceneColumns", "from_north"]

Columns = Mapping[str, npt.NDArray[Any]]
"""The columns (N,) of a row batch by name, as far as they are known."""


class SceneColumns:
    """Fills and checks the columns of one file that refer to its scene; faults are added to the list ``faults``.

    ``sensors`` are the codes of the run's sensor names.
    """

    def __init__(self, scene: Scene, plan: ColumnPlan, sensors: NameCodes) -> None:
        self._scene, self._plan, self._sensors = scene, plan, sensors
        self._reflectors = NameCodes(scene.reflector_names, grows=False)
        # numbers of sensors are their entries in the scene, unless some are valid for a time
        names = scene.sensor_names if scene.time_column else [known.name for known in scene.sensors]
        self._numbers = {name: number for number, name in enumerate(names)}
        axes_m = [*((*known.position, known.z_m) for known in scene.sensors), (None,) * 3]
        self._axes_m = np.array(axes_m, dtype=np.float64).T
        self._times: Any = None
        if scene.time_column:
            from nlosctl.io.measurements.windows.sensor_times import SensorTimes

            self._times = SensorTimes(scene)

    def _entries(self, numbers: IntArray, done: Columns) -> IntArray:
        """Return the entries (N,) of the scene for sensors ``numbers`` (N,) at the times of the rows, -1 for none."""
        entries: IntArray = numbers if self._times is None else self._times.entries(numbers, done[TICKS])
        return entries

    def _sensor_numbers(self, sensor: IntArray) -> IntArray:
        """Return the numbers (N,) in the scene of the sensors with the codes ``sensor`` (N,), -1 for none."""
        return np.array([*(self._numbers.get(name, -1) for name in self._sensors.names), -1])[sensor]

    def _node_numbers(self, names: Sequence[str]) -> IntArray:
        """Return the numbers (N,) in the scene of nodes with these names (N,), -1 for none."""
        return np.array([self._numbers.get(name, -1) for name in names], dtype=np.int64)

    def check_times(self, time_column: str, batch: Any, columns: Columns, faults: list[Fault]) -> set[str]:
        """Add the faults of rows at a time without an entry of their sensor; return the sensors valid at some time."""
        nodes = dict.fromkeys(column.scene_sensor for column in self._plan.table.columns if column.scene_sensor)
        numbers = [self._node_numbers(self._node_names(node, batch)) for node in nodes]
        if "sensor" in columns:
            numbers.append(self._sensor_numbers(columns["sensor"]))
        for known in numbers:
            outside = (known >= 0) & (self._entries(known, columns) < 0)
            if outside.any():
                faults.append(
                    Fault(mask=outside, column=time_column, describe=self._outside(known, batch, time_column))
                )
        valid: set[str] = self._times.valid(columns[TICKS])
        return valid

    def _outside(self, numbers: IntArray, batch: Any, time_column: str) -> Describe:
        names, cells = self._scene.sensor_names, batch.column(time_column)
        return lambda index: (
            f"the scene has no entry of sensor {names[numbers[index]]!r} at {text_at(cells, index)}; "
            "add one whose 'from' and 'to' include that time"
        )

    def positions(
        self, column: Column, mapped: MappedColumn | None, batch: Any, done: Columns, faults: list[Fault]
    ) -> FloatArray:
        """Return a coordinate (N,) of the sensors ``done["sensor"]`` (N,) where the column is absent or null."""
        assert column.scene_axis is not None  # noqa: S101 - asked by the caller
        sensor = done["sensor"]
        numbers = self._sensor_numbers(sensor)
        filled: FloatArray = self._axes_m[column.scene_axis][self._entries(numbers, done)]
        name = column.name if mapped is None else mapped.name
        if mapped is None:
            absent = np.ones(batch.num_rows, dtype=np.bool_)
        else:
            cells = batch.column(mapped.name)
            own = as_float64(cells) * mapped.scale
            absent = null_mask(cells)
            filled = np.where(absent, filled, own)
            beyond = ~absent & ~(np.abs(own) <= LARGEST_NUMBER)
            if beyond.any():
                expected = f"a finite number within {LARGEST_NUMBER:g}"
                faults.append(Fault(mask=beyond, column=name, describe=got(own, expected)))
        unknown = absent & (numbers < 0) & (sensor != NULL_CODE)
        if unknown.any():
            cells = batch.column(self._plan.mapped["sensor"].name)
            faults.append(Fault(mask=unknown, column=name, describe=self._unknown_sensor(cells)))
        return filled

    def places_of(self, sensor: IntArray, done: Columns) -> FloatArray:
        """Return the positions (3, N) in the scene of sensors with the codes ``sensor`` (N,), NaN for unknown ones."""
        places: FloatArray = self._axes_m[:, self._entries(self._sensor_numbers(sensor), done)]
        return places

    @property
    def has_stds(self) -> bool:
        """Whether positions, headings or offsets of sensors may not be exactly known."""
        return self._plan.table.name != "triplets" and (SENSOR_STD in self._plan.mapped or self._scene.is_uncertain)

    def stds_of(self, sensor: IntArray, name: str, done: Columns) -> FloatArray:
        """Return the standard deviations ``name`` (N,) of the scene's sensors with these codes, NaN without one."""
        stds = np.array([*(getattr(known, name) for known in self._scene.sensors), None], dtype=np.float64)
        return np.asarray(stds[self._entries(self._sensor_numbers(sensor), done)])

    def heights(self, done: Columns) -> FloatArray | None:
        """Return the heights (N,) of the scene's sensors, NaN for others; None if the scene has no heights."""
        if not self._scene.has_heights:
            return None
        heights: FloatArray = self._axes_m[2][self._entries(self._sensor_numbers(done["sensor"]), done)]
        return heights

    def node_positions(self, column: Column, batch: Any, done: Columns, faults: list[Fault]) -> FloatArray:
        """Return a coordinate (N,) of a node that the scene has: the one that the row names, else the default."""
        axis = ("x", "y", "z").index(column.name.removesuffix("_m")[-1])
        names = self._node_names(column.scene_sensor, batch)
        numbers = self._node_numbers(names)
        found: FloatArray = self._axes_m[axis][self._entries(numbers, done)]
        if (numbers < 0).any():
            known = self._numbers
            describe: Describe = lambda index: (  # noqa: E731
                f"the scene has no sensor {names[index]!r}{did_you_mean(names[index], known)}"
            )
            faults.append(Fault(mask=numbers < 0, column=column.scene_sensor, describe=describe))
        return found

    def add_headings(self, file: str, batch: Any, columns: dict[str, npt.NDArray[Any]], faults: list[Fault]) -> None:
        """Add the headings of rows or of the scene to directions that are relative to them."""
        from nlosctl.io.measurements.headings import add_headings, require_headings

        require_headings(self._plan, self._scene, file)
        names = [self._node_names(self._plan.mapped[name].column.measured_at, batch) for name in self._plan.relative]
        nodes = [(here, self._entries(self._node_numbers(here), columns)) for here in names]
        add_headings(columns, self._plan, self._scene, nodes, faults)

    def _node_names(self, node: str, batch: Any) -> list[str]:
        """Return the names (N,) of sensors, transmitters or receivers: those of the rows, else the default."""
        mapped = self._plan.mapped.get(node)
        if mapped is None:
            return [node] * batch.num_rows
        return [node if name is None else str(name) for name in batch.column(mapped.name).to_pylist()]

    def _unknown_sensor(self, cells: Any) -> Describe:
        positions = self._numbers
        if not positions:
            return is_null("a finite number (or a scene that has the sensor)")

        def describe(index: int) -> str:
            name = text_at(cells, index) or ""
            return f"the row has no position, and the scene has no sensor {name!r}{did_you_mean(name, positions)}"

        return describe

    def half_positions(self, batch: Any, faults: list[Fault]) -> None:
        """Add the faults of rows that have some coordinates of their sensor and would take others from the scene."""
        names = [self._plan.mapped[axis].name for axis in self._plan.scene_axes]
        absent = np.array([null_mask(batch.column(name)) for name in names])
        half = absent.any(axis=0) & ~absent.all(axis=0)
        describe = is_null(f"all of {', '.join(names)} or none")
        found = [
            Fault(mask=half & missing, column=name, describe=describe)
            for name, missing in zip(names, absent, strict=True)
        ]
        for name in ("sensor_lat_deg", "sensor_lon_deg"):
            if name in batch.schema.names:
                other = absent.all(axis=0) & ~null_mask(batch.column(name))
                expected = f"a number: the row has {name}; drop the columns {' and '.join(names)} to use it"
                found.append(Fault(mask=other, column=names[0], describe=is_null(expected)))
        faults += [fault for fault in found if fault.mask.any()]

    def reflectors(self, mapped: MappedColumn, cells: Any, faults: list[Fault]) -> IntArray:
        """Return the indices (N,) of reflectors in the scene, `NULL_CODE` where the cell is empty."""
        indices = self._reflectors.encode(cells)
        unknown = indices == NameCodes.UNKNOWN
        if unknown.any():
            known = self._scene.reflector_names

            def describe(index: int) -> str:
                name = text_at(cells, index) or ""
                if not known:
                    return f"got {name!r}, but there is no scene with reflectors; give one with `scene` FILE"
                return f"the scene has no reflector {name!r}{did_you_mean(name, known)}; it has: {', '.join(known)}"

            faults.append(Fault(mask=unknown, column=mapped.name, describe=describe))
        if self._plan.table.dimension == 2:
            faults += self._faults_of_space(mapped.name, indices)
        return indices

    def _faults_of_space(self, column: str, indices: IntArray) -> list[Fault]:
        """Return the fault of rows of the plane by reflectors that only space has."""
        known = self._scene.reflectors
        of_space = np.array(
            [*(isinstance(one, PlaneReflector | SphereReflector) for one in known), False], dtype=np.bool_
        )
        mask = of_space[np.where(indices >= 0, indices, -1)]
        describe: Describe = lambda index: (  # noqa: E731
            f"got {known[indices[index]].name!r}, a reflector of space; set `dimensions` to 3, or give a line"
        )
        return [Fault(mask=mask, column=column, describe=describe)] if mask.any() else []

    def check_circles(self, columns: Columns, dimension: int, faults: list[Fault]) -> None:
        """Add the faults of rows by a circle or sphere whose sensor is outside of it, or within its blocker."""
        reflector, table = columns["reflector"], _round_reflectors(self._scene, dimension)
        places = [columns[f"sensor_{axis}_m"] for axis in "xyz"[:dimension]]
        known = (reflector >= 0) & np.isfinite(places).all(axis=0)
        rows = np.flatnonzero(known)  # without rows whose reflector is not in the scene
        rows = rows[np.isfinite(table[0])[reflector[rows]]]
        *center, radius, blocker = (column[reflector[rows]] for column in table)
        distance = np.hypot(places[0][rows] - center[0], places[1][rows] - center[1])
        if dimension == 3:
            distance = np.hypot(distance, places[2][rows] - center[2])
        outside, under = misplaced_sensors(distance, radius, blocker)
        position, shape = self._plan.mapped.get("sensor_x_m"), "circle" if dimension == 2 else "sphere"
        name = "sensor_x_m" if position is None else position.name
        for wrong, limit, expected in (
            (outside, radius, "less than its radius"),
            (under, blocker, "at least the radius of its blocker"),
        ):
            if wrong.any():
                size = known.shape[0]
                faults.append(_circle_fault(name, size, rows[wrong], distance[wrong], limit[wrong], shape, expected))


def _round_reflectors(scene: Scene, dimension: int) -> FloatArray:
    """Return centre (D rows), radius and blocker (NaN without) of circles or spheres, NaN for other reflectors."""
    kind = CircleReflector if dimension == 2 else SphereReflector
    absent = (np.nan,) * (dimension + 2)
    rows = [
        (*one.center, one.radius, np.nan if one.blocker_radius is None else one.blocker_radius)
        if isinstance(one, kind)
        else absent
        for one in scene.reflectors
    ]
    return np.array(rows).reshape(-1, dimension + 2).T


def _circle_fault(
    column: str, size: int, rows: IntArray, distance: FloatArray, limit: FloatArray, shape: str, expected: str
) -> Fault:
    mask = np.zeros(size, dtype=np.bool_)
    mask[rows] = True
    numbers = {int(row): (float(d), float(r)) for row, d, r in zip(rows, distance, limit, strict=True)}

    def describe(index: int) -> str:
        away, radius = numbers[index]
        return f"the sensor is {away:.10g} m from the centre of its {shape}, expected {expected}, {radius:.10g} m"

    return Fault(mask=mask, column=column, describe=describe)


def from_north(values: FloatArray, columns: Columns, node: str, frame: EarthFrame) -> FloatArray:
    """Return directions (N,) from true north as directions in the plane, by the positions of ``node``."""
    north_rad = plane_of(frame).north_rad(columns[f"{node}_x_m"], columns[f"{node}_y_m"])
    turned: FloatArray = values + (north_rad - 0.5 * np.pi)
    return turned
