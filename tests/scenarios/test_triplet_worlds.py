"""Triplet scenarios: physical paths, errors of the stated size, correct truth."""

from __future__ import annotations

import numpy as np
import pytest
from scenario_draws import draw_columns

from nlosctl.models.triplets import predict_triplets

WORLDS = [
    *(("shen", {"number": number}) for number in range(1, 6)),
    ("shen", {"number": 5, "reflectors": 2, "power_dbm": 30.0}),
    ("room", {}),
    ("room", {"receivers": 2, "paths": 25, "blocked_fraction": 1.0}),
]


@pytest.mark.parametrize(("name", "options"), WORLDS)
def test_direct_paths_have_normal_errors(name, options):
    """Errors of direct paths are normal with the stated stds; indirect paths are longer."""
    columns = draw_columns(name, 2000, seed=1, **options)
    tx, rx, target = (np.stack([columns[f"{n}_x_m"], columns[f"{n}_y_m"]], axis=1) for n in ("tx", "rx", "truth"))
    dod, doa, length = predict_triplets(tx, rx, target)
    direct = ~columns["truth_ip"]
    parts = [
        np.angle(np.exp(1j * (columns["dod_rad"] - dod))) / columns["dod_std_rad"],
        np.angle(np.exp(1j * (columns["doa_rad"] - doa))) / columns["doa_std_rad"],
        (columns["path_length_m"] - length) / columns["path_length_std_m"],
    ]
    excess = columns["path_length_m"] - length
    assert (excess > -5.0 * columns["path_length_std_m"])[~direct].all()
    if name == "room" and options:
        assert not direct.any()
        return
    assert 200 < direct.sum() < columns["dod_rad"].shape[0]
    for scaled in parts:
        small = scaled[direct & (columns["dod_std_rad"] < 0.3) & (columns["doa_std_rad"] < 0.3)]
        assert small.mean() == pytest.approx(0.0, abs=5.0 / np.sqrt(small.size))
        assert small.std() == pytest.approx(1.0, abs=5.0 / np.sqrt(small.size))


def test_folded_angles_are_lines():
    """With fold_angles all angles are in [0, pi) and describe the same lines."""
    plain, folded = draw_columns("shen", 500, seed=2), draw_columns("shen", 500, seed=2, fold_angles=True)
    for name in ("dod_rad", "doa_rad"):
        assert ((folded[name] >= 0.0) & (folded[name] < np.pi)).all()
        np.testing.assert_allclose(np.sin(folded[name] - plain[name]), 0.0, atol=1e-12)
    assert (draw_columns("shen", 500, seed=2, region_m=(-8.0, 8.0, 0.0, 0.2))["doa_rad"] < 0.0).any()


def test_room_walls_reflect():
    """Every path of a room unfolds over its walls: from the node, the other end of a leg is an image."""
    columns = draw_columns("room", 50, seed=3, receivers=1, paths=25, blocked_fraction=0.0, angle_std_deg=1e-9,
                   path_length_std_m=1e-12)  # fmt: skip
    half = {0: 5.0, 1: 4.0}
    count = 0
    for n in range(columns["dod_rad"].shape[0]):
        target = np.array([columns["truth_x_m"][n], columns["truth_y_m"][n]])
        images = [target]
        for axis, side in half.items():
            for sign in (-1.0, 1.0):
                image = target.copy()
                image[axis] = 2.0 * sign * side - image[axis]
                images.append(image)
        tx = np.array([columns["tx_x_m"][n], columns["tx_y_m"][n]])
        rx = np.array([columns["rx_x_m"][n], columns["rx_y_m"][n]])
        fits = [
            abs(np.hypot(*(one - tx)) + np.hypot(*(other - rx)) - columns["path_length_m"][n])
            + abs(np.angle(np.exp(1j * (np.arctan2(*(one - tx)[::-1]) - columns["dod_rad"][n]))))
            + abs(np.angle(np.exp(1j * (np.arctan2(*(other - rx)[::-1]) - columns["doa_rad"][n]))))
            for one in images
            for other in images
        ]
        place = int(np.argmin(fits))
        assert fits[place] < 1e-6
        assert columns["truth_ip"][n] == (place > 0)
        count += place > 0
    assert count == 50 * 24


def test_rooms_number_their_paths():
    """Paths count from 0 in every snapshot, without blocked direct paths."""
    columns = draw_columns("room", 300, seed=4, blocked_fraction=0.5)
    for snapshot in range(300):
        path = columns["path"][columns["snapshot"] == snapshot]
        assert path.tolist() == list(range(path.shape[0]))
    assert np.mean(~columns["truth_ip"]) < 0.2
