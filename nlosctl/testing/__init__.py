"""The laws that every method obeys, for the built-in methods and for the author of a plugin.

``check_method(METHOD)`` in a test of yours is all it takes; to have a test for each law, parametrize over `LAWS` and
call `check_law`.
"""

from __future__ import annotations

from nlosctl.testing.bench import LawBroken
from nlosctl.testing.check import LAWS, MethodLaw, check_law, check_method
from nlosctl.testing.circle_draws import CIRCLES
from nlosctl.testing.draws import DRAWS, Draw, Trial

__all__ = ["CIRCLES", "DRAWS", "LAWS", "Draw", "LawBroken", "MethodLaw", "Trial", "check_law", "check_method"]
