"""Ananthasubramaniam, Madhow: the paper with the errors in its text, and its ring of receivers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from nlosctl.plotting.panels import LinesPanel, Panel
from nlosctl.reproduce.experiment import Chunk, Erratum, Paper
from nlosctl.reproduce.panels import curve
from nlosctl.reproduce.samples import Results, median_of, rms_of
from nlosctl.reproduce.simulated import Fixes, Simulated, fixes, simulated

__all__ = [
    "AS_PUBLISHED",
    "BOOTSTRAPS",
    "EVERY_MAXIMUM",
    "FIELD",
    "PAPER",
    "RECEIVERS",
    "SEQUENTIAL",
    "panels_by_blocked",
    "ring",
    "solve",
]

FIELD = "circle:0,0,1"
"""The paper's field: the unit disc of receivers; lengths are in radii."""
EVERY_MAXIMUM = {"least_evidence": -1000.0, "search_outside": False}
"""Parameters of robust methods that keep the maximum of (23) within the field as a fix, however few rows agree."""
RECEIVERS = 8
BOOTSTRAPS = {1: 4, 2: 7, 3: 11, 4: 15}
"""M of Section V-B by number of blocked receivers."""
AS_PUBLISHED: dict[str, Any] = {"rivals": 0, **EVERY_MAXIMUM}
"""Parameters of ``suppress`` without what goes beyond Section IV-B."""
SEQUENTIAL = {"pairs": "random", "relinearize": False}
"""The sequential algorithm as published: random pairs, one round through the receivers."""


def ring(chunk: Chunk, **parameters: Any) -> Simulated:
    """Sample trials on the ring of Section V: receivers on the unit circle, 25 sources in turn."""
    return simulated("madhow-ring", chunk, **parameters)


def solve(trials: Simulated, chunk: Chunk, method: str, **parameters: Any) -> Fixes:
    """Solve each trial within the paper's field; ``suppress`` as published, ``mixture-ml`` wherever its maximum is."""
    if method == "suppress":
        parameters = AS_PUBLISHED | parameters
    if method == "mixture-ml":
        parameters = EVERY_MAXIMUM | parameters
    return fixes(trials, chunk, method, field=FIELD, **parameters)


def panels_by_blocked(
    results: Results, blocked: Sequence[int], marked: tuple[str, str], plain: tuple[str, str]
) -> Sequence[Panel]:
    """Return root mean square and median over the spread, with a colour per number of blocked receivers.

    ``marked`` and ``plain`` are the names and labels of two kinds of samples, drawn with and without markers.
    """
    panels = []
    for statistic, title in ((rms_of, "root mean square"), (median_of, "median")):
        lines = tuple(
            curve(
                results,
                "bearing_std_deg",
                f"{count} of {RECEIVERS} blocked, {label}",
                statistic(name),
                marker=name == marked[0],
                style=style,
                nlos_receivers=count,
            )
            for style, count in enumerate(blocked)
            for name, label in (marked, plain)
        )
        x_label, y_label = "AoA spread [deg]", "error [radii of the field]"
        panels.append(LinesPanel(x_label=x_label, y_label=y_label, title=title, lines=lines, log_y=True))
    return panels


PAPER = Paper(
    name="madhow",
    reference="Ananthasubramaniam, Madhow",
    ours=(
        "The bearing error of Fig. 8: 2, 4 and 6 degrees.",
        "The SNR of 12 dB of the ranges: 15.85, an error of 2.1 % of the range.",
        "The worlds of Fig. 10 and Fig. 11: the captions state which walls reflect and block, not where walls, "
        "receivers and sources are. Whether R4 is eliminated depends on that: random worlds that fit "
        "the caption of Fig. 10 stand beside ours.",
    ),
    errata=(
        Erratum(
            "(1)",
            "normalized by 1 - 2 Q(pi / 2 s) over +-pi/2 of broadside",
            "exact at broadside only; else Phi((pi/2 - t)/s) - Phi((-pi/2 - t)/s), or an error cut at +-pi/2",
        ),
        Erratum(
            "(2)",
            "1 / (2 sqrt2 s exp(-pi / (sqrt2 s)))",
            "1 / (sqrt2 s (1 - exp(-pi / (sqrt2 s)))); as printed it integrates to 2e9 at s = 0.1",
        ),
        Erratum("(7)", "A S (s + A S A')^-1", "S A' (s^2 + A S A')^-1"),
        Erratum("(8)-(10), (17)", "sigma for its square", "sigma^2; (17) lacks a factor 1/2"),
        Erratum("(11)", "a row vector", "its transpose"),
        Erratum("(13)", "arg(Xc - Xs)", "arg(Xs - Xc)"),
        Erratum(
            "(20)",
            "2 R^2 s^2 / (pi^2 (N - 1))",
            "4 R^2 s^2 / N exactly; with sin <= 1 it is at least 2 R^2 s^2 / (N - 1); the pi^2 is spurious",
        ),
        Erratum(
            "Section III-C",
            "the bound is largest at the centre of the disc",
            "only up to about 0.8 radii: 0.50 s^2 there, 0.71 s^2 at 0.9 radii between two receivers (N = 8)",
        ),
        Erratum("(21)", "gradient (R sin, -R cos), J(n-1)", "(-sin / R, cos / R) / s^2, and J(n)"),
        Erratum("(22)", "T_pol unitary", "its determinant is R; use the inverse"),
        Erratum("(24)", "log(e^a + e^b) ~ min(a, b)", "max(a, b), each over its own 2 s_k^2"),
        Erratum("(25)", "sqrt(2 alpha)", "sqrt(2) alpha"),
        Erratum("(27), (29)", "C(M, K) / C(M, P)", "C(K, M) / C(P, M)"),
        Erratum(
            "Section V-B",
            "M = 4, 7, 11, 15 for a failure probability below 1e-3",
            "these give 1.7e-3, 1.4e-3, 1.5e-3, 4.5e-3 by (27); 5, 8, 12, 18 are needed",
        ),
        Erratum(
            "Section V-A",
            "K = S~ (S~ + S~)^-1",
            "K = S- (S- + S~)^-1; it is unclear whether SNR = 12 dB means the number 12 or 15.85",
        ),
        Erratum(
            "Section V-B, Fig. 8",
            "Rayleigh(nu) is beyond 3 nu with probability exp(-9) = 1e-4",
            "exp(-4.5) = 1.1e-2; exp(-9) where nu^2 is the total variance",
        ),
        Erratum(
            "Section VI",
            "error = (rms on the unit disc) sqrt(area) / pi",
            "(rms) sqrt(area / pi): the unit disc has the area pi",
        ),
    ),
)
