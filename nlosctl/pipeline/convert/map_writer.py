"""Maps of estimates: positions and ellipses on earth, passed to an exporter table by table."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import PurePosixPath
from types import TracebackType
from typing import Any, cast

import numpy as np

from nlosctl import registry
from nlosctl.arrays import FloatArray
from nlosctl.contract.formats import ExporterSpec, Places, PlacesWriter, Shapes
from nlosctl.contract.limits import LARGEST_NUMBER
from nlosctl.contract.options import parse_options
from nlosctl.contract.scene import EarthFrame, parse_frame
from nlosctl.errors import DataError, MethodError, NlosctlError
from nlosctl.geometry.antimeridian import crosses_antimeridian, cut_ring
from nlosctl.geometry.earth import EarthPlane
from nlosctl.geometry.ellipses import ellipse_threshold, error_ellipse
from nlosctl.geometry.symmetric import Symmetric2x2
from nlosctl.io.paths.locations import Location, location
from nlosctl.io.scenes.scene_file import SCENE_KEY, plane_of, scene_from_toml
from nlosctl.io.writers.byte_output import ByteOutput, writing
from nlosctl.io.writers.output_set import check_targets
from nlosctl.pipeline.convert.map_shapes import bearing_lines, bound_cells, has_bearings, has_bound_cells
from nlosctl.pipeline.convert.region_shapes import by_snapshot, has_posterior_cells, posterior_regions
from nlosctl.pipeline.engine.writing import track_columns

__all__ = ["MapWriter", "exporter_of", "frame_of", "map_extensions"]


_ESTIMATED = ("x_m", "y_m", "cov_xx_m2", "cov_xy_m2", "cov_yy_m2")


def map_extensions() -> list[str]:
    """Return the extensions of the exporters."""
    return [f".{entry.name}" for entry in registry.format_entries() if entry.kind == "export"]


def exporter_of(target: str, name: str | None) -> str | None:
    """Return the exporter for ``target``: ``name``, or that of the file extension; None for a table."""
    known = {entry.name for entry in registry.format_entries() if entry.kind == "export"}
    if name is not None:
        return name if name in known else None
    extension = PurePosixPath(location(target).name).suffix.removeprefix(".").lower()
    return extension if target != "-" and extension in known else None


class MapWriter:
    """Context manager that writes tables of estimates by an exporter; the interface of a `TableWriter`.

    ``frame`` replaces the frame of the estimates (their column ``frame``, else that of the scene in ``metadata``).
    Raises DataError without a frame.
    """

    def __init__(
        self,
        target: str,
        exporter: str,
        parameters: Mapping[str, Any],
        *,
        overwrite: bool = False,
        inputs: Sequence[Location] = (),
        metadata: Mapping[str, str] | None = None,
        frame: EarthFrame | None = None,
    ) -> None:
        spec = registry.resolve_format(exporter, "export")
        assert isinstance(spec, ExporterSpec)  # noqa: S101 - what the registry says
        self._spec, self.rows = spec, 0
        self._options = parse_options(spec.options, parameters, f"exporter {spec.name!r}")
        self._output = ByteOutput(target, overwrite=overwrite)
        self._frame = frame or frame_of(metadata or {})
        self._frames: set[str | None] = set()
        self._track = track_columns(metadata or {})
        self._writer: PlacesWriter | None = None
        self._map: list[Any] = []
        self._regions: list[Any] = []
        self._regions_of: Any = None
        self._completed = False
        check_targets([target], overwrite=overwrite, inputs=inputs)

    def __enter__(self) -> MapWriter:
        self._output.__enter__()
        return self

    @property
    def passes_on(self) -> bool:
        """Whether written bytes can't be taken back, as in a `TableWriter`."""
        return self._output.passes_on

    def set_metadata(self, metadata: Mapping[str, str]) -> None:
        """Ignore metadata: maps can't store it."""

    def write(self, table: Any) -> None:
        """Write estimates."""
        if not table.num_rows:
            return
        self.rows += table.num_rows
        if has_bound_cells(table.column_names):
            self._map.append(table)  # the spacing of the grid follows from the complete map
        elif has_posterior_cells(table.column_names):
            for snapshot, cells in by_snapshot(table):
                if snapshot != self._regions_of:
                    self._write_regions()
                self._regions_of = snapshot
                self._regions.append(cells)
        elif has_bearings(table.column_names):
            columns = {name: table.column(name).to_pylist() for name in table.column_names}
            length_m = float(getattr(self._options, "line_length_m", 0.0))
            self._write_shapes("bearings", lambda: bearing_lines(columns, length_m, self._numbers, self._planes))
        else:
            places = self._places(table)  # faults are raised before anything is written
            with self._naming_exporter():
                self._started().write(places)

    def complete(self) -> None:
        """Write the end of the map; only the renaming to the final name is left."""
        self._write_regions()
        if self._map:
            tables, self._map = self._map, []
            columns = _columns(tables)
            metres = bool(getattr(self._options, "metres", False))
            self._write_shapes("a map", lambda: bound_cells(columns, self._numbers, self._planes, metres=metres))
        if not self._completed:
            with self._naming_exporter():
                self._started().close()
        self._completed = True
        self._output.complete()

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._output.end(kind, self.complete)

    def _write_regions(self) -> None:
        """Write the regions of a complete map of the posterior."""
        if self._regions:
            tables, self._regions = self._regions, []
            metres = bool(getattr(self._options, "metres", False))
            columns, of = _columns(tables), self._regions_of
            make = lambda: posterior_regions(columns, of, self._numbers, self._planes, metres=metres)  # noqa: E731
            self._write_shapes("a map", make)

    def _write_shapes(self, contents: str, make: Callable[[], Shapes]) -> None:
        if not hasattr(self._started(), "write_shapes"):
            raise DataError(f"{self._spec.name} takes estimates, not {contents}: write geojson or kml instead")
        shapes = make()
        with self._naming_exporter():
            cast(Any, self._started()).write_shapes(shapes)

    def _started(self) -> PlacesWriter:
        if self._writer is None:
            self._writer = self._spec.start(self._output.sink, self._options)
        return self._writer

    @contextmanager
    def _naming_exporter(self) -> Iterator[None]:
        """Convert an exception of the exporter into a MethodError that names it."""
        try:
            with writing(self._output.target):
                yield
        except (NlosctlError, OSError):
            raise
        except Exception as error:
            raise MethodError(f"exporter {self._spec.name!r} failed: {type(error).__name__}: {error}") from error

    def _places(self, table: Any) -> Places:
        missing = [name for name in _ESTIMATED if name not in table.column_names]
        if missing:
            raise DataError(
                f"{self._spec.name} takes estimates, and there is no column {missing[0]!r}; localize measurements first"
            )
        columns = {name: table.column(name).to_pylist() for name in table.column_names}
        x, y, xx, xy, yy = (self._numbers(columns[name], name) for name in _ESTIMATED)
        ellipse = error_ellipse(Symmetric2x2(xx, xy, yy))
        share = float(getattr(self._options, "ellipse", 0.95))
        degrees = self._numbers(columns["std_dof"], "std_dof") if "std_dof" in columns else None
        scale = np.sqrt(ellipse_threshold(share, degrees))
        major, minor = scale * ellipse.semi_major_m, scale * ellipse.semi_minor_m
        turn = np.linspace(0.0, 2.0 * np.pi, int(getattr(self._options, "vertices", 72)) + 1)
        along, across = major[:, None] * np.cos(turn), minor[:, None] * np.sin(turn)
        cos, sin = np.cos(ellipse.orientation_rad)[:, None], np.sin(ellipse.orientation_rad)[:, None]
        ring_x, ring_y = x[:, None] + cos * along - sin * across, y[:, None] + sin * along + cos * across
        north = np.full(x.shape, 0.5 * np.pi)
        metres = bool(getattr(self._options, "metres", False))
        if metres:
            self._refuse_other_planes(columns)
        else:
            x, y, ring_x, ring_y, north = self._on_earth(columns, x, y, ring_x, ring_y)
        outline = np.stack([ring_x, ring_y], axis=2)
        outline[~np.isfinite(outline).all(axis=(1, 2))] = np.nan
        outline[:, -1] = outline[:, 0]
        cut_rows: list[int] = [] if metres else np.flatnonzero(crosses_antimeridian(outline)).tolist()
        return Places(
            columns=columns,
            x=x,
            y=y,
            z=self._numbers(columns["z_m"], "z_m") if "z_m" in columns else None,
            outline=outline,
            probability=share,
            semi_major_m=major,
            semi_minor_m=minor,
            major_azimuth_rad=north - ellipse.orientation_rad,
            on_earth=not metres,
            cut={row: cut_ring(outline[row]) for row in cut_rows},
            track=self._track,
        )

    def _refuse_other_planes(self, columns: Mapping[str, Sequence[Any]]) -> None:
        """Raise DataError where metres are of several planes, unless the user names one."""
        self._frames |= set(columns.get("frame", [None]))
        if self._frame is None and len(self._frames) > 1:
            raise DataError(
                f"{self._spec.name} in metres takes estimates in one plane, and these have several (column 'frame'): "
                "name one with `origin` LAT,LON or `crs` EPSG:CODE, or select rows with `where`"
            )

    def _numbers(self, values: Sequence[Any], name: str) -> FloatArray:
        try:
            numbers = np.array([np.nan if value is None else value for value in values], dtype=np.float64)
        except (TypeError, ValueError) as error:
            raise DataError(
                f"{self._spec.name} takes estimates, expected numbers in the column {name!r}: {error}"
            ) from None
        if (np.abs(numbers) > LARGEST_NUMBER**2).any():
            raise DataError(f"the column {name!r} holds numbers beyond {LARGEST_NUMBER**2:g}: these are not estimates")
        return numbers

    def _on_earth(
        self, columns: Mapping[str, Sequence[Any]], x: FloatArray, y: FloatArray, ring_x: FloatArray, ring_y: FloatArray
    ) -> tuple[FloatArray, ...]:
        lon, lat, north = (np.full(x.shape, np.nan) for _ in range(3))
        ring_lon, ring_lat = np.full(ring_x.shape, np.nan), np.full(ring_x.shape, np.nan)
        for plane, rows in self._planes(columns, x.shape[0]):
            lat[rows], lon[rows] = plane.to_earth(x[rows], y[rows])
            ring_lat[rows], ring_lon[rows] = plane.to_earth(ring_x[rows], ring_y[rows])
            north[rows] = plane.north_rad(x[rows], y[rows])
        return lon, lat, ring_lon, ring_lat, north

    def _planes(self, columns: Mapping[str, Sequence[Any]], size: int) -> Iterator[tuple[EarthPlane, Any]]:
        """Yield each plane with the indices of its rows."""
        if self._frame is not None:
            yield plane_of(self._frame), np.arange(size)
            return
        frames = columns.get("frame", [None] * size)
        for frame in dict.fromkeys(frames):
            if frame is None:
                raise DataError(
                    "the estimates have no location on earth: define the plane with `origin` LAT,LON or `crs` "
                    "EPSG:CODE or [frame] in the scene (convert also writes plain metres as geojson, with "
                    "`parameters` metres=true)"
                )
            rows = np.array([row for row, value in enumerate(frames) if value == frame])
            yield plane_of(parse_frame(str(frame), "column 'frame'")), rows


def _columns(tables: Sequence[Any]) -> dict[str, list[Any]]:
    """Return the columns of tables as lists."""
    return {
        name: [value for table in tables for value in table.column(name).to_pylist()] for name in tables[0].column_names
    }


def frame_of(metadata: Mapping[str, str]) -> EarthFrame | None:
    """Return the frame of the scene in the metadata of a table, if there is one."""
    text = metadata.get(SCENE_KEY.decode())
    return None if text is None else scene_from_toml(text, "the scene in the table's metadata").frame
