"""Which methods a run uses, with which parameters: from the words of the command line or Python values."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

from nlosctl import registry
from nlosctl.contract.methods import Job, MethodSpec
from nlosctl.contract.options import parse_options
from nlosctl.errors import UsageError, did_you_mean
from nlosctl.pipeline.solve.solve_chunk import MethodRun
from nlosctl.pipeline.solve.sweeps import SweepWords, swept_options

__all__ = ["method_runs", "require_estimates"]


def method_runs(
    names: Sequence[str], kind: str, job: Job, parameters: Mapping[str, Any], sweep: SweepWords | None = None
) -> list[MethodRun]:
    """Return the methods ``names`` for a kind of measurement, with their options: a run for each point of a sweep.

    A parameter is given, or swept, as ``key`` (for every method that has it) or ``METHOD:key``; a method that has none
    of the swept ones runs once. Raises UsageError for an unknown method, a method named twice, a parameter that none
    of them has, or a value that does not fit.
    """
    specs = [registry.resolve(name, kind, job) for name in names]
    own = [spec.name for spec in specs]
    for name in own:
        if own.count(name) > 1:
            raise UsageError(f"method {name!r} is given twice")
    given = _by_method(specs, parameters, "--param")
    swept = _by_method(specs, sweep or {}, "--sweep")
    return [
        MethodRun(spec=spec, options=options, sweep=values)
        for spec in specs
        for values, options in swept_options(
            swept[spec.name],
            given[spec.name],
            partial(parse_options, spec.options, owner=f"method {spec.name!r}"),
        )
    ]


def require_estimates(runs: Sequence[MethodRun]) -> None:
    """Raise UsageError where none of the methods makes estimates."""
    if not any(run.spec.estimates for run in runs):
        names = ", ".join(run.spec.name for run in runs)
        raise UsageError(f"--estimates-out: {names} makes no estimates; chi2 and joint do")


def _by_method(specs: Sequence[MethodSpec], parameters: Mapping[str, Any], option: str) -> dict[str, dict[str, Any]]:
    keys = {spec.name: {field.name for field in dataclasses.fields(spec.options)} for spec in specs}
    given: dict[str, dict[str, Any]] = {spec.name: {} for spec in specs}
    for word, value in parameters.items():
        method, colon, key = word.rpartition(":")
        if colon and method not in keys:
            raise UsageError(f"{option} {word}: no method {method!r} in this run{did_you_mean(method, keys)}")
        owners = [method] if colon else [name for name in keys if key in keys[name]]
        if not owners and len(specs) > 1:
            known = sorted(set().union(*keys.values()))
            raise UsageError(f"none of the methods has a parameter {key!r}{did_you_mean(key, known)}")
        for name in owners or keys:
            given[name] = {**given[name], key: value} if colon else {key: value, **given[name]}
    return given
