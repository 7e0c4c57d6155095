"""The five scenarios of Shen, Molisch 2012, Table II: one transmitter and receiver, a target, one or two reflectors."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray
from nlosctl.contract.options import option
from nlosctl.contract.scene import Scene
from nlosctl.models.path_noise import signal_to_noise, triplet_standard_deviations
from nlosctl.models.reflected_paths import trace_over_objects
from nlosctl.scenarios.spec import Columns, ScenarioSpec
from nlosctl.scenarios.triplet_rows import triplet_columns

__all__ = ["SCENARIO", "ShenOptions", "generate", "scene"]


_TX, _RX = np.array([[-2.5, 0.0]]), np.array([[2.5, 0.0]])
_REGION_M = (-8.0, 8.0, 0.0, 10.0)


@dataclass(frozen=True, kw_only=True)
class _Row:
    """A row of Table II; no position: anywhere in the region."""

    power_dbm: float
    reflectors: int
    target_m: tuple[float, float] | None = None
    reflector_m: tuple[float, float] | None = None


_TABLE_II = {
    1: _Row(power_dbm=1.0, reflectors=1, target_m=(5.2, 10.0), reflector_m=(4.8, 9.8)),
    2: _Row(power_dbm=1.0, reflectors=1, target_m=(5.2, 10.0)),
    3: _Row(power_dbm=1.0, reflectors=1),
    4: _Row(power_dbm=25.0, reflectors=2),
    5: _Row(power_dbm=1.0, reflectors=1),
}


@dataclass(frozen=True, kw_only=True)
class ShenOptions:
    """Parameters of ``shen``."""

    number: int = option(3, minimum=1, maximum=5, meaning="scenario 1 to 5 of Table II; 5 is 3 for other powers")
    power_dbm: float | None = option(None, unit="dBm", meaning="transmitted power; none: the scenario's own")
    reflectors: int = option(0, minimum=0, maximum=2, meaning="reflectors of an indirect path; 0: the scenario's own")
    indirect_fraction: float = option(0.5, minimum=0.0, maximum=1.0, meaning="share of indirect paths")
    target_m: tuple[float, float] | None = option(None, unit="m", meaning="x,y of the target; none: the scenario's own")
    region_m: tuple[float, float, float, float] | None = option(
        None, unit="m", meaning="x from,to and y from,to of targets and reflectors; none: -8,8,0,10"
    )
    fold_angles: bool = option(
        False, meaning="report angles modulo pi, as the paper's simulator did: lines in place of rays"
    )


def scene(options: ShenOptions) -> Scene:
    """Return an empty scene: the transmitter and receiver stand in every row, (-2.5, 0) and (2.5, 0)."""
    return Scene()


def generate(options: ShenOptions, generator: np.random.Generator, snapshots: int) -> Columns:
    """Draw snapshots of one path each; the targets of direct and indirect paths have the same law.

    The order of target and reflectors along a path is random, in scenario 1 the reflector comes first.
    """
    row = _TABLE_II[options.number]
    region = options.region_m or _REGION_M
    target = _place(generator, snapshots, options.target_m or row.target_m, region)
    count = options.reflectors or row.reflectors
    reflectors = np.stack([_place(generator, snapshots, row.reflector_m, region) for _ in range(count)], axis=1)
    place = generator.integers(0, count + 1, snapshots)
    if row.reflector_m is not None:
        place = np.full(snapshots, count)
    indirect = generator.random(snapshots) < options.indirect_fraction
    power_dbm = row.power_dbm if options.power_dbm is None else options.power_dbm
    triplet, stds = _measure(target, reflectors, place, indirect, power_dbm)
    columns = triplet_columns(
        generator=generator,
        snapshot=np.arange(snapshots, dtype=np.int64),
        path=np.zeros(snapshots, dtype=np.int64),
        tx_xy_m=np.broadcast_to(_TX, (snapshots, 2)),
        rx_xy_m=np.broadcast_to(_RX, (snapshots, 2)),
        triplet=triplet,
        stds=stds,
        truth_ip=indirect,
        target_xy_m=target,
    )
    if not options.fold_angles:
        return columns
    return {**columns, **{name: np.mod(columns[name], np.pi) for name in ("dod_rad", "doa_rad")}}


Triplet = tuple[FloatArray, FloatArray, FloatArray]


def _measure(
    target: FloatArray, reflectors: FloatArray, place: IntArray, indirect: BoolArray, power_dbm: float
) -> tuple[Triplet, Triplet]:
    """Return noise-free DOD, DOA, path length, and their standard deviations; ``place``: where the target stands."""
    direct = trace_over_objects(_TX, _RX, target[:, None])
    count = reflectors.shape[1]
    objects = np.empty((target.shape[0], count + 1, 2))
    for slot in range(count + 1):
        before, after = reflectors[:, min(slot, count - 1)], reflectors[:, max(slot - 1, 0)]
        objects[:, slot] = np.where((place > slot)[:, None], before, after)
    objects[np.arange(target.shape[0]), place] = target
    detour = trace_over_objects(_TX, _RX, objects)
    snr = np.where(indirect, signal_to_noise(power_dbm, detour.legs_m), signal_to_noise(power_dbm, direct.legs_m))
    dod = np.where(indirect, detour.dod_rad, direct.dod_rad)
    doa = np.where(indirect, detour.doa_rad, direct.doa_rad)
    length = np.where(indirect, detour.path_length_m, direct.path_length_m)
    return (dod, doa, length), triplet_standard_deviations(snr, np.sin(dod), np.sin(doa))


def _place(
    generator: np.random.Generator,
    count: int,
    fixed_m: tuple[float, float] | None,
    region_m: tuple[float, float, float, float],
) -> FloatArray:
    """Return positions (N, 2): the fixed one, or uniform over the region."""
    if fixed_m is not None:
        return np.tile(np.array(fixed_m), (count, 1))
    x = generator.uniform(region_m[0], region_m[1], count)
    return np.stack([x, generator.uniform(region_m[2], region_m[3], count)], axis=1)


SCENARIO = ScenarioSpec(
    name="shen",
    kind="triplets",
    summary="the five scenarios of Shen, Molisch: a target, one or two point reflectors, one path a snapshot",
    reference="Shen, Molisch 2012, Table II, noise (37)-(40)",
    options=ShenOptions,
    scene=scene,
    generate=generate,
)
