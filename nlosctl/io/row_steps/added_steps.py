"""The steps that the options of reading add to an open file, in order."""

from __future__ import annotations

from nlosctl.contract.run_options import InputOptions
from nlosctl.io.readers.open_file import TableFile
from nlosctl.io.row_steps.direction_vectors import DirectionVectors, has_vectors

__all__ = ["add_row_steps"]


def add_row_steps(file: TableFile, options: InputOptions, name: str) -> set[str]:
    """Add the steps that ``options`` ask for: wide columns, missing values, conditions, then declination.

    Direction vectors are added without an option. Returns the columns that only a method reads, not in results.
    Raises UsageError for an option that can't be parsed, DataError for one that does not suit the file ``name``.
    """
    if options.wide:
        from nlosctl.io.row_steps.wide_columns import WideColumns

        file.add_step(WideColumns(options.wide, file.names, name))
    if options.missing:
        from nlosctl.io.row_steps.missing_values import MissingValues

        missing = MissingValues(options.missing, file.names, options.columns, name)
        file.accept_texts(missing.texts)
        file.add_step(missing)
    if options.where:
        from nlosctl.io.row_steps.conditions import RowConditions

        file.add_step(RowConditions(options.where, file.names, options.columns, name))
    if options.declination_deg is not None:
        from nlosctl.io.row_steps.declination import Declination

        file.add_step(Declination(str(options.declination_deg), file.names, options.columns, name))
    if has_vectors(file.names, options.columns):
        vectors = DirectionVectors(file.names, options.columns, name)
        file.add_step(vectors)
        return set(vectors.names)
    return set()
