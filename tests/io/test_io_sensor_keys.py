"""Numbering codes that occur among many possible ones."""

from __future__ import annotations

import numpy as np
import pytest

from nlosctl.io.measurements.completion import sensor_keys


@pytest.mark.parametrize("most", [1, 1 << 22])
@pytest.mark.parametrize("shape", [(0,), (1,), (500,), (40, 7)])
def test_codes_are_numbered_as_numpy_does(most: int, shape: tuple[int, ...], monkeypatch: pytest.MonkeyPatch) -> None:
    """The codes that occur rise, and each index is that of its code, by a table and by sorting."""
    monkeypatch.setattr(sensor_keys, "_MOST_CODES", most)
    codes = np.random.default_rng(1).integers(0, 90, shape)
    found, index = sensor_keys.numbered(codes, 100)
    expected, of_numpy = np.unique(codes, return_inverse=True)
    assert found.tolist() == expected.tolist()
    assert index.tolist() == of_numpy.reshape(shape).tolist()
