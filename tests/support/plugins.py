"""Plugins as a test installs them: an entry point of a distribution in a folder on ``sys.path``."""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from nlosctl.contract.batches import BearingBatch
from nlosctl.contract.methods import CONTRACT_VERSION
from nlosctl.contract.results import Solution
from nlosctl.methods import bearings_ml


def install_plugin(
    folder: Path,
    monkeypatch: pytest.MonkeyPatch,
    name: str,
    target: str,
    *,
    distribution: str = "plugin",
    group: str = "nlosctl.methods",
) -> None:
    """Install entry point ``name = target`` (``module:attribute``) in ``folder`` until the end of the test."""
    info = folder / f"{distribution}-1.0.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {distribution}\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(f"[{group}]\n{name} = {target}\n")
    monkeypatch.syspath_prepend(str(folder))


ActInCall = Callable[[int, Callable[[], Any]], None]
"""Type of the fixture ``acting_method``."""

_calls = multiprocessing.Value("i", 0)
_action: tuple[int, Callable[[], Any]] = (-1, lambda: None)


def act_in_call(number: int, action: Callable[[], Any]) -> None:
    """Let ``action`` be called in the method ``acting`` at its call ``number`` (from 0), in whichever process."""
    global _action
    _action, _calls.value = (number, action), 0


def calls_made() -> int:
    """Return the number of calls of the method ``acting`` since `act_in_call`, in all processes."""
    return int(_calls.value)


def _solve(batch: BearingBatch, options: Any) -> Solution:
    with _calls.get_lock():
        mine, _calls.value = _calls.value, _calls.value + 1
    if mine == _action[0]:
        _action[1]()
    return bearings_ml.solve(batch, options)


ACTING = replace(bearings_ml.METHOD, name="acting", solve=_solve, contract_version=CONTRACT_VERSION)
"""Maximum likelihood, and an action in one of the calls: see `act_in_call`."""
