"""Shen, Molisch 2012: the paper with the errors in its text, its rules, and its trials, direct and indirect paths."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from nlosctl.api import detect_ip
from nlosctl.arrays import FloatArray
from nlosctl.reproduce.experiment import Chunk, Erratum, Paper
from nlosctl.reproduce.samples import Condition, Samples
from nlosctl.reproduce.simulated import Simulated, simulated
from nlosctl.reproduce.verdicts import Expected, printed

__all__ = [
    "ALL_READINGS",
    "CHUNK_TRIALS",
    "LEVELS",
    "PAPER",
    "READINGS",
    "RULES",
    "TRIALS",
    "detection_samples",
    "p_values",
    "printed_share",
    "rate",
    "rates",
    "triplet_trials",
]

PAPER = Paper(
    name="shen",
    reference="Shen, Molisch 2012",
    ours=(
        "The transmit power of Table V: 1 dBm. Its fits: the converged maximum of the likelihood, from several initial "
        "estimates; the paper iterates a quasi-Newton method from the average of the intersections and detects by "
        "lambda 5 alone (that gives rms errors of .54, .63, .87 and .66 m, the paper's .56, .82, .79 and .52).",
        "Whether directions are rays or lines: lines in Table IV, the only reading that gives its numbers; rays "
        "(`behind_is_ip`: an intersection behind a node is indirect) in scenario 4 and Fig. 8.",
    ),
    errata=(
        Erratum(
            "(11)",
            "c3 = -2 (x^2 / mu3^3 - y^2 mu3 / (mu3^2 - d^2)^2)",
            "a plus between the terms; no number of the paper shows it, the path length has hardly any weight",
        ),
        Erratum(
            "(14)",
            "(3,1) b3 c3, (5,1) over alpha, (5,3) b3, and superscripts of rows 1 to 4",
            "b3 c1, over gamma, b1, each coefficient at its own intersection; Table III has the right W",
        ),
        Erratum("(26), (33)", "1 / (2 pi)", "1 / sqrt(2 pi)"),
        Erratum(
            "(29)-(31)",
            "each of the three densities is shifted by the mean",
            "only one of them: the mean would be three times as large",
        ),
        Erratum("(34)", "y / (m - x / 2), y / (m + x / 2)", "y / (x - d / 2), y / (x + d / 2)"),
        Erratum("Section IV", "x1 = x2 = x3, y2 = y2 = y3", "y1 = y2 = y3"),
        Erratum("Section IV-D", "a false alarm is to decide for a DP when an IP happens", "a miss"),
        Erratum("Section VI-A", "6 scenarios; scenario 5 has three objects", "5; one reflector"),
        Erratum("Section VI-E", '"several orders of magnitude"', "its Table V says 5 to 9 times"),
        Erratum("Table IV", "expected P_f 0075", "0.07"),
        Erratum(
            "Table I, Theorem 1",
            "blind spots of indirect paths alone; all rules equal for direct ones",
            "direct paths have them too (lambda 1 at mu2 = pi/2, 3 at mu1 = pi/2, 6 at x = 0, 5 at y -> 0): "
            "there the false alarms of a rule are far from P_f",
        ),
        Erratum(
            "Algorithm 1",
            "no word on lines that meet behind transmitter or receiver",
            "the simulator behind Tables IV and V must have taken lines for rays and called such paths indirect: "
            "with that, and not without, their numbers come out (fold_angles, behind_is_ip)",
        ),
    ),
)

TRIALS = 200_000
CHUNK_TRIALS = 20_000

LEVELS = tuple(
    sorted(
        {*(round(10.0**power, 6) for power in np.linspace(-3.0, 0.0, 31)), 0.03, 0.04, 0.05, 0.07, 0.3, 0.5, 0.9, 0.95}
    )
)
"""Expected P_f at which paths are tested; samples hold the index of the first level at which a path is flagged."""

RULES: Mapping[str, tuple[str, str, Mapping[str, Any]]] = {
    **{f"lambda{rule}": (f"lambda {rule}", "tdaj", {"rule": f"lambda{rule}"}) for rule in range(1, 7)},
    **{f"fusion{k}": (f"fusion, K = {k}", "tdaj", {"rule": "fusion", "k": k}) for k in (0, 1, 5)},
    "chi2": ("chi2 (recommended)", "chi2", {}),
    "chi2_miss": ("chi2, rays_miss=true", "chi2", {"rays_miss": True}),
}
"""Label, method and parameters of each rule."""

READINGS = {"rays": "rays, Algorithm 1", "lines": "lines, as simulated"}
"""Readings of the paper: rays as in Algorithm 1, or lines as in its simulator, indirect if they meet behind a node."""

ALL_READINGS = {**READINGS, "behind": "rays, behind is indirect"}
"""A third one for scenario 4 and Fig. 8: rays, and a path whose rays meet behind a node is indirect."""


def triplet_trials(chunk: Chunk, *, indirect: bool, reading: str = "rays", **parameters: Any) -> Simulated:
    """Sample the chunk's trials of ``shen``, one path each, all indirect or all direct."""
    share, folded = float(indirect), reading == "lines"
    return simulated("shen", chunk, indirect_fraction=share, fold_angles=folded, **parameters)


def p_values(trials: Simulated, chunk: Chunk, rule: str, *, reading: str = "rays") -> FloatArray:
    """Return each path's p-value (T,) by a rule, 1 if it has none."""
    _, method, options = RULES[rule]
    parameters: dict[str, Any] = {**options, **({"behind_is_ip": True} if reading != "rays" else {})}
    flags = detect_ip(trials.table, method=method, seed=chunk.seed, **parameters).flags
    return np.nan_to_num(np.asarray(flags.column("p_value").to_numpy(zero_copy_only=False), dtype=np.float64), nan=1.0)


def detection_samples(condition: Condition, chunk: Chunk, *, number: int, rules: Sequence[str]) -> Samples:
    """Return the index of the first of `LEVELS` that flags a path, for direct and indirect paths and each rule.

    The condition may have a ``reading``, for the paper's rules only, and has parameters of the scenario ``shen``.
    """
    parameters: dict[str, Any] = {"number": number, **condition}
    wanted = str(parameters.pop("reading", "rays"))
    samples = {}
    for truth in ("direct", "indirect"):
        indirect = truth == "indirect"
        trials = {
            reading: triplet_trials(chunk, indirect=indirect, reading=reading, **parameters)
            for reading in {"rays", wanted}
        }
        for rule in rules:
            reading = wanted if RULES[rule][1] == "tdaj" else "rays"
            p_value = p_values(trials[reading], chunk, rule, reading=reading)
            samples[f"{truth}_{rule}"] = np.searchsorted(LEVELS, p_value, side="right").astype(float)
    return samples


def rate(samples: Samples, *, truth: str, rule: str, level: float) -> float:
    """Return the share of paths flagged at an expected P_f of `LEVELS`: P_f of direct paths, P_d of indirect ones."""
    return float(np.mean(samples[f"{truth}_{rule}"] <= LEVELS.index(level)))


def printed_share(shown: str, trials: int = TRIALS) -> Expected:
    """Return a printed share of the paper's trials, with its binomial error."""
    probability = float(shown)
    return printed(shown, standard_error=math.sqrt(probability * (1.0 - probability) / trials))


def rates(samples: Samples, *, truth: str, rule: str) -> FloatArray:
    """Return the `rate` at each of `LEVELS`."""
    first = samples[f"{truth}_{rule}"].astype(np.int64)
    counts = np.bincount(first, minlength=len(LEVELS) + 1)[: len(LEVELS)]
    return np.asarray(np.cumsum(counts) / first.shape[0])
