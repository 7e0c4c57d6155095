"""The iteration that settles estimated options: maps with known fixed points are the truth."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from nlosctl.contract.learning import Learning
from nlosctl.contract.run_options import SolveOptions
from nlosctl.contract.scene import Scene
from nlosctl.geometry.exact_sums import ExactSums
from nlosctl.methods import ranges_mixture_ml
from nlosctl.pipeline.engine.passes import InputPasses
from nlosctl.pipeline.solve.learned_options import MOST_PASSES, learn_options
from nlosctl.pipeline.solve.method_runs import MethodRun

Values = Mapping[str, float | None]


class Passes:
    """Passes over nothing, whose sums are ones."""

    survey = SimpleNamespace(table=SimpleNamespace(dimension=2))

    def pool(self, statistic: Any) -> ExactSums:
        """Return the sums of one run."""
        sums = ExactSums()
        sums.add(0, np.ones((1, 1)))
        return sums


def learned(update: Any, *names: str, **options: Any) -> MethodRun:
    """Return the run after the iteration of ``update(options)`` from ``options``."""
    learning = Learning(
        options=names, statistics=lambda batch, options: np.ones((1, 1)), update=lambda sums, options: update(options)
    )
    spec = dataclasses.replace(ranges_mixture_ml.METHOD, learning=learning)
    run = MethodRun(spec=spec, options=ranges_mixture_ml.RangeMixtureOptions(**options), open_options=names)
    shown: list[str] = []
    (done,) = learn_options([run], "ranges", Scene(), SolveOptions(), cast(InputPasses, Passes()), shown.append)
    assert done.learned is not None
    assert len(shown) == done.learned.passes
    assert done.learned.values == {name: getattr(done.options, name) for name in names}
    return done


@pytest.mark.parametrize("rate", [0.0, 0.5, 0.97, -0.8])
def test_one_value_settles_at_the_fixed_point(rate: float) -> None:
    """Also where the plain iteration would need hundreds of passes; the value has six digits."""
    done = learned(lambda options: {"alpha": 0.0123456789 * (options.alpha / 0.0123456789) ** rate}, "alpha")
    assert done.learned is not None
    assert done.learned.settled
    assert done.learned.passes <= 5
    assert done.options.alpha == pytest.approx(0.0123457, rel=1e-3)
    assert float(f"{done.options.alpha:.6g}") == done.options.alpha


def test_two_coupled_values_settle() -> None:
    """The first is unknown at first."""

    def update(options: Any) -> Values:
        if options.bias_mean_m is None:
            return {"alpha": 0.3, "bias_mean_m": 4.0}
        alpha, mean = np.log(options.alpha / 0.1), np.log(options.bias_mean_m / 9.0)
        alpha, mean = 0.6 * alpha - 0.2 * mean, -0.2 * alpha + 0.8 * mean
        return {"alpha": 0.1 * float(np.exp(alpha)), "bias_mean_m": 9.0 * float(np.exp(mean))}

    done = learned(update, "alpha", "bias_mean_m")
    assert done.learned is not None
    assert done.learned.settled
    assert done.learned.passes < MOST_PASSES
    assert (done.options.alpha, done.options.bias_mean_m) == pytest.approx((0.1, 9.0), rel=0.005)


def test_values_stay_within_their_bounds() -> None:
    """A step that would extrapolate a share beyond one is not extrapolated."""
    seen: list[float] = []

    def update(options: Any) -> Values:
        seen.append(options.alpha)
        return {"alpha": min(0.95, options.alpha * 1.9)}

    assert learned(update, "alpha").options.alpha == pytest.approx(0.95, rel=1e-3)
    assert max(seen) < 1.0


def test_what_does_not_settle_is_reported() -> None:
    """After the last pass the values stay, marked."""
    done = learned(lambda options: {"alpha": 0.9 if options.alpha < 0.5 else 0.1}, "alpha")
    assert done.learned is not None
    assert (done.learned.settled, done.learned.passes) == (False, MOST_PASSES)


def test_too_little_information_leaves_the_value_unknown() -> None:
    """None settles at once."""
    done = learned(lambda options: {"bias_mean_m": None}, "bias_mean_m")
    assert done.learned is not None
    assert (done.learned.settled, done.learned.passes, done.options.bias_mean_m) == (True, 1, None)
