"""Random batches of triplets for the laws."""

from __future__ import annotations

import numpy as np

from nlosctl.contract.batches import TripletBatch
from nlosctl.geometry.angles import wrap_angle
from nlosctl.models.triplets import predict_triplets
from nlosctl.testing.trials import Draw, Trial

__all__ = ["TRIPLET_DRAWS", "draw_triplets"]

_SCALES_M = (1.0, 1e3, 1e5)


def draw_triplets(generator: np.random.Generator, snapshots: int, measurements: int, fault: str | None) -> Trial:
    """Draw paths over one target per snapshot, a third of them indirect: longer, and with other directions.

    Every path has its own transmitter and receiver, and unequal stds of 0.1 to 2 degrees and 0.01 to 1 % of the size.
    """
    shape = (snapshots, measurements)
    scale = float(generator.choice(_SCALES_M))
    tx, rx = generator.uniform(-scale, scale, (2, *shape, 2))
    target = generator.uniform(-scale, scale, (snapshots, 1, 2))
    if fault == "one place":
        rx = tx.copy()
    if fault == "on the baseline":
        target = 0.5 * (tx + rx)
    if fault == "on a transmitter":
        target = tx.copy()
    dod, doa, length = predict_triplets(tx, rx, np.broadcast_to(target, (*shape, 2)))
    indirect = generator.random(shape) < 1.0 / 3.0
    dod_std, doa_std = np.radians(10.0 ** generator.uniform(-1.0, 0.3, (2, *shape)))
    length_std = scale * 10.0 ** generator.uniform(-4.0, -2.0, shape)
    noise = generator.normal(size=(3, *shape))
    dod = np.where(indirect, generator.uniform(-np.pi, np.pi, shape), dod + dod_std * noise[0])
    doa = doa + doa_std * noise[1]
    length = np.abs(length + length_std * noise[2]) * np.where(indirect, generator.uniform(1.0, 3.0, shape), 1.0)
    length += 1e-12 * scale
    if fault == "parallel":
        doa = dod.copy()
    if fault == "no ellipse":
        length = 0.5 * np.hypot(*np.moveaxis(rx - tx, -1, 0))
    batch = TripletBatch(
        seed=np.asarray(generator.integers(0, 2**63, snapshots), dtype=np.uint64),
        tx_xy_m=np.asfortranarray(tx),
        rx_xy_m=np.asfortranarray(rx),
        dod_rad=np.asfortranarray(wrap_angle(dod)),
        doa_rad=np.asfortranarray(wrap_angle(doa)),
        path_length_m=np.asfortranarray(length),
        dod_std_rad=np.asfortranarray(dod_std),
        doa_std_rad=np.asfortranarray(doa_std),
        path_length_std_m=np.asfortranarray(length_std),
    )
    return Trial(batch=batch, size_m=3.0 * scale)


_DRAW = Draw(
    trial=draw_triplets,
    faults=("one place", "on the baseline", "on a transmitter", "parallel", "no ellipse"),
    directions=("dod_rad", "doa_rad"),
)

TRIPLET_DRAWS: dict[tuple[str, str], Draw] = {("triplets", job): _DRAW for job in ("localize", "detect-ip")}
"""How batches of triplets are drawn, by job."""
