"""An input that is changed while it is read gives no result: what was read is neither the old file nor the new one."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from nlosctl.contract.tables import ColumnType
from nlosctl.errors import DataError
from nlosctl.io.paths.locations import Location, Mark, mark_of
from nlosctl.io.readers.base import RawBatch, RawSource

__all__ = [
    "WatchedSource",
]


class WatchedSource:
    """A source of a file that must be, at the end of its rows, what it was when the run began (``mark``)."""

    def __init__(self, source: RawSource, name: str, path: Location, mark: Mark | None) -> None:
        self._source, self._name, self._path, self._mark = source, name, path, mark
        self.names: tuple[str, ...] = source.names
        self.metadata: Mapping[bytes, bytes] = source.metadata

    def start(self, types: Mapping[str, ColumnType], columns: Sequence[str] | None) -> Any:
        """See RawSource."""
        return self._source.start(types, columns)

    def batches(self) -> Iterator[RawBatch]:
        """See RawSource; raises DataError at the end, or with the source's own error, where the file has changed."""
        try:
            yield from self._source.batches()
        except DataError as error:
            if mark_of(self._path) != self._mark:
                raise self._changed() from error
            raise
        if mark_of(self._path) != self._mark:
            raise self._changed()

    def _changed(self) -> DataError:
        return DataError(f"{self._name}: was changed while it was read; run again when nobody writes to it")

    def close(self) -> None:
        """Close the file."""
        self._source.close()
