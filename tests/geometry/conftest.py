"""Hypothesis draws the same examples every time, and takes the time that a busy machine needs."""

from __future__ import annotations

from hypothesis import settings

settings.register_profile("steady", derandomize=True, deadline=None)
settings.load_profile("steady")
