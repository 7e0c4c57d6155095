"""What reading tells the summary."""

from __future__ import annotations

from dataclasses import dataclass, field

__all__ = ["ReadReport"]


@dataclass(kw_only=True)
class ReadReport:
    """What has been read so far: counts, and remarks that the summary passes on.

    ``rows`` are the good ones (``left_out_rows`` of them flagged by an earlier step), ``bad_rows`` the others.
    ``snapshots`` have been given out; ``snapshots_lost`` have bad rows alone. ``rows_by_file`` counts all rows.
    """

    rows: int = 0
    bad_rows: int = 0
    left_out_rows: int = 0
    snapshots: int = 0
    snapshots_lost: int = 0
    rows_by_file: dict[str, int] = field(default_factory=dict)
    remarks: list[str] = field(default_factory=list)

    @property
    def rows_in_all(self) -> int:
        """How many rows the inputs had, good and bad."""
        return self.rows + self.bad_rows
