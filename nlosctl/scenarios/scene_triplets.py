"""Triplets in the user's own scene: its sensors as transmitters and receivers, and its reflectors."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from nlosctl.arrays import IntArray
from nlosctl.contract.options import option
from nlosctl.contract.scene import Scene
from nlosctl.errors import UsageError, did_you_mean
from nlosctl.scenarios.scene_paths import SceneOptions, scenario_in_scene, scene_paths
from nlosctl.scenarios.spec import Columns
from nlosctl.scenarios.triplet_rows import triplet_columns

__all__ = ["SCENARIO", "SceneTripletsOptions", "generate"]


@dataclass(frozen=True, kw_only=True)
class SceneTripletsOptions(SceneOptions):
    """Parameters of ``triplets``."""

    OF_SPACE: ClassVar[tuple[str, ...]] = (*SceneOptions.OF_SPACE, "elevation_std_deg")

    transmitters: tuple[str, ...] = option(
        (), meaning="names of the sensors that transmit; default: the first of the scene"
    )
    receivers: tuple[str, ...] = option(
        (), meaning="names of the sensors that receive; default: all that do not transmit"
    )
    angle_std_deg: float = option(
        1.0, unit="deg", minimum=0.0, maximum=180.0, exclusive=True, meaning="standard deviation of both angles"
    )
    elevation_std_deg: float | None = option(
        None,
        unit="deg",
        minimum=0.0,
        maximum=90.0,
        exclusive=True,
        meaning="standard deviation of both elevations, if the sensors of the scene have heights; default: that of "
        "angles",
    )
    path_length_std_m: float = option(
        0.1, unit="m", minimum=0.0, exclusive=True, meaning="standard deviation of the path length"
    )


def generate(options: SceneTripletsOptions, generator: np.random.Generator, snapshots: int, scene: Scene) -> Columns:
    """Sample snapshots in ``scene``, each with its target and a row for every path over the target that exists.

    A path goes from a transmitter to the target, and from there to a receiver, each leg direct or by one reflector. It
    is direct if both legs are. ``path`` numbers the paths of a snapshot.
    """
    legs = scene_paths(replace(options, direct=True, detection_probability=1.0), scene, generator, snapshots)
    first, second = _leg_pairs(options, scene, legs.sensor)
    indirect = (legs.reflector[first] >= 0) | (legs.reflector[second] >= 0)
    wanted = indirect | options.direct
    first, second, indirect = first[wanted], second[wanted], indirect[wanted]
    found = generator.random((snapshots, first.size)) < options.detection_probability
    snapshot, pair = np.nonzero(legs.exists[:, first] & legs.exists[:, second] & found)
    out, back = first[pair], second[pair]
    counts = np.bincount(snapshot, minlength=snapshots)
    rows = snapshot.shape[0]
    angle_std = np.full(rows, np.radians(options.angle_std_deg))
    triplet = [
        legs.bearing_rad[snapshot, out],
        legs.bearing_rad[snapshot, back],
        legs.length_m[snapshot, out] + legs.length_m[snapshot, back],
    ]
    stds = [angle_std, angle_std, np.full(rows, options.path_length_std_m)]
    if legs.elevation_rad is not None:
        degrees = options.angle_std_deg if options.elevation_std_deg is None else options.elevation_std_deg
        triplet += [legs.elevation_rad[snapshot, out], legs.elevation_rad[snapshot, back]]
        stds += [np.full(rows, np.radians(degrees))] * 2
    return triplet_columns(
        generator=generator,
        snapshot=snapshot.astype(np.int64),
        path=np.arange(rows) - np.repeat(np.cumsum(counts) - counts, counts),
        tx_m=legs.sensor_m[snapshot, out],
        rx_m=legs.sensor_m[snapshot, back],
        triplet=tuple(triplet),
        stds=tuple(stds),
        truth_ip=indirect[pair],
        target_m=legs.target_m[snapshot],
    )


def _leg_pairs(options: SceneTripletsOptions, scene: Scene, sensor: IntArray) -> tuple[IntArray, IntArray]:
    """Return the first and the second leg (P,) of each path: indices of the ways whose sensors (K,) are given."""
    names = [known.name for known in scene.sensors]
    for name in (*options.transmitters, *options.receivers):
        if name not in names:
            raise UsageError(
                f"the scene has no sensor {name!r}{did_you_mean(name, names)}; there are: {', '.join(names)}"
            )
    transmitters = options.transmitters or tuple(names[:1])
    receivers = options.receivers or tuple(name for name in names if name not in transmitters)
    if not receivers:
        raise UsageError("the scene has no sensor that receives: add one, or set `parameters` receivers")
    transmits = np.isin(np.array(names), transmitters)[sensor]
    receives = np.isin(np.array(names), receivers)[sensor]
    first, second = np.nonzero(transmits[:, None] & receives[None, :])
    order = np.lexsort([second, first, sensor[second]])
    return first[order], second[order]


SCENARIO = scenario_in_scene(name="triplets", options=SceneTripletsOptions, generate=generate)
