"""Faults of meaning, put into a copy of the program one by one: the fast tests named beside each must notice it.

``python tests/reliability/chosen_mutants.py [PART OF A NAME]`` prints each mutant and whether it was noticed; exit 1 if
one was not, or no longer applies. Unlike those of mutmut they are faults that a change of the mathematics could make.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]
COPIED = ("nlosctl", "tests", "docs", "fixtures", "schemas", "pyproject.toml", "README.md")


@dataclass(frozen=True)
class Mutant:
    """A text of a module, what replaces it, and the tests that must fail then."""

    name: str
    module: str
    text: str
    instead: str
    tests: tuple[str, ...]


CALIBRATION = "tests/methods/test_outlier_calibration.py"
_COVARIANCE = "covariance_m2=np.where(certain[:, None], covariance.stack(), np.nan),"
_SETS = ("tests/solvers/test_echo_sets.py",)
_EVIDENCE = ("tests/solvers/test_evidence.py",)


def _scaled(factor: float, tests: tuple[str, ...]) -> Mutant:
    scaled = _COVARIANCE.replace("covariance.stack()", f"{factor} * covariance.stack()")
    return Mutant(f"covariances x {factor}, {tests[0]}", "contract/results.py", _COVARIANCE, scaled, tests)


MUTANTS = (
    *(
        _scaled(factor, (tests,))
        for factor in (0.25, 0.5)
        for tests in (
            CALIBRATION,
            "tests/methods/test_bearings_sequential.py",
            "tests/methods/test_bearings_consistency.py",
            "tests/methods/test_ranges_localize.py",
            "tests/methods/test_triplets_ml.py",
        )
    ),
    *(
        Mutant(
            f"los_probability is its square root, {module}",
            f"methods/{module}.py",
            text,
            instead,
            (f"{CALIBRATION}::test_los_probabilities_are_shares",),
        )
        for module, text, instead in (
            ("bearings_mixture_ml", "judged.used, probability, numbers", "judged.used, probability**0.5, numbers"),
            ("ranges_mixture_ml", "> 0.5, probability, numbers", "> 0.5, probability**0.5, numbers"),
            ("bearings_suppress", "judged.probability, numbers", "judged.probability**0.5, numbers"),
        )
    ),
    Mutant(
        "ambiguous within half a nat",
        "solvers/mixture/outlier_options.py",
        "ambiguous_within: float = option(\n        2.0,",
        "ambiguous_within: float = option(\n        0.5,",
        (CALIBRATION,),
    ),
    Mutant(
        "denser outliers make rivals lighter",
        "solvers/mixture/consensus.py",
        "- fixes.cost + (fixes.n_used - fixes.n_used[:, :1]) * log_gain",
        "- fixes.cost - (fixes.n_used - fixes.n_used[:, :1]) * log_gain",
        ("tests/solvers/test_loose_odds.py",),
    ),
    Mutant(
        "ranges that all agree need as much evidence as others",
        "solvers/mixture/range_rows.py",
        "return np.maximum(evidence, evidence + bonus)",
        "return evidence",
        ("tests/methods/test_ranges_mixture.py",),
    ),
    Mutant(
        "no threshold of ranges",
        "solvers/sequential/hypotheses.py",
        "below &= (self.range_m < limits.range_m) | np.isinf(limits.range_m)",
        "below &= True",
        ("tests/methods/test_bearings_with_ranges.py",),
    ),
    Mutant(
        "(7) with the last spread",
        "solvers/echoes/structured_sets.py",
        "float(np.mean(sets.spread_m[chosen]))",
        "float(sets.spread_m[chosen[-1]])",
        _SETS,
    ),
    Mutant(
        "no re-centring of structured sets",
        "solvers/echoes/structured_sets.py",
        "second = crossings.nearest_root(_mean(x), _mean(y))",
        "second = crossings.nearest_root(seeds.x, seeds.y)",
        _SETS,
    ),
    Mutant(
        "a gate four times as wide",
        "solvers/echoes/candidates.py",
        "(distance > gates.gate_std)",
        "(distance > 4.0 * gates.gate_std)",
        _SETS,
    ),
    Mutant(
        "a chi-square gate four times as wide",
        "solvers/echoes/candidates.py",
        "limit = 2.0 * gammainccinv",
        "limit = 8.0 * gammainccinv",
        _EVIDENCE,
    ),
    *(
        Mutant(
            f"target_reward {reward}",
            "methods/ranges_assignment.py",
            "target_reward: float = option(\n        1.5,",
            f"target_reward: float = option(\n        {reward},",
            _EVIDENCE,
        )
        for reward in (0.5, 8.0, 14.0)
    ),
    Mutant(
        "the kernel of clutter is twice as wide",
        "solvers/echoes/evidence.py",
        "kernel = np.exp(-0.5 * ((here - pooled) / bandwidth_m) ** 2)",
        "kernel = np.exp(-0.125 * ((here - pooled) / bandwidth_m) ** 2)",
        _EVIDENCE,
    ),
    Mutant(
        "the kernel of clutter is not reflected at zero",
        "solvers/echoes/evidence.py",
        "kernel += np.exp(-0.5 * ((here + pooled) / bandwidth_m) ** 2)",
        "kernel += 0.0",
        _EVIDENCE,
    ),
    Mutant(
        "a number of Table I of Liang",
        "reproduce/liang/tables.py",
        "840, 710, 481",
        "840, 720, 481",
        ("tests/reproduce/test_printed_numbers.py",),
    ),
    Mutant(
        "a number of Table III of Shen",
        "reproduce/shen/table3.py",
        '("0.542", "0.663",',
        '("0.542", "0.653",',
        ("tests/reproduce/test_printed_numbers.py",),
    ),
)


def fails(tests: tuple[str, ...], copy: Path) -> bool:
    """Return whether one of the fast tests fails in the copy."""
    words = [sys.executable, "-m", "pytest", "-q", "-x", "-n", "0", "-p", "no:cacheprovider"]
    words += ["-m", "not process and not slow and not extensive", *tests]
    environment = {**os.environ, "PYTHONPATH": str(copy)}
    done = subprocess.run(words, cwd=copy, env=environment, capture_output=True, check=False)
    return done.returncode != 0


def noticed(mutant: Mutant, copy: Path) -> bool | None:
    """Return whether a test fails with the mutant; None if its text is not in the module exactly once."""
    path = copy / "nlosctl" / mutant.module
    original = path.read_text(encoding="utf-8")
    if original.count(mutant.text) != 1:
        return None
    path.write_text(original.replace(mutant.text, mutant.instead), encoding="utf-8")
    try:
        return fails(mutant.tests, copy)
    finally:
        path.write_text(original, encoding="utf-8")


def main(part: str = "") -> int:
    """Run the mutants whose name contains ``part``; return the exit code."""
    left = 0
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder)
        for name in COPIED:
            source = ROOT / name
            copied = shutil.copytree if source.is_dir() else shutil.copy
            copied(source, copy / name)
        chosen = [mutant for mutant in MUTANTS if part in mutant.name]
        for tests in dict.fromkeys(mutant.tests for mutant in chosen):
            if fails(tests, copy):
                sys.stdout.write(f"fails without a mutant: {' '.join(tests)}\n")
                return 1
        for mutant in chosen:
            result = noticed(mutant, copy)
            left += not result
            word = {True: "noticed", False: "NOT NOTICED", None: "DOES NOT APPLY"}[result]
            sys.stdout.write(f"{word} {mutant.name}\n")
            sys.stdout.flush()
    return 1 if left else 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
