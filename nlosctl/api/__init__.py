"""The jobs of the command line as functions on tables and files: what ``import nlosctl`` provides."""

from nlosctl.api.calibrating import SensorCalibration, calibrate
from nlosctl.api.files import Plot, convert, describe, evaluate, plot, read, simulate, validate
from nlosctl.api.mapping import posterior
from nlosctl.api.reporting import Report, report
from nlosctl.api.solving import Detection, Localization, bound, detect_ip, identify_los, localize
from nlosctl.api.tracking import Tracks, track
from nlosctl.pipeline.evaluate.groups import Evaluation

__all__ = [
    "Detection",
    "Evaluation",
    "Localization",
    "Plot",
    "Report",
    "SensorCalibration",
    "Tracks",
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
