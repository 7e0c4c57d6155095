"""``nlosctl validate``: check files of measurements."""

from __future__ import annotations

from nlosctl.cli.options.declarations import ConfigFile, Debug, Inputs, Json, Quiet
from nlosctl.cli.options.settings import takes_options, with_flags
from nlosctl.cli.terminal import Terminal, print_json, print_table
from nlosctl.contract.run_options import InputOptions, OutputOptions

__all__ = ["validate"]


@takes_options()
def validate(
    inputs: Inputs,
    read: InputOptions,
    write: OutputOptions,
    *,
    config: ConfigFile = None,
    json: Json = False,
    quiet: Quiet = False,
    debug: Debug = False,
) -> int:
    """Check files of measurements: columns, values, scene, order of snapshots. Exit 1 if there is a fault."""
    from nlosctl.jobs.validate import validate as check

    result = check(inputs, read, write, protected=[config], console=Terminal(quiet))
    result["remarks"] = list(map(with_flags, result["remarks"]))
    if json:
        print_json(result)
    else:
        rows = [{"what": key.replace("_", " "), "value": _shown(value)} for key, value in result.items()]
        print_table(rows, ["what", "value"])
    return 1 if result["bad_rows"] else 0


def _shown(value: object) -> str:
    return ", ".join(map(str, value)) if isinstance(value, list) else str(value)
