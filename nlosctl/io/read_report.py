"""What reading tells the summary."""

from __future__ import annotations

from dataclasses import dataclass, field

__all__ = ["ReadReport"]


@dataclass(kw_only=True)
class ReadReport:
    """What has been read so far: counts, and remarks that the summary passes on."""

    rows: int = 0
    bad_rows: int = 0
    left_out_rows: int = 0
    snapshots: int = 0
    rows_by_file: dict[str, int] = field(default_factory=dict)
    remarks: list[str] = field(default_factory=list)
