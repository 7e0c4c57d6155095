"""``nlosctl localize``: measurements to estimates."""

from __future__ import annotations

from dataclasses import replace

from nlosctl.cli.options.declarations import (
    Alternatives,
    BearingStdDeg,
    DoaStdDeg,
    DodStdDeg,
    FlagsOut,
    Inputs,
    Kind,
    Methods,
    PathLengthStdM,
    RangeStdM,
    SceneFile,
    SearchField,
    Strict,
    TargetZM,
    TraceOut,
)
from nlosctl.cli.options.groups import SolvingOptions, takes_groups
from nlosctl.cli.shared.solving import reading_words, run_methods, run_settings

__all__ = ["localize"]


@takes_groups
def localize(
    inputs: Inputs,
    *,
    method: Methods = ["ml"],  # noqa: B006 - typer copies it
    flags_out: FlagsOut = None,
    trace_out: TraceOut = None,
    alternatives: Alternatives = 1,
    scene: SceneFile = None,
    kind: Kind = None,
    bearing_std_deg: BearingStdDeg = None,
    range_std_m: RangeStdM = None,
    dod_std_deg: DodStdDeg = None,
    doa_std_deg: DoaStdDeg = None,
    path_length_std_m: PathLengthStdM = None,
    field: SearchField = "sensors:1",
    target_z_m: TargetZM = None,
    strict: Strict = False,
    options: SolvingOptions,
) -> int:
    """Estimate positions from measurements, with covariances and a status for every snapshot.

    The columns that a file needs: 'nlosctl schema bearings'. Without -o a terminal shows a preview, a pipe gets CSV.
    Exit codes: 0 done, 1 bad data or files, 2 the words of the command line, 3 under --strict when some snapshot got
    no estimate, 130 interrupted.
    """
    from nlosctl.contract.fields import parse_field
    from nlosctl.io.results.layouts import carried_names

    words = replace(
        reading_words(inputs, options, flags_out, trace_out),
        kind=kind,
        scene=scene,
        bearing_std_deg=bearing_std_deg,
        range_std_m=range_std_m,
        dod_std_deg=dod_std_deg,
        doa_std_deg=doa_std_deg,
        path_length_std_m=path_length_std_m,
        extra_columns=None if flags_out is not None else carried_names(options.carry),
    )
    settings = replace(
        run_settings(options),
        alternatives=alternatives,
        field=parse_field(field),
        target_z_m=target_z_m,
        want_flags=flags_out is not None,
        want_trace=trace_out is not None,
    )
    tables = {"estimates": options.output, "flags": flags_out, "trace": trace_out}
    return run_methods("localize", method, words, settings, tables, options, strict=strict)
