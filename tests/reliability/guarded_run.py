"""One run of the program in this process with a time limit, and the rules for how it may end."""

from __future__ import annotations

import io
import re
import signal
import sys
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from types import FrameType
from typing import Any, NoReturn

import typer.main

from nlosctl import registry

__all__ = ["Ending", "HangError", "complaints", "message_complaints", "run_guarded"]

LONGEST_LINE = 1200
_LONGEST_WAIT_S = 300.0
MOST_LINES = 22  # twenty gathered problems, the total, and a hint


class HangError(BaseException):
    """The run took longer than allowed."""


@dataclass(frozen=True, kw_only=True)
class Ending:
    """The end of a run: exit code (None: an exception), output, exception or warning."""

    words: Sequence[str]
    code: int | None
    out: bytes
    err: str
    raised: str = ""


def run_guarded(words: Sequence[Any], *, stdin: bytes = b"", seconds: float = 20.0, terminal: bool = False) -> Ending:
    """Run ``nlosctl WORDS...`` in this process; the result records what it raises, HangError too.

    With ``terminal``, ``isatty`` of standard error is true.
    """
    from nlosctl.cli.main import run

    streams = sys.stdin, sys.stdout, sys.stderr
    out, err = io.BytesIO(), _Terminal() if terminal else io.BytesIO()
    sys.stdin = io.TextIOWrapper(io.BytesIO(stdin))
    sys.stdout = io.TextIOWrapper(out, write_through=True)
    sys.stderr = io.TextIOWrapper(err, encoding="utf-8", errors="backslashreplace", write_through=True)
    code, raised = None, ""
    try:
        with _alarm(seconds), _prepared(), warnings.catch_warnings():
            warnings.simplefilter("error")
            code = run([str(word) for word in words])
    except (HangError, Exception) as error:
        raised = f"{type(error).__name__}: {error}"
    finally:
        said_out, said_err = out.getvalue(), err.getvalue().decode("utf-8")
        sys.stdin, sys.stdout, sys.stderr = streams
    return Ending(words=[str(word) for word in words], code=code, out=said_out, err=said_err, raised=raised)


class _Terminal(io.BytesIO):
    """Bytes of a stream that claims to be a terminal."""

    def isatty(self) -> bool:
        return True


@cache
def _parser() -> Any:
    from nlosctl.cli.main import app

    return typer.main.get_command(app)


_list_methods, _list_formats = registry.entries, registry.format_entries


@cache
def _known_methods(path: tuple[str, ...]) -> list[registry.MethodEntry]:
    return _list_methods()


@cache
def _known_formats(path: tuple[str, ...]) -> list[registry.MethodEntry]:
    return _list_formats()


@contextmanager
def _prepared() -> Iterator[None]:
    """Reuse one parser and one list of methods and formats: building them takes most of the time of a run."""
    from nlosctl.cli import main

    main.app, made_again = _parser(), main.app
    registry.entries, listed_again = partial(_known_methods, tuple(sys.path)), registry.entries
    registry.format_entries, formats_again = partial(_known_formats, tuple(sys.path)), registry.format_entries
    try:
        yield
    finally:
        main.app, registry.entries, registry.format_entries = made_again, listed_again, formats_again


@contextmanager
def _alarm(seconds: float) -> Iterator[None]:
    """Raise HangError after ``seconds`` of processor time, or after five minutes of wall time."""

    def ring(number: int, frame: FrameType | None) -> NoReturn:
        raise HangError(f"no end after {seconds:g} s of computing, or {_LONGEST_WAIT_S:g} s in all")

    clocks = ((signal.SIGPROF, signal.ITIMER_PROF, seconds), (signal.SIGALRM, signal.ITIMER_REAL, _LONGEST_WAIT_S))
    before = [signal.signal(number, ring) for number, _, _ in clocks]
    for _, clock, limit in clocks:
        signal.setitimer(clock, limit)
    try:
        yield
    finally:
        for (number, clock, _), handler in zip(clocks, before, strict=True):
            signal.setitimer(clock, 0.0)
            signal.signal(number, handler)


def complaints(ending: Ending, folder: Path, outputs: Sequence[str], before: Sequence[str]) -> Iterator[str]:
    """Yield violations of the rules for exit codes, for one clear line, and for complete outputs.

    ``before`` are the names in ``folder`` at the start, ``outputs`` those that the arguments name.
    """
    if ending.raised:
        yield f"raised {ending.raised}"
        return
    if ending.code not in (0, 1, 2):
        yield f"exit code {ending.code}"
    yield from message_complaints(ending.err, quiet_end=ending.code == 0)
    new = sorted({path.name for path in folder.iterdir()} - set(before))
    wanted = sorted(outputs) if ending.code == 0 else []
    if new != wanted and not (ending.code == 1 and new == sorted(outputs) and "every row is bad" in ending.err):
        yield f"exit {ending.code} left {new}, expected {wanted}"


def message_complaints(err: str, *, quiet_end: bool) -> Iterator[str]:
    """Yield complaints about standard error of a quiet run: empty at exit 0, else one clear line."""
    lines = err.split("\n")[:-1] if err.endswith("\n") else err.split("\n")
    if quiet_end:
        if err:
            yield f"a quiet run printed {err[:300]!r}"
        return
    if not err.endswith("\n") or not lines[0].startswith("nlosctl: "):
        yield f"the message is not a line of nlosctl: {err[:300]!r}"
    if "Traceback" in err or "internal error" in err:
        yield f"an internal error: {err[:400]!r}"
    gathered = all(re.search(r", (row|line) \d+|bad rows? in all|^nlosctl: ", line) for line in lines)
    if len(lines) > MOST_LINES or (len(lines) > 1 and not gathered):
        yield f"{len(lines)} lines: {err[:600]!r}"
    if max(map(len, lines)) > LONGEST_LINE:
        yield f"a line of {max(map(len, lines))} characters: {err[:200]!r}"
    strange = [character for line in lines for character in line if not character.isprintable()]
    if strange:
        yield f"unprintable {strange[0]!r} in {err[:300]!r}"
