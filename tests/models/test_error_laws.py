"""Error laws: tails of weighted sums of three, compared with closed forms, quadrature and draws."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import integrate, stats

from nlosctl.errors import UsageError
from nlosctl.models.error_laws import exceedance, parse_error_law, quantile

SCIPY = {
    "gaussian": stats.norm(),
    "uniform": stats.uniform(-np.sqrt(3.0), 2.0 * np.sqrt(3.0)),
    "laplace": stats.laplace(scale=np.sqrt(0.5)),
    "student-t:5": stats.t(5.0, scale=np.sqrt(3.0 / 5.0)),
    "student-t:2.5": stats.t(2.5, scale=np.sqrt(0.5 / 2.5)),
}
WEIGHTS = [(1.0, 0.0, 0.0), (0.6, 0.8, 0.0), (0.3, 1.0, 0.02), (1.0, 1e-7, 1e-9), (2.0, 2.0, 2.0)]


@pytest.mark.parametrize("name", SCIPY)
def test_one_error_has_the_tail_of_its_law(name):
    """With one weight the tail is that of the law, for any scale and sign of the weight."""
    z = np.array([-2.0, -0.3, 0.0, 0.5, 1.5, 2.5, 6.0])
    for weights in ((3.0, 0.0, 0.0), (0.0, 0.0, -1e-3)):
        np.testing.assert_allclose(parse_error_law(name).survival(z, weights), SCIPY[name].sf(z), atol=1e-8)


@pytest.mark.parametrize("name", SCIPY)
def test_two_errors_agree_with_the_convolution(name):
    """With two weights the tail is the convolution (23), here by adaptive quadrature."""
    w1, w2, z = 0.8, 0.6, 1.7
    law = SCIPY[name]
    low, high = (-np.sqrt(3.0), np.sqrt(3.0)) if name == "uniform" else (-np.inf, np.inf)
    kinks = {"points": [(z - w1 * np.sqrt(3.0)) / w2]} if name == "uniform" else {}
    tail = 0.0
    pieces = [(low, z / w2), (z / w2, high)] if name == "laplace" else [(low, high)]
    for start, end in pieces:
        tail += integrate.quad(lambda e: law.pdf(e) * law.sf((z - w2 * e) / w1), start, end, epsabs=1e-11, **kinks)[0]
    assert parse_error_law(name).survival(np.array(z), (w1, w2, 0.0)) == pytest.approx(tail, abs=1e-6)


@pytest.mark.extensive
def test_three_equal_errors_in_closed_form():
    """Three uniform errors follow the Irwin-Hall law, three Laplace errors a difference of two Gamma(3)."""
    z = np.array([0.0, 0.5, 1.0, 1.9, 2.5, 2.9])
    corner = z * np.sqrt(3.0) / np.sqrt(3.0) / 2.0 + 1.5
    irwin_hall = 1.0 - sum((-1.0) ** k * [1, 3, 3, 1][k] * np.maximum(corner - k, 0.0) ** 3 / 6.0 for k in range(4))
    np.testing.assert_allclose(parse_error_law("uniform").survival(z, (1.0, 1.0, 1.0)), irwin_hall, atol=1e-12)
    scale = np.sqrt(0.5)
    sums = z * np.sqrt(3.0)
    gamma = [
        integrate.quad(lambda u, s=s: stats.gamma(3, scale=scale).pdf(u) * stats.gamma(3, scale=scale).sf(u + s), 0, 60)
        for s in sums
    ]
    laplace = parse_error_law("laplace").survival(z, (1.0, 1.0, 1.0))
    np.testing.assert_allclose(laplace, [value for value, _ in gamma], atol=1e-7)


@pytest.mark.extensive
@pytest.mark.parametrize("name", SCIPY)
@pytest.mark.parametrize("weights", WEIGHTS)
def test_thresholds_have_the_nominal_probability(name, weights):
    """Simulated errors exceed the threshold (27) with the nominal probability, also about a mean."""
    law = parse_error_law(name)
    generator = np.random.default_rng(5)
    draws = np.sum([w * law.draw(generator, 200_000) for w in weights], axis=0) / np.linalg.norm(weights)
    for shift in (0.0, 1.5):
        threshold = float(quantile(law, 0.05, weights, shift))
        assert float(exceedance(law, np.array(threshold), weights, shift)) == pytest.approx(0.05, abs=1e-9)
        assert np.mean(np.abs(draws + shift) > threshold) == pytest.approx(0.05, abs=0.002)


def test_thresholds_of_the_paper_scene():
    """delta / sigma of the direct path of scenario 1 at P_f 5 and 1 %."""
    from nlosctl.reproduce.shen.detection_theory import DetectionScene

    rows = DetectionScene(target_m=(5.2, 10.0)).direct_row()
    weights = rows.weights_m(rows.rays.difference(5))
    found = {name: [float(quantile(parse_error_law(name), p, weights)[0]) for p in (0.05, 0.01)] for name in SCIPY}
    assert found["gaussian"] == pytest.approx([1.960, 2.576], abs=6e-4)
    assert found["uniform"] == pytest.approx([1.877, 2.168], abs=6e-4)
    assert found["laplace"] == pytest.approx([2.061, 3.033], abs=6e-4)
    assert found["student-t:5"] == pytest.approx([1.986, 2.970], abs=6e-4)


@pytest.mark.extensive
@pytest.mark.parametrize("name", SCIPY)
def test_tails_do_not_depend_on_the_block(name):
    """Tail and threshold of a row do not depend on the other rows; NaN stays NaN."""
    generator = np.random.default_rng(6)
    law = parse_error_law(name)
    weights = tuple(generator.uniform(0.01, 1.0, (3, 30)))
    z = generator.uniform(-3.0, 3.0, 30)
    z[3] = np.nan
    together = law.survival(z, weights)
    thresholds = quantile(law, 0.05, weights, np.full(30, 0.7))
    for row in (0, 3, 17):
        alone = tuple(weight[row : row + 1] for weight in weights)
        np.testing.assert_array_equal(law.survival(z[row : row + 1], alone), together[row : row + 1])
        np.testing.assert_array_equal(quantile(law, 0.05, alone, np.full(1, 0.7)), thresholds[row : row + 1])
    assert np.isnan(together[3])


@pytest.mark.parametrize("text", ["normal", "student-t", "student-t:2", "student-t:x", "student-t:inf", ""])
def test_unknown_laws_are_refused(text):
    """An unknown law, or Student's t without a finite variance, is an error that lists the laws."""
    with pytest.raises(UsageError, match="student-t:NU"):
        parse_error_law(text)
