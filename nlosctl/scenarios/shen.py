"""The five scenarios of Shen, Molisch 2012, Table II: one transmitter and receiver, a target, one or two reflectors."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray
from nlosctl.contract.options import option
from nlosctl.contract.scene import Scene
from nlosctl.models.object_paths import signal_to_noise, trace_over_objects, triplet_standard_deviations
from nlosctl.scenarios.spec import Columns, ScenarioSpec
from nlosctl.scenarios.triplet_rows import triplet_columns

__all__ = ["SCENARIO", "ShenOptions", "generate", "scene"]

_TX, _RX = np.array([[-2.5, 0.0]]), np.array([[2.5, 0.0]])
_REGION_M = (-8.0, 8.0, 0.0, 10.0)


@dataclass(frozen=True, kw_only=True)
class _Row:
    """A row of Table II; without a position: uniform over the region."""

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

    number: int = option(3, minimum=1, maximum=5, meaning="scenario 1 to 5 of Table II; 5 is 3 at other powers")
    power_dbm: float | None = option(None, unit="dBm", meaning="transmitted power; default: that of the scenario")
    reflectors: int = option(0, minimum=0, maximum=2, meaning="reflectors of an indirect path; 0: as in the scenario")
    indirect_fraction: float = option(0.5, minimum=0.0, maximum=1.0, meaning="share of indirect paths")
    target_m: tuple[float, float] | None = option(
        None, unit="m", meaning="x,y of the target; default: as in the scenario"
    )
    region_m: tuple[float, float, float, float] | None = option(
        None, unit="m", meaning="xmin,xmax,ymin,ymax of targets and reflectors; default: -8,8,0,10"
    )
    fold_angles: bool = option(
        False, meaning="report angles modulo pi, as the paper's simulator did: lines instead of rays"
    )


def scene(options: ShenOptions) -> Scene:
    """Return an empty scene: every row holds the transmitter, (-2.5, 0), and the receiver, (2.5, 0)."""
    return Scene()


def generate(options: ShenOptions, generator: np.random.Generator, snapshots: int) -> Columns:
    """Sample snapshots of one path each; the targets of direct and indirect paths have the same distribution.

    The order of target and reflectors along a path is random, except in scenario 1, where the reflector comes first.
    """
    row = _TABLE_II[options.number]
    region = options.region_m or _REGION_M
    target = _positions(generator, snapshots, options.target_m or row.target_m, region)
    count = options.reflectors or row.reflectors
    reflectors = np.stack([_positions(generator, snapshots, row.reflector_m, region) for _ in range(count)], axis=1)
    target_index = generator.integers(0, count + 1, snapshots)
    if row.reflector_m is not None:
        target_index = np.full(snapshots, count)
    indirect = generator.random(snapshots) < options.indirect_fraction
    power_dbm = row.power_dbm if options.power_dbm is None else options.power_dbm
    triplet, stds = _measure(target, reflectors, target_index, indirect, power_dbm)
    columns = triplet_columns(
        generator=generator,
        snapshot=np.arange(snapshots, dtype=np.int64),
        path=np.zeros(snapshots, dtype=np.int64),
        tx_m=np.broadcast_to(_TX, (snapshots, 2)),
        rx_m=np.broadcast_to(_RX, (snapshots, 2)),
        triplet=triplet,
        stds=stds,
        truth_ip=indirect,
        target_m=target,
    )
    if not options.fold_angles:
        return columns
    return {**columns, **{name: np.mod(columns[name], np.pi) for name in ("dod_rad", "doa_rad")}}


Triplet = tuple[FloatArray, FloatArray, FloatArray]


def _measure(
    target: FloatArray, reflectors: FloatArray, target_index: IntArray, indirect: BoolArray, power_dbm: float
) -> tuple[Triplet, Triplet]:
    """Return noise-free DOD, DOA, path length, and their standard deviations.

    ``target_index`` (B,) is the target's index among the objects along an indirect path.
    """
    direct = trace_over_objects(_TX, _RX, target[:, None])
    count = reflectors.shape[1]
    objects = np.empty((target.shape[0], count + 1, 2))
    for slot in range(count + 1):
        before, after = reflectors[:, min(slot, count - 1)], reflectors[:, max(slot - 1, 0)]
        objects[:, slot] = np.where((target_index > slot)[:, None], before, after)
    objects[np.arange(target.shape[0]), target_index] = target
    detour = trace_over_objects(_TX, _RX, objects)
    snr = np.where(indirect, signal_to_noise(power_dbm, detour.legs_m), signal_to_noise(power_dbm, direct.legs_m))
    dod = np.where(indirect, detour.dod_rad, direct.dod_rad)
    doa = np.where(indirect, detour.doa_rad, direct.doa_rad)
    length = np.where(indirect, detour.path_length_m, direct.path_length_m)
    return (dod, doa, length), triplet_standard_deviations(snr, np.sin(dod), np.sin(doa))


def _positions(
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
    summary="the five scenarios of Shen, Molisch: a target, one or two point reflectors, one path per snapshot",
    reference="Shen, Molisch 2012, Table II, noise (37)-(40)",
    options=ShenOptions,
    scene=scene,
    generate=generate,
)
