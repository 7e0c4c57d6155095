"""``nlosctl detect-ip``: triplets to direct and indirect paths."""

from __future__ import annotations

from dataclasses import replace

from nlosctl.cli.options.declarations import (
    Details,
    DoaStdDeg,
    DodStdDeg,
    EstimatesOut,
    Inputs,
    Methods,
    PathLengthStdM,
)
from nlosctl.cli.options.groups import SolvingOptions, takes_groups
from nlosctl.cli.shared.solving import reading_words, run_methods, run_settings

__all__ = ["detect_ip"]


@takes_groups
def detect_ip(
    inputs: Inputs,
    *,
    method: Methods = ["chi2"],  # noqa: B006 - typer copies it
    estimates_out: EstimatesOut = None,
    details: Details = False,
    dod_std_deg: DodStdDeg = None,
    doa_std_deg: DoaStdDeg = None,
    path_length_std_m: PathLengthStdM = None,
    options: SolvingOptions,
) -> int:
    """Flag indirect paths among triplets of departure, arrival and path length; a row per path.

    A path is direct if it goes from the transmitter over the target to the receiver and over nothing else. Without -o
    a terminal shows a preview, a pipe gets CSV. Exit codes: 0 done, 1 bad data or files, 2 the words of the command
    line, 130 interrupted.
    """
    words = replace(
        reading_words(inputs, options, estimates_out),
        kind="triplets",
        dod_std_deg=dod_std_deg,
        doa_std_deg=doa_std_deg,
        path_length_std_m=path_length_std_m,
    )
    settings = replace(
        run_settings(options), want_estimates=estimates_out is not None, want_flags=True, want_details=details
    )
    tables = {"flags": options.output, "estimates": estimates_out}
    return run_methods("detect-ip", method, words, settings, tables, options)
