"""``nlosctl identify-los``: unlabelled echoes to direct ones, and the targets that they are of."""

from __future__ import annotations

from dataclasses import replace

from nlosctl.cli.options.declarations import (
    Alternatives,
    EstimatesOut,
    Inputs,
    Methods,
    RangeStdM,
    SceneFile,
    SearchField,
    Strict,
    TargetZM,
)
from nlosctl.cli.options.groups import SolvingOptions, takes_groups
from nlosctl.cli.shared.solving import reading_words, run_methods, run_settings

__all__ = ["identify_los"]


@takes_groups
def identify_los(
    inputs: Inputs,
    *,
    method: Methods = ["assignment"],  # noqa: B006 - typer copies it
    estimates_out: EstimatesOut = None,
    alternatives: Alternatives = 1,
    field: SearchField = "sensors:1",
    target_z_m: TargetZM = None,
    scene: SceneFile = None,
    range_std_m: RangeStdM = None,
    strict: Strict = False,
    options: SolvingOptions,
) -> int:
    """Tell direct echoes of several targets from all others, and how many targets there are; a flag per range.

    A snapshot holds any number of ranges of each sensor, in any order. Without -o a terminal shows a preview, a pipe
    gets CSV. Exit codes: 0 done, 1 bad data or files, 2 the words of the command line, 3 under --strict when some
    snapshot got no target, 130 interrupted.
    """
    from nlosctl.contract.fields import parse_field

    words = replace(reading_words(inputs, options, estimates_out), kind="ranges", scene=scene, range_std_m=range_std_m)
    settings = replace(
        run_settings(options),
        alternatives=alternatives,
        field=parse_field(field),
        target_z_m=target_z_m,
        want_flags=True,
    )
    tables = {"flags": options.output, "estimates": estimates_out}
    return run_methods("identify-los", method, words, settings, tables, options, strict=strict)
