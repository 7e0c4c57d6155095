"""Localize radio, acoustic and radar sources from measurements when some paths are not line of sight."""

from __future__ import annotations

from nlosctl.version import __version__

TYPE_CHECKING = False  # instead of importing typing: an interrupt during that import would print a traceback
if TYPE_CHECKING:
    from typing import Any

    from nlosctl.api import Detection, Localization, bound, detect_ip, evaluate, identify_los, localize, simulate

__all__ = [
    "Detection",
    "Localization",
    "__version__",
    "bound",
    "detect_ip",
    "evaluate",
    "identify_los",
    "localize",
    "simulate",
]


def __getattr__(name: str) -> Any:
    """Import the functions on first use: the command line must start without numpy and pyarrow."""
    if name in __all__:
        from nlosctl import api

        return getattr(api, name)
    raise AttributeError(f"module 'nlosctl' has no attribute {name!r}")


def __dir__() -> list[str]:
    """Return the public names, imported or not: shells complete them."""
    return sorted({*globals(), *__all__})
