"""The program: its commands, and how every error ends."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from typing import Annotated

import typer

from nlosctl.cli.bound import bound
from nlosctl.cli.detect_ip import detect_ip
from nlosctl.cli.evaluate import evaluate
from nlosctl.cli.identify_los import identify_los
from nlosctl.cli.localize import localize
from nlosctl.cli.methods import methods_app
from nlosctl.cli.schema import schema
from nlosctl.cli.simulate import simulate
from nlosctl.cli.validate import validate
from nlosctl.errors import NlosctlError
from nlosctl.version import __version__

__all__ = ["app", "run"]

_EXIT_CODES = """\
Exit codes: 0 done (a summary counts the statuses); 1 bad data, or a file that is absent, exists already or can't be
written; 2 the words of the command line; 3 under --strict, when some snapshot got no estimate; 4 a condition of
evaluate --fail-if is met; 130 interrupted.
"""

app = typer.Typer(
    name="nlosctl",
    help="Localize radio, acoustic and radar sources from files of measurements when some paths are not line of "
    "sight, and say which ones.",
    epilog=_EXIT_CODES,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"auto_envvar_prefix": "NLOSCTL", "help_option_names": ["-h", "--help"]},
)
app.command()(localize)
app.command()(bound)
app.command(name="detect-ip")(detect_ip)
app.command(name="identify-los")(identify_los)
app.command()(simulate)
app.command()(evaluate)
app.command()(validate)
app.command()(schema)
app.add_typer(methods_app, name="methods")


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"nlosctl {__version__}")
        raise typer.Exit


@app.callback()
def _program(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version and stop.")
    ] = False,
) -> None:
    pass


def run(arguments: Sequence[str] | None = None) -> int:
    """Run the program with ``arguments`` (those of the process unless given) and return its exit code."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    debug = "--debug" in words
    try:
        outcome = app(words, standalone_mode=False, prog_name="nlosctl")
    except NlosctlError as error:
        if debug:
            raise
        return _fail(str(error), error.exit_code)
    except (KeyboardInterrupt, typer.Abort):
        return _fail("interrupted; no partial output is left", 130)
    except BrokenPipeError:
        _forget_stdout()
        return 0
    except Exception as error:
        if hasattr(error, "format_message"):  # the parser's own complaint about the command line
            return _fail(f"{error.format_message()}{_help_hint(error)}", 2)
        if debug:
            raise
        return _fail(f"internal error: {type(error).__name__}: {error} (run again with --debug for the traceback)", 1)
    return outcome if isinstance(outcome, int) else 0


def _fail(message: str, code: int) -> int:
    sys.stderr.write(f"nlosctl: {message}\n")
    return code


def _help_hint(error: Exception) -> str:
    context = getattr(error, "ctx", None)
    return f" (see '{context.command_path} --help')" if context is not None else ""


def _forget_stdout() -> None:
    """Leave nothing for the interpreter to flush into the closed pipe at exit."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
