"""Names of the scenarios. Listing them imports neither the scenarios nor NumPy.

A new scenario is a file with a ``SCENARIO`` and one line here.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from importlib import import_module
from typing import TYPE_CHECKING

from nlosctl.errors import UsageError, did_you_mean

if TYPE_CHECKING:
    from nlosctl.scenarios.spec import ScenarioSpec

__all__ = ["find_scenario", "scenario_module", "scenarios"]

_MODULES = {
    "arrivals": "nlosctl.scenarios.arrival_world",
    "bearing-field": "nlosctl.scenarios.bearing_field",
    "bearings": "nlosctl.scenarios.scene_bearings",
    "box": "nlosctl.scenarios.box",
    "echo-field": "nlosctl.scenarios.echo_field",
    "liang": "nlosctl.scenarios.liang",
    "madhow-ring": "nlosctl.scenarios.madhow_ring",
    "madhow-walls": "nlosctl.scenarios.madhow_walls",
    "mixed": "nlosctl.scenarios.mixed_paths",
    "mixed-ranges": "nlosctl.scenarios.mixed_ranges",
    "over-the-horizon": "nlosctl.scenarios.over_the_horizon",
    "random": "nlosctl.scenarios.random_field",
    "ranges": "nlosctl.scenarios.scene_ranges",
    "ring": "nlosctl.scenarios.ring",
    "room": "nlosctl.scenarios.room",
    "shen": "nlosctl.scenarios.shen",
    "ship": "nlosctl.scenarios.ship",
    "single-station": "nlosctl.scenarios.single_station",
    "skywave": "nlosctl.scenarios.skywave",
    "song-circle": "nlosctl.scenarios.song_circle",
    "song-flat": "nlosctl.scenarios.song_flat",
    "space-ring": "nlosctl.scenarios.space_ring",
    "street": "nlosctl.scenarios.street",
    "triplets": "nlosctl.scenarios.scene_triplets",
    "walk": "nlosctl.scenarios.walk",
}


class _Catalogue(Mapping[str, "ScenarioSpec"]):
    """Specs by name, sorted by name; a module is imported when its scenario is looked up."""

    def __getitem__(self, name: str) -> ScenarioSpec:
        spec: ScenarioSpec = import_module(_MODULES[name]).SCENARIO
        return spec

    def __iter__(self) -> Iterator[str]:
        return iter(sorted(_MODULES))

    def __len__(self) -> int:
        return len(_MODULES)

    def __contains__(self, name: object) -> bool:
        return name in _MODULES


def scenarios() -> Mapping[str, ScenarioSpec]:
    """Return all scenarios by name; iterating over the names, or ``in``, imports nothing."""
    return _Catalogue()


def scenario_module(name: str) -> str | None:
    """Return the name of a scenario's module, or None if unknown; imports nothing."""
    return _MODULES.get(name)


def find_scenario(name: str) -> ScenarioSpec:
    """Return the scenario ``name``; raise UsageError with the nearest name if it is unknown."""
    known = scenarios()
    if name not in known:
        raise UsageError(f"no scenario {name!r}{did_you_mean(name, known)}; there are: {', '.join(known)}")
    return known[name]
