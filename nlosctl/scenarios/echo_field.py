"""Sensors, targets and scatterers anywhere in a rectangle, with unlabelled echoes: irregular layouts."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Literal

import numpy as np

from nlosctl.arrays import FloatArray
from nlosctl.contract.options import option
from nlosctl.contract.scene import Scene, Sensor
from nlosctl.scenarios.bearing_rows import sensor_names
from nlosctl.scenarios.echo_rows import EchoOptions, echo_columns
from nlosctl.scenarios.spec import Columns, ScenarioSpec

__all__ = ["SCENARIO", "EchoFieldOptions", "generate", "scene"]


@dataclass(frozen=True, kw_only=True)
class EchoFieldOptions(EchoOptions):
    """Parameters of ``echo-field``."""

    sensors: int = option(5, minimum=1, maximum=10_000, meaning="sensors")
    width_m: float = option(1000.0, unit="m", minimum=0.0, exclusive=True, meaning="extent of the field in x, from 0")
    height_m: float = option(600.0, unit="m", minimum=0.0, exclusive=True, meaning="extent of the field in y, from 0")
    layout: Literal["fresh", "fixed"] = option(
        "fresh", meaning="fresh: new sensors and scatterers in each snapshot; fixed: drawn once, from layout_seed"
    )
    layout_seed: int = option(0, minimum=0, meaning="seed of fixed sensors and scatterers")


def scene(options: EchoFieldOptions) -> Scene:
    """Return the sensors of a fixed layout, otherwise an empty scene."""
    if options.layout == "fresh":
        return Scene()
    sensors, _ = _layout(options, np.random.default_rng(options.layout_seed), 1)
    names = sensor_names(options.sensors)
    return Scene(
        sensors=tuple(
            Sensor(name=name, position=(float(x), float(y))) for name, (x, y) in zip(names, sensors[0], strict=True)
        )
    )


def generate(options: EchoFieldOptions, generator: np.random.Generator, snapshots: int) -> Columns:
    """Sample snapshots, each with its own targets, all uniform over the field."""
    if options.layout == "fresh":
        sensors, scatterers = _layout(options, generator, snapshots)
    else:
        fixed = _layout(options, np.random.default_rng(options.layout_seed), 1)
        sensors, scatterers = (np.broadcast_to(part, (snapshots, *part.shape[1:])) for part in fixed)
    return echo_columns(
        options=options,
        generator=generator,
        sensor_xy_m=sensors,
        draw_targets=partial(_uniform, options, generator),
        scatterer_xy_m=scatterers,
    )


def _layout(options: EchoFieldOptions, generator: np.random.Generator, snapshots: int) -> tuple[FloatArray, FloatArray]:
    sensors = _uniform(options, generator, (snapshots, options.sensors))
    return sensors, _uniform(options, generator, (snapshots, options.scatterers))


def _uniform(options: EchoFieldOptions, generator: np.random.Generator, shape: tuple[int, ...]) -> FloatArray:
    size = np.array([options.width_m, options.height_m])
    points: FloatArray = generator.uniform(0.0, 1.0, (*shape, 2)) * size
    return points


SCENARIO = ScenarioSpec(
    name="echo-field",
    kind="ranges",
    summary="sensors, targets and scatterers anywhere in a rectangle, echoes unlabelled",
    reference="Liang, Zeng, Li, signal model (1), any layout",
    options=EchoFieldOptions,
    scene=scene,
    generate=generate,
)
