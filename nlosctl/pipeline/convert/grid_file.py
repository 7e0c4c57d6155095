"""A posterior map as an ASCII grid (Arc/Info), with its coordinate reference system beside it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import TracebackType
from typing import Any

import numpy as np

from nlosctl.arrays import FloatArray
from nlosctl.errors import DataError, UsageError
from nlosctl.io.paths.locations import Location
from nlosctl.io.scenes.scene_file import plane_of
from nlosctl.io.writers.byte_output import ByteOutput, writing
from nlosctl.io.writers.output_set import check_targets
from nlosctl.pipeline.convert.map_writer import frame_of

__all__ = ["GridFile"]

_COLUMNS = ("x_m", "y_m", "probability")


class GridFile:
    """Context manager that writes one map of posterior cells; the interface of a `TableWriter`.

    ``names`` are the columns of the table. The rows of the grid are from north to south. Where the frame of the scene
    in ``metadata`` has a coordinate reference system (a CRS, or an origin with x to the east), it is in a file of the
    same name that ends in ``.prj``, and both appear or none.
    """

    def __init__(
        self,
        target: str,
        names: Sequence[str],
        *,
        overwrite: bool = False,
        inputs: Sequence[Location] = (),
        metadata: Mapping[str, str] | None = None,
    ) -> None:
        if "snapshot" in names:
            raise UsageError(f"{target}: an ASCII grid has one map; choose one with `snapshot`, or set `combine`")
        self._target, self._tables, frame = target, list[Any](), frame_of(metadata or {})
        self._grid = ByteOutput(target, overwrite=overwrite)
        text = None if frame is None else plane_of(frame).wkt()
        projection = str(target)[: -len(".asc")] + ".prj"
        check_targets([target, *([] if text is None else [projection])], overwrite=overwrite, inputs=inputs)
        self._projection = None if text is None else ByteOutput(projection, overwrite=overwrite)
        self._text, self._completed = text or "", False

    def __enter__(self) -> GridFile:
        self._grid.__enter__()
        if self._projection is not None:
            try:
                self._projection.__enter__()
            except BaseException as error:
                self._grid.end(type(error), self.complete)
                raise
        return self

    @property
    def passes_on(self) -> bool:
        """Whether written bytes can't be taken back, as in a `TableWriter`."""
        return self._grid.passes_on

    def set_metadata(self, metadata: Mapping[str, str]) -> None:
        """Ignore metadata: a grid can't store it."""

    def write(self, table: Any) -> None:
        """Receive cells."""
        self._tables.append(table.select(list(_COLUMNS)))

    def complete(self) -> None:
        """Write the grid; only the renaming to the final names is left."""
        if not self._completed:
            x, y, probability = (
                np.concatenate([table.column(name).to_numpy() for table in self._tables]) for name in _COLUMNS
            )
            with writing(self._target):
                self._grid.sink.write(_grid_text(x, y, probability).encode("ascii"))
            if self._projection is not None:
                self._projection.sink.write(self._text.encode("utf-8"))
        self._completed = True
        self._grid.complete()
        if self._projection is not None:
            self._projection.complete()

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._grid.end(kind, self.complete)
        if self._projection is not None:
            self._projection.end(kind, self._projection.complete)


def _grid_text(x: FloatArray, y: FloatArray, probability: FloatArray) -> str:
    """Return the grid of cells (P,) that are row by row from the south, each from the west."""
    columns = int(np.count_nonzero(y == y[0]))
    rows = x.shape[0] // columns
    if x.shape[0] == 1:
        raise DataError("a grid of a single cell has no size of cells; choose a smaller `cell`")
    cell = float(x[columns - 1] - x[0]) / (columns - 1) if columns > 1 else float(y[-1] - y[0]) / max(rows - 1, 1)
    header = {
        "ncols": columns,
        "nrows": rows,
        "xllcorner": f"{float(x[0]) - 0.5 * cell:.12g}",
        "yllcorner": f"{float(y[0]) - 0.5 * cell:.12g}",
        "cellsize": f"{cell:.12g}",
        "NODATA_value": -9999,
    }
    lines = [f"{name:<13} {value}" for name, value in header.items()]
    lines += [" ".join(map(repr, row)) for row in probability.reshape(rows, columns)[::-1].tolist()]
    return "\n".join(lines) + "\n"
