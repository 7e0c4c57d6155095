"""Triplet scenarios: physical paths, errors of the stated size, correct truth."""

from __future__ import annotations

import numpy as np
import pytest
from scenario_draws import draw_columns

import nlosctl
from nlosctl.errors import UsageError
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


def test_a_room_in_space_has_the_paths_of_its_images():
    """In space every path is that of two of seven images, with the elevations at both nodes; 49 pairs exist."""
    columns = draw_columns("room", 40, seed=5, dimensions=3, receivers=1, paths=49, blocked_fraction=0.0,
                           angle_std_deg=1e-9, path_length_std_m=1e-12)  # fmt: skip
    tx, rx, target = (
        np.stack([columns[f"{node}_{axis}_m"] for axis in "xyz"], axis=1) for node in ("tx", "rx", "truth")
    )
    for nodes in (tx, rx, target):
        assert (np.abs(nodes[:, :2]) < [5.0, 4.0]).all()
        assert ((nodes[:, 2] > 0.0) & (nodes[:, 2] < 3.0)).all()
    images = np.repeat(target[:, None], 7, axis=1)
    for number, (axis, wall) in enumerate(((0, -5.0), (0, 5.0), (1, -4.0), (1, 4.0), (2, 0.0), (2, 3.0)), 1):
        images[:, number, axis] = 2.0 * wall - target[:, axis]
    rays = {}
    for name, node in (("dod", tx), ("doa", rx)):
        z, e = columns[f"{name}_rad"], columns[f"{name}_elevation_rad"]
        measured = np.stack([np.cos(e) * np.cos(z), np.cos(e) * np.sin(z), np.sin(e)], axis=1)
        ways = images - node[:, None]
        lengths = np.linalg.norm(ways, axis=2)
        off = np.linalg.norm(ways / lengths[..., None] - measured[:, None], axis=2)
        rays[name] = off, lengths
    excess = rays["dod"][1][:, :, None] + rays["doa"][1][:, None] - columns["path_length_m"][:, None, None]
    misfit = rays["dod"][0][:, :, None] + rays["doa"][0][:, None] + np.abs(excess)
    best = misfit.reshape(-1, 49).argmin(axis=1)
    assert misfit.min(axis=(1, 2)).max() < 1e-6
    assert ((best == 0) == ~columns["truth_ip"]).all()
    assert (np.sort(best.reshape(40, 49), axis=1) == np.arange(49)).all()


@pytest.mark.parametrize("dimensions", [2, 3])
def test_false_alarms_of_a_room_are_as_many_as_stated(dimensions):
    """Of direct paths the share with a p-value below .01, .05 and .1 is that number, within four standard errors."""
    table = nlosctl.simulate(
        "room", trials=1500, seed=6, dimensions=dimensions, receivers=1, paths=1, blocked_fraction=0.0
    )
    p_value = np.array(nlosctl.detect_ip(table).flags["p_value"].to_pylist())
    for level in (0.01, 0.05, 0.1):
        assert (p_value < level).mean() == pytest.approx(level, abs=4.0 * np.sqrt(level * (1.0 - level) / 1500))


def test_a_plan_of_a_room_has_25_paths():
    """More than the 25 pairs of legs in a plan are refused."""
    with pytest.raises(UsageError, match="at most 25 with dimensions=2"):
        draw_columns("room", 1, seed=1, paths=26)
