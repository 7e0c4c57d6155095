"""Shen, Molisch 2012, Figure 6: P_d over P_f in scenario 3, target and reflector anywhere."""

from __future__ import annotations

from nlosctl.reproduce.shen.roc import roc_experiment

__all__ = ["EXPERIMENT"]

EXPERIMENT = roc_experiment(
    figure=6,
    scenario=3,
    detection_note="",
    alarm_note="One in a hundred direct paths has lines that meet behind a node, by noise, and is called indirect.",
)
