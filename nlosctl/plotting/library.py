"""The parts of matplotlib in use, imported in one module so that its absence is reported with the cure.

Without pyplot: figures are objects, and no window opens.
"""

from __future__ import annotations

import logging

from nlosctl.errors import DataError, MissingExtraError, in_one_line

logging.getLogger("matplotlib").setLevel(logging.ERROR)  # it warns about its cache where the home is not writable

try:
    from matplotlib import colormaps, style
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.collections import LineCollection
    from matplotlib.colors import BoundaryNorm, ListedColormap, LogNorm, Normalize
    from matplotlib.figure import Figure
    from matplotlib.font_manager import FontProperties, findfont, get_font
    from matplotlib.patches import Circle, Ellipse, Patch, Polygon, Rectangle
    from matplotlib.text import Annotation, Text
    from matplotlib.ticker import FixedFormatter, FixedLocator, FuncFormatter, LogLocator, MaxNLocator, NullFormatter
    from matplotlib.transforms import ScaledTranslation
except ModuleNotFoundError as error:
    if error.name is None or error.name.partition(".")[0] != "matplotlib":
        raise
    raise MissingExtraError("drawing", "matplotlib", "plot") from error
except Exception as error:  # an invalid matplotlibrc or MPLBACKEND of the user
    raise DataError(f"matplotlib can't be used as configured: {in_one_line(error)}") from error

__all__ = [
    "Annotation",
    "Artist",
    "Axes",
    "BoundaryNorm",
    "Circle",
    "Ellipse",
    "Figure",
    "FixedFormatter",
    "FixedLocator",
    "FontProperties",
    "FuncFormatter",
    "LineCollection",
    "ListedColormap",
    "LogLocator",
    "LogNorm",
    "MaxNLocator",
    "Normalize",
    "NullFormatter",
    "Patch",
    "Polygon",
    "Rectangle",
    "ScaledTranslation",
    "Text",
    "colormaps",
    "findfont",
    "get_font",
    "style",
]
