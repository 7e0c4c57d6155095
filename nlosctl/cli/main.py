"""The program: its commands, and how each error is reported."""

from __future__ import annotations

import functools
import inspect
import io
import os
import re
import signal
import sys
from collections.abc import Callable, Sequence
from types import FrameType
from typing import Annotated, Any, NoReturn

import typer

from nlosctl.cli.commands.bound import bound
from nlosctl.cli.commands.calibrate import calibrate
from nlosctl.cli.commands.config import config_app
from nlosctl.cli.commands.convert import convert
from nlosctl.cli.commands.describe import describe
from nlosctl.cli.commands.evaluate import evaluate
from nlosctl.cli.commands.methods import methods_app
from nlosctl.cli.commands.plot import VIEWS_TEXT, plot
from nlosctl.cli.commands.posterior import posterior
from nlosctl.cli.commands.report import report
from nlosctl.cli.commands.reproduce import reproduce
from nlosctl.cli.commands.schema import schema
from nlosctl.cli.commands.simulate import simulate
from nlosctl.cli.commands.solve import detect_ip, identify_los, localize
from nlosctl.cli.commands.track import track
from nlosctl.cli.commands.validate import validate
from nlosctl.cli.examples import epilog_of
from nlosctl.cli.options.settings import SettingsCommand
from nlosctl.cli.terminal import ClosedOutput, discard, print_message
from nlosctl.contract.limits import limit, limit_variable
from nlosctl.errors import GatheredError, NlosctlError, UsageError, in_one_line, printable
from nlosctl.version import __version__

__all__ = ["app", "run"]

_EXIT_CODES = (
    "Exit codes: 0 done (a summary counts the statuses); 1 bad data, or a file that is missing, exists already or "
    "cannot be written; 2 usage error; 3 with --strict, if a snapshot has no estimate; 4 a condition of --fail-if is "
    "met; 130 interrupted."
)

_PARSER: Any = sys.modules[typer.BadParameter.__module__]
"""The module of the parser's exceptions: click, or the copy of it that typer contains."""

_INTERRUPTED = 130
_REPEAT_AFTER_S = 0.01
_LEAST_MEMORY_MB = 512
"""With less than three quarters of this, OpenBLAS retries its allocation forever while it is loaded."""


class _PipeClosedError(Exception):
    """The reader of our output has closed the pipe: not an error, and nothing is printed."""


class _StoppedError(Exception):
    """An interrupt by the user or the system; ``exit_code`` is 128 plus the number of the signal."""

    def __init__(self, exit_code: int) -> None:
        super().__init__("interrupted; no partial output remains")
        self.exit_code = exit_code


class _Terminated(KeyboardInterrupt):
    """SIGTERM, SIGHUP or SIGXCPU: unwinds like Ctrl-C, so that temporary files are removed."""

    def __init__(self, number: int) -> None:
        super().__init__()
        self.number = number


class _Command(SettingsCommand):
    """A command that notes the variables NLOSCTL_... that set nothing, unless it is quiet."""

    def invoke(self, ctx: Any) -> Any:
        """Print the notes, and run the command."""
        if not ctx.params.get("quiet") and any(name.startswith("NLOSCTL_") for name in os.environ):
            from nlosctl.cli.options.config_file import unknown_variables

            for line in unknown_variables(ctx.find_root().command.commands):
                print_message(line)
        return super().invoke(ctx)


app = typer.Typer(
    name="nlosctl",
    help="Localize radio, acoustic and radar sources from files of measurements when some paths are not line of "
    "sight, and identify those paths.",
    epilog=_EXIT_CODES,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _guarded(command: Callable[..., Any]) -> Callable[..., Any]:
    """Convert interrupts and closed pipes before the parser handles them, which would exit in another way."""

    @functools.wraps(command)
    def call(*arguments: Any, **options: Any) -> Any:
        try:
            return command(*arguments, **options)
        except BrokenPipeError as error:
            _discard_stdout()
            raise _PipeClosedError from error
        except (KeyboardInterrupt, RuntimeError) as error:
            stop = (
                error.__cause__ if isinstance(error, RuntimeError) else error
            )  # Python 3.11 wraps one in a class body
            if not isinstance(stop, KeyboardInterrupt):
                raise
            raise _StoppedError(128 + stop.number if isinstance(stop, _Terminated) else _INTERRUPTED) from error

    return call


_COMMANDS = (
    ("localize", localize),
    ("bound", bound),
    ("posterior", posterior),
    ("calibrate", calibrate),
    ("track", track),
    ("detect-ip", detect_ip),
    ("identify-los", identify_los),
    ("simulate", simulate),
    ("evaluate", evaluate),
    ("plot", plot),
    ("report", report),
    ("reproduce", reproduce),
    ("convert", convert),
    ("describe", describe),
    ("validate", validate),
    ("schema", schema),
)
for _name, _command in _COMMANDS:
    _epilog = epilog_of(_name, *([VIEWS_TEXT] if _command is plot else []))
    _help = re.sub(r"(?<!\n)\n(?!\n)", " ", inspect.cleandoc(_command.__doc__ or ""))  # paragraphs fill the terminal
    app.command(_name, cls=_Command, epilog=_epilog, help=_help)(_guarded(_command))
app.add_typer(methods_app, name="methods")
app.add_typer(config_app, name="config")


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"nlosctl {__version__}")
        raise typer.Exit


@app.callback()
def _program(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version and exit.")
    ] = False,
) -> None:
    pass


def run(arguments: Sequence[str] | None = None) -> int:
    """Run the program with ``arguments`` (default: those of the process) and return its exit code."""
    argv = list(sys.argv[1:] if arguments is None else arguments)
    came: list[int] = []
    if arguments is None:
        _unwind_on_signals(came)
    if sys.stdout is None:
        sys.stdout = ClosedOutput()
    elif arguments is None and isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")  # for text that the encoding lacks; data are bytes
    try:
        _limit_memory()
        outcome = app(argv, standalone_mode=False, prog_name="nlosctl")
        if outcome == _INTERRUPTED:  # the parser caught an interrupt of any signal
            raise _StoppedError(128 + came[0] if came else _INTERRUPTED)
        sys.stdout.flush()
    except (_PipeClosedError, BrokenPipeError):
        _discard_stdout()
        return 0
    except Exception as error:
        if "--debug" in argv or os.environ.get("NLOSCTL_DEBUG"):
            raise
        return _fail(error)
    return outcome if isinstance(outcome, int) else 0


def _fail(error: Exception) -> int:
    """Print an error in one line (or the few lines of a gathered list) and return its exit code."""
    code = 1
    if isinstance(error, GatheredError):
        message = str(error)
    elif isinstance(error, NlosctlError | _StoppedError):
        message, code = printable(str(error)), error.exit_code
    elif isinstance(error, MemoryError):
        message = "not enough memory (if NLOSCTL_MAX_MEMORY_MB is set, it is the limit)"
    elif isinstance(error, _PARSER.NoArgsIsHelpError):  # its message is the help, which is printed already if in colour
        print_message(str(error).rstrip("\n"))
        return 2
    elif isinstance(error, _PARSER.ClickException):  # the parser's own usage errors
        message, code = f"{_with_value(' '.join(error.format_message().split()), error)}{_help_hint(error)}", 2
    elif isinstance(error, ImportError):
        message = f"a library cannot be loaded, perhaps for lack of memory: {in_one_line(error)[:300]}"
    elif isinstance(error, OSError) and error.strerror:
        message = f"{error.filename or 'the output'}: {error.strerror}"
    else:
        message = f"internal error: {in_one_line(error)} (run again with --debug for the traceback)"
    print_message(f"nlosctl: {message}")
    if isinstance(error, OSError):
        _discard_stdout()
    return code


def _with_value(message: str, error: Exception) -> str:
    """Return the message of a parser's error with the value that it could not convert, if it does not contain that."""
    details = getattr(error.__cause__, "errors", None)
    values = [repr(detail["input"]) for detail in details() if "input" in detail] if callable(details) else []
    return f"{message.rstrip('.')}; got {values[0]}" if values and values[0] not in message else message


def _help_hint(error: Exception) -> str:
    context = getattr(error, "ctx", None)
    return f" (see '{context.command_path} --help')" if context is not None else ""


def _discard_stdout() -> None:
    discard(sys.stdout)


def _limit_memory() -> None:
    """Limit the memory of the process to ``memory_mb``, if that is set."""
    most = limit("memory_mb")
    if 0 < most < _LEAST_MEMORY_MB:
        raise UsageError(
            f"{limit_variable('memory_mb')} must be 0 (no limit) or at least {_LEAST_MEMORY_MB}: the libraries "
            f"alone need most of that. Got {most} instead."
        )
    if most:
        import resource

        resource.setrlimit(resource.RLIMIT_DATA, (most << 20, resource.getrlimit(resource.RLIMIT_DATA)[1]))


def _unwind_on_signals(came: list[int]) -> None:
    """Let SIGTERM, SIGHUP (except under ``nohup``) and SIGXCPU unwind the run; append their numbers to ``came``."""

    def stop(number: int, frame: FrameType | None) -> NoReturn:
        came.append(number)
        raise _Terminated(number)

    for name in ("SIGTERM", "SIGHUP", "SIGXCPU"):
        number = getattr(signal, name, None)
        if number is not None and signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, stop)
    if hasattr(signal, "setitimer"):
        _repeat_lost_signals()


def _repeat_lost_signals() -> None:
    """Raise an interrupt again if it came in a callback or a ``__del__``: Python drops exceptions raised there."""
    lost: list[BaseException] = []
    report_others = sys.unraisablehook

    def note(dropped: sys.UnraisableHookArgs) -> None:
        if isinstance(dropped.exc_value, KeyboardInterrupt):
            lost.append(dropped.exc_value.with_traceback(None))
            signal.setitimer(signal.ITIMER_REAL, _REPEAT_AFTER_S)
        else:
            report_others(dropped)

    def repeat(number: int, frame: FrameType | None) -> NoReturn:
        raise lost[-1]

    signal.signal(signal.SIGALRM, repeat)
    sys.unraisablehook = note
