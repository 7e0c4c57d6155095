"""Localize radio, acoustic and radar sources from measurements when some paths are not line of sight.

The functions take tables (pyarrow, polars, pandas, dict) or paths, and return pyarrow tables. `localize`,
`identify_los`, `detect_ip` and `bound` solve measurements, `track` finds paths, `posterior` maps where a source is,
`calibrate` finds the offsets of sensors; `read`, `describe`, `validate`, `convert` and `simulate` make and check them;
`evaluate`, `plot` and `report` show how good estimates are. They are the commands of ``nlosctl``, with the same
options and results; see docs/python.md.
"""

from __future__ import annotations

from nlosctl.version import __version__

TYPE_CHECKING = False  # instead of importing typing: an interrupt during that import would print a traceback
if TYPE_CHECKING:
    from typing import Any

    from nlosctl.api import (
        Detection,
        Evaluation,
        Localization,
        Plot,
        Report,
        SensorCalibration,
        Tracks,
        bound,
        calibrate,
        convert,
        describe,
        detect_ip,
        evaluate,
        identify_los,
        localize,
        plot,
        posterior,
        read,
        report,
        simulate,
        track,
        validate,
    )

__all__ = [
    "Detection",
    "Evaluation",
    "Localization",
    "Plot",
    "Report",
    "SensorCalibration",
    "Tracks",
    "__version__",
    "bound",
    "calibrate",
    "convert",
    "describe",
    "detect_ip",
    "evaluate",
    "identify_los",
    "localize",
    "plot",
    "posterior",
    "read",
    "report",
    "simulate",
    "track",
    "validate",
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
