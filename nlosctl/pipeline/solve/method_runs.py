"""The methods of a run with their parameters, from text or Python values; a run for each point of a sweep."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

from nlosctl import registry
from nlosctl.contract.methods import Job, MethodSpec
from nlosctl.contract.options import parse_options
from nlosctl.errors import UsageError, did_you_mean
from nlosctl.pipeline.solve.sweeps import SweepWords, swept_options

__all__ = ["MethodRun", "method_runs", "require_estimates"]


@dataclass(frozen=True, kw_only=True)
class MethodRun:
    """A method with the options of this run; ``sweep`` holds the swept options with their values."""

    spec: MethodSpec
    options: Any
    sweep: Mapping[str, Any] = dataclasses.field(default_factory=dict)

    @property
    def label(self) -> str:
        """The name of the method, with the swept values."""
        values = ", ".join(f"{key}={value}" for key, value in self.sweep.items())
        return f"{self.spec.name} ({values})" if values else self.spec.name


def method_runs(
    names: Sequence[str], kind: str, job: Job, parameters: Mapping[str, Any], sweep: SweepWords | None = None
) -> list[MethodRun]:
    """Return the methods ``names`` of a kind of measurement with their options: one run for each point of the sweep.

    Parameters and swept parameters are named ``key`` (for every method that has it) or ``METHOD:key``; a method without
    a swept parameter runs once. Raises UsageError for an unknown method, a duplicate method, a parameter that no
    method has, or an invalid value.
    """
    specs = [registry.resolve(name, kind, job) for name in names]
    own = [spec.name for spec in specs]
    for name in own:
        if own.count(name) > 1:
            raise UsageError(f"method {name!r} is given twice")
    given = _by_method(specs, parameters, "`parameters`")
    swept = _by_method(specs, sweep or {}, "`sweep`")
    runs = []
    for spec in specs:
        parse = partial(parse_options, spec.options, owner=f"method {spec.name!r}")
        if swept[spec.name]:
            points = swept_options(swept[spec.name], given[spec.name], parse)
            runs += [MethodRun(spec=spec, options=options, sweep=values) for values, options in points]
        else:
            runs.append(MethodRun(spec=spec, options=parse(given[spec.name])))
    return runs


def require_estimates(runs: Sequence[MethodRun]) -> None:
    """Raise UsageError if no method makes estimates."""
    if not any(run.spec.estimates for run in runs):
        names = ", ".join(run.spec.name for run in runs)
        raise UsageError(f"`estimates_out`: {names} makes no estimates; chi2 and joint do")


def _by_method(specs: Sequence[MethodSpec], parameters: Mapping[str, Any], option: str) -> dict[str, dict[str, Any]]:
    keys = {spec.name: {field.name for field in dataclasses.fields(spec.options)} for spec in specs}
    given: dict[str, dict[str, Any]] = {spec.name: {} for spec in specs}
    for parameter, value in parameters.items():
        method, colon, key = parameter.rpartition(":")
        if colon and method not in keys:
            raise UsageError(f"{option} {parameter}: no method {method!r} in this run{did_you_mean(method, keys)}")
        owners = [method] if colon else [name for name in keys if key in keys[name]]
        if not owners and len(specs) > 1:
            known = sorted(set().union(*keys.values()))
            raise UsageError(f"none of the methods has a parameter {key!r}{did_you_mean(key, known)}")
        for name in owners or keys:
            given[name] = {**given[name], key: value} if colon else {key: value, **given[name]}
    return given
