"""Shen, Molisch 2012, Figure 5: P_d over P_f in scenario 2, a target at (5.2, 10), the reflector anywhere."""

from __future__ import annotations

from nlosctl.reproduce.shen.roc import roc_experiment

__all__ = ["EXPERIMENT"]

EXPERIMENT = roc_experiment(
    figure=5,
    scenario=2,
    detection_note="",
    alarm_note="",
)
