"""The files of a run after the first, which have its kind, its scene and its column of times."""

from __future__ import annotations

from dataclasses import replace

from nlosctl.contract.run_options import InputOptions
from nlosctl.errors import DataError
from nlosctl.io.measurements.column_mapping import kind_of_columns
from nlosctl.io.measurements.missing_columns import refuse_mixed_stds
from nlosctl.io.measurements.survey import InputSurvey, OpenTable, planned, scene_of
from nlosctl.io.measurements.table_schemas import check_same_scene, unlabelled_table
from nlosctl.io.paths.inputs import Input, Part
from nlosctl.io.readers.base import closed_on_failure
from nlosctl.io.readers.open_file import open_part

__all__ = ["open_next"]


def open_next(given: Input, part: Part, options: InputOptions, survey: InputSurvey, first: Part) -> OpenTable:
    """Open a file after the first, of the same kind and scene; raise DataError for another."""
    file = open_part(part, options.chunk_rows, options.use_threads)
    with closed_on_failure(file):
        if not isinstance(options.scene, str):
            check_same_scene(survey.scene, scene_of(given, part, file, options), first, part)
        opened, _ = planned(part, file, survey.table, options, survey.scene)
        survey.constants |= opened.plan.constants
        refuse_mixed_stds(survey.units, opened.plan.units, part.name)
        if opened.time_column != survey.time_column:
            raise DataError(
                f"{part.name}: times in {opened.time_column!r}, those of {first.name} are not; give one kind"
            )
        names = opened.all_names
        unlabelled = unlabelled_table(replace(options, kind=None), names) if options.unlabelled else None
        kind = kind_of_columns(names) if unlabelled is None else unlabelled.name
        if options.kind is None and kind != survey.table.name:
            raise DataError(
                f"{part.name}: contains {kind}, but {first.name} contains {survey.table.name}; "
                f"give files of one kind, or choose it by `kind`"
            )
        return opened
