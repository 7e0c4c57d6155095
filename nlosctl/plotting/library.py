"""What we use of matplotlib, imported in this one place so that its absence is told with the cure.

No pyplot: figures are objects, and nothing opens a window.
"""

from __future__ import annotations

from nlosctl.errors import MissingExtraError

try:
    from matplotlib import colormaps, style
    from matplotlib.axes import Axes
    from matplotlib.cm import ScalarMappable
    from matplotlib.collections import LineCollection, PatchCollection
    from matplotlib.colors import BoundaryNorm, Colormap, ListedColormap, LogNorm, Normalize
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D
    from matplotlib.patches import Circle, Ellipse, Patch, Polygon, Wedge
    from matplotlib.ticker import MaxNLocator
except ModuleNotFoundError as error:
    if error.name is None or error.name.partition(".")[0] != "matplotlib":
        raise
    raise MissingExtraError("drawing", "matplotlib", "plot") from error

__all__ = [
    "Axes",
    "BoundaryNorm",
    "Circle",
    "Colormap",
    "Ellipse",
    "Figure",
    "Line2D",
    "LineCollection",
    "ListedColormap",
    "LogNorm",
    "MaxNLocator",
    "Normalize",
    "Patch",
    "PatchCollection",
    "Polygon",
    "ScalarMappable",
    "Wedge",
    "colormaps",
    "style",
]
