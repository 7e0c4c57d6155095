"""Shen, Molisch 2012, Figure 7: P_d over P_f in scenario 4, target and two reflectors anywhere, 25 dBm."""

from __future__ import annotations

from nlosctl.reproduce.shen.roc import roc_experiment

__all__ = ["EXPERIMENT"]

EXPERIMENT = roc_experiment(
    figure=7,
    scenario=4,
    detection_note="Reached by fusion with K = 0 alone; lambda 5 has 0.85, with lines 0.89.",
    alarm_note="",
)
