"""Columns of a file under other names: the setting ``columns``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from nlosctl.contract.tables import Table
from nlosctl.errors import DataError, UsageError, did_you_mean

__all__ = ["rename"]


def rename(names: Sequence[str], renames: Mapping[str, str], table: Table, file: str) -> tuple[str, ...]:
    """Return the file's names with ``renames`` (contract's name -> file's name) applied.

    Two columns may exchange their names. Raises UsageError for a name that the contract does not have, DataError if the
    file does not have the column, or has the new name already.
    """
    known = [accepted for column in table.all_columns for accepted in column.accepted_names]
    by_file_name = {}
    for wanted, given in renames.items():
        if wanted not in known:
            raise UsageError(
                f"`columns` {wanted}={given}: {table.name} have no column {wanted!r}{did_you_mean(wanted, known)}"
            )
        if given not in names:
            raise DataError(
                f"{file}: `columns` {wanted}={given}: no column {given!r}{did_you_mean(given, names)}. "
                f"The file has: {', '.join(names)}"
            )
        if wanted in names and wanted not in renames.values():
            raise DataError(f"{file}: `columns` {wanted}={given}: the file already has a column {wanted!r}")
        by_file_name[given] = wanted
    return tuple(by_file_name.get(name, name) for name in names)
