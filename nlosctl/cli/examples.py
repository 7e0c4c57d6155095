"""What every command's help ends with: two examples or more, which the tests run."""

from __future__ import annotations

from typing import Any

from typer.core import TyperCommand

__all__ = ["EXAMPLES", "CommandWithUsage", "epilog_of"]

EXAMPLES = {
    "localize": (
        "nlosctl localize bearings.csv -o fixes.csv",
        "nlosctl localize bearings.csv -m ml -m mixture-ml -o fixes.parquet",
    ),
    "bound": (
        "nlosctl bound bearings.csv -o bound.csv",
        "nlosctl bound bearings.csv --noise laplace -o laplace.parquet",
    ),
    "posterior": (
        "nlosctl posterior bearings.csv --snapshot 7 -o map.csv",
        "nlosctl posterior bearings.csv --all -m mixture-ml -o maps.parquet",
    ),
    "calibrate": (
        "nlosctl calibrate bearings.csv -o calibration.toml",
        "nlosctl calibrate -m mixture-ml bearings.csv -o robust.toml",
        "nlosctl calibrate turn.csv --harmonics 2 --window all -o array.toml",
    ),
    "track": (
        "nlosctl track timed.csv -p acceleration_psd=0.1 -o path.csv",
        "nlosctl track timed.csv --estimate-acceleration --causal -o filter.csv",
    ),
    "detect-ip": (
        "nlosctl detect-ip paths.csv -o paths_flags.csv",
        "nlosctl detect-ip paths.csv -m joint -o joint.csv --estimates-out targets.csv",
    ),
    "identify-los": (
        "nlosctl identify-los echoes.csv -o echo_flags.csv --estimates-out found.csv",
        "nlosctl identify-los -m tca -p targets=2 echoes.csv -o tca.csv",
    ),
    "simulate": (
        "nlosctl simulate ring -n 20 -p sensors=6 -p bearing_std_deg=2 -o bearings.csv",
        "nlosctl simulate ring --sweep sensors=4,8 | nlosctl localize - -o s.csv",
    ),
    "evaluate": (
        "nlosctl evaluate fixes.parquet --fail-if 'ml:coverage_95<0.5'",
        "nlosctl evaluate fixes.parquet -o scores.csv",
        "nlosctl evaluate flags.parquet --by sensor",
    ),
    "plot": (
        "nlosctl plot bearings.csv fixes.parquet --snapshot 7 -o snapshot.svg",
        "nlosctl plot fixes.parquet --view cdf -o errors.pdf",
        "nlosctl evaluate s.csv | nlosctl plot - -o scores.svg",
    ),
    "report": (
        "nlosctl report flags.parquet fixes.parquet -o report.html",
        "nlosctl evaluate s.csv | nlosctl report - fixes.parquet -o drive.html",
    ),
    "reproduce": (
        "nlosctl reproduce song-fig8 --quick -o figures/",
        "nlosctl reproduce song-fig9 --quick -p bearing_std_deg=1,2 -o figures/",
    ),
    "convert": (
        "nlosctl convert drive.csv --from kraken-csv -o drive.parquet",
        "nlosctl convert bearings.csv -o bearings.parquet",
    ),
    "validate": (
        "nlosctl validate bearings.csv",
        "nlosctl validate angles.csv --column bearing_deg=Angle --bearing-std-deg 2",
    ),
    "describe": ("nlosctl describe bearings.csv", "nlosctl describe drive.csv --json"),
    "schema": ("nlosctl schema bearings", "nlosctl schema scene --json"),
    "methods": ("nlosctl methods", "nlosctl methods --check --json"),
    "methods show": ("nlosctl methods show mixture-ml", "nlosctl methods show bearings.ml --json"),
    "config show": ("nlosctl config show", "nlosctl config show localize -- -m ls --seed 3"),
}
"""The examples of each command, by its name."""


def epilog_of(name: str, *before: str) -> str | None:
    """Return the end of a command's help: the paragraphs ``before`` and its examples; None without any."""
    examples = EXAMPLES.get(name)
    return "\n\n".join([*before, *(["\n".join(["Examples:", *examples])] if examples else [])]) or None


class CommandWithUsage(TyperCommand):
    """A command whose usage line has its arguments as ``INPUT...``, in brackets if they may be left out."""

    def collect_usage_pieces(self, ctx: Any) -> list[str]:
        """Return the parts of the usage line after the command's name."""
        pieces = ["[OPTIONS]"]
        for parameter in self.params:
            if parameter.param_type_name == "argument":
                name = f"{parameter.metavar or str(parameter.name).upper()}{'...' if parameter.nargs != 1 else ''}"
                pieces.append(name if parameter.required else f"[{name}]")
        return pieces
