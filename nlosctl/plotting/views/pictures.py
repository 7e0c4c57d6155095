"""Choice of the view for some files, and its picture."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from textwrap import fill

from nlosctl.errors import UsageError, did_you_mean
from nlosctl.io.results.plot_inputs import PlotInput
from nlosctl.plotting.catalogue import VIEWS
from nlosctl.plotting.plot_request import Picture, PlotRequest
from nlosctl.plotting.suitable_views import suitable_views
from nlosctl.plotting.texts import plain
from nlosctl.plotting.views.bound import draw_bound_map
from nlosctl.plotting.views.calibration import draw_calibration_view
from nlosctl.plotting.views.detection import draw_detection_view
from nlosctl.plotting.views.echoes import draw_echo_view
from nlosctl.plotting.views.errors import draw_error_cdf, draw_sweep
from nlosctl.plotting.views.estimates import draw_estimates_view
from nlosctl.plotting.views.posterior import draw_posterior_map
from nlosctl.plotting.views.space import draw_scene_view
from nlosctl.plotting.views.tracks import draw_tracks_view
from nlosctl.plotting.views.triplets import draw_triplet_view

__all__ = ["choose_view", "draw_picture"]

_CHARACTERS_PER_IN = 15
_LONGEST_NOTE = 400

_DRAW: dict[str, Callable[[PlotRequest], Picture]] = {
    "scene": draw_scene_view,
    "estimates": draw_estimates_view,
    "tracks": draw_tracks_view,
    "cdf": draw_error_cdf,
    "sweep": draw_sweep,
    "roc": draw_detection_view,
    "map": draw_bound_map,
    "posterior": draw_posterior_map,
    "echoes": draw_echo_view,
    "triplets": draw_triplet_view,
    "calibration": draw_calibration_view,
}


def choose_view(files: Sequence[PlotInput], wanted: str | None, *, one_snapshot: bool = False) -> str:
    """Return the ``wanted`` view, or the first that suits the files; raise UsageError if it does not suit them."""
    suitable = suitable_views(files, one_snapshot=one_snapshot)
    if wanted is None:
        if not suitable:
            contents = ", ".join(f"{file.name} ({file.content})" for file in files)
            raise UsageError(f"no view suits {contents} together; 'nlosctl plot --views' lists what each view takes")
        return suitable[0]
    if wanted not in VIEWS:
        raise UsageError(f"no view {wanted!r}{did_you_mean(wanted, VIEWS)}; there are: {', '.join(VIEWS)}")
    if wanted not in suitable:
        contents = ", ".join(f"{file.name} has {file.content}" for file in files)
        cure = f"; suitable views: {', '.join(suitable)}" if suitable else ""
        raise UsageError(f"`view` {wanted} takes {VIEWS[wanted].takes}; {contents}{cure}")
    return wanted


def draw_picture(request: PlotRequest, view: str, *, wording: Callable[[str], str] = str) -> Picture:
    """Return the picture of a view with its notes below; raise DataError for faults of the files.

    ``wording`` converts the notes, which name settings in backquotes.
    """
    picture = _DRAW[view](request)
    notes = [wording(note) for note in picture.notes]
    if notes:
        width = int(_CHARACTERS_PER_IN * picture.figure.get_figwidth())
        picture.figure.supxlabel(
            "\n".join(fill(plain(note, _LONGEST_NOTE), width) for note in notes), fontsize=7, color="#505050"
        )
    return Picture(figure=picture.figure, notes=[*notes, *map(wording, _without_effect(request, view))])


def _without_effect(request: PlotRequest, view: str) -> list[str]:
    """Return a line for each setting that was given and does not change the view."""
    given = {
        "snapshot": request.snapshot is not None,
        "path": bool(request.paths),
        "x": request.x is not None,
        "y": request.y is not None,
        "by": request.by is not None,
        "target_z_m": request.target_z_m is not None,
        "linear": request.linear,
    }
    uses = VIEWS[view].uses
    return [
        f"`{name}` has no effect on the view {view}"
        for name, is_given in given.items()
        if is_given and name not in uses
    ]
