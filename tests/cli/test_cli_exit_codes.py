"""Convention 3: exit codes."""

from __future__ import annotations

import contextlib
import re
import signal
import subprocess
import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import IO

import pytest
from cli_support import FIXTURES, GOOD, PROGRAM, Outcome, crossing_rows, listing, plain_csv, plain_environment, process

Cli = Callable[..., Outcome]


def test_0_even_without_estimates(cli: Cli, tmp_path: Path) -> None:
    """A snapshot without an estimate is counted in the summary; the exit code is 0."""
    (tmp_path / "m.csv").write_text(plain_csv([*crossing_rows(1), *crossing_rows(2, 1)]))
    outcome = cli("localize", "m.csv")
    assert outcome.code == 0
    assert "ml: 1 ok, 1 too_few" in outcome.err


def test_strict_is_3_when_a_snapshot_got_no_estimate(cli: Cli, tmp_path: Path) -> None:
    """``--strict`` exits 3 with the same outputs; 0 if every snapshot has an estimate."""
    (tmp_path / "m.csv").write_text(plain_csv([*crossing_rows(1), *crossing_rows(2, 1)]))
    (tmp_path / "n.csv").write_text(plain_csv(crossing_rows(1)))
    strict = cli("localize", "m.csv", "--strict")
    assert strict.code == 3
    assert strict.out == cli("localize", "m.csv").out
    assert cli("localize", "n.csv", "--strict").code == 0


def test_bad_data_is_1(cli: Cli) -> None:
    """Bad data, a missing file and an existing output exit 1."""
    assert cli("localize", FIXTURES / "bad_zero_std.csv").code == 1
    assert cli("localize", "absent.csv").code == 1
    assert cli("simulate", "ring", "-n", 1, "-o", "m.csv").code == 0
    assert cli("simulate", "ring", "-n", 1, "-o", "m.csv").code == 1


@pytest.mark.parametrize(
    "words",
    [
        ["localise"],
        ["localize"],
        ["localize", GOOD, "--nope"],
        ["localize", GOOD, "--method", "nope"],
        ["localize", GOOD, "-p", "nope=1"],
        ["localize", GOOD, "-o", "x.nope"],
        ["localize", GOOD, "--jobs", "many"],
        ["simulate", "nope"],
        ["simulate", "ring", "-p", "sensors=0"],
        ["simulate", "ring", "--seed", "-1"],
        ["schema", "nope"],
        ["methods", "show", "nope"],
        ["evaluate", GOOD, "--alternatives", "worst"],
    ],
    ids=lambda words: " ".join(map(str, words)).replace(str(GOOD), "FILE"),
)
def test_usage_errors_are_2(cli: Cli, tmp_path: Path, words: list[str]) -> None:
    """A usage error exits 2 with one line, nothing on stdout and nothing written."""
    outcome = cli(*words)
    assert outcome.code == 2, outcome.err
    assert len(outcome.err.strip().splitlines()) == 1
    assert outcome.err.startswith("nlosctl: ")
    assert "internal error" not in outcome.err
    assert (outcome.out, listing(tmp_path)) == (b"", [])


def test_a_condition_met_is_4(cli: Cli) -> None:
    """``evaluate --fail-if`` exits 4 if a condition is met, 0 if none is."""
    cli("localize", GOOD, "-o", "e.csv")
    assert cli("evaluate", "e.csv", "--fail-if", "rmse_m>1").code == 4
    assert cli("evaluate", "e.csv", "--fail-if", "rmse_m>1000").code == 0


def test_help_lists_the_exit_codes(cli: Cli) -> None:
    """``nlosctl --help`` explains 0, 1, 2, 3, 4 and 130."""
    outcome = cli("--help")
    text = " ".join(outcome.text.split())
    assert outcome.code == 0
    codes = text[text.index("Exit codes:") :]
    assert re.findall(r"\b(0|1|2|3|4|130) ", codes) == ["0", "1", "2", "3", "4", "130"]


@pytest.mark.extensive
@pytest.mark.parametrize("command", ["localize", "evaluate", "simulate", "validate", "methods", "schema"])
def test_every_command_has_help(cli: Cli, command: str) -> None:
    """``COMMAND --help`` and ``-h`` print usage and exit 0."""
    long, short = cli(command, "--help"), cli(command, "-h")
    assert (long.code, short.code) == (0, 0)
    assert f"nlosctl {command}" in long.text
    assert long.out == short.out


def test_version(cli: Cli) -> None:
    """``--version`` prints name and version."""
    from nlosctl import __version__

    assert cli("--version").text == f"nlosctl {__version__}\n"


def feed_without_end(pipe: IO[bytes]) -> None:
    """Write valid rows into a pipe until its reader is gone."""
    pipe.write(plain_csv([]).encode())
    with contextlib.suppress(OSError):
        for start in range(0, 10_000_000, 500):
            rows = (f"{index},a,0,0,0.98,0.01\n{index},b,1,0,1.25,0.01\n" for index in range(start, start + 500))
            pipe.write("".join(rows).encode())


def interrupted(work: Path, delay: float) -> tuple[int | None, str]:
    """Return exit code (None: a hang) and stderr of a run that is interrupted while it writes."""
    work.mkdir()
    words = ["localize", "-", "-o", "e.parquet", "--flags-out", "f.csv", "--bad-rows", "b.csv"]
    running = subprocess.Popen(
        [str(PROGRAM), *words],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        cwd=work,
        env=plain_environment(),
    )
    feeder = threading.Thread(target=feed_without_end, args=(running.stdin,), daemon=True)
    feeder.start()
    try:
        deadline = time.monotonic() + 20
        while len(listing(work)) < 3:
            assert time.monotonic() < deadline, "no temporary files appear"
            time.sleep(0.01)
        time.sleep(delay)
        running.send_signal(signal.SIGINT)
        with contextlib.suppress(subprocess.TimeoutExpired):
            running.wait(timeout=30)  # a hang never ends; a busy machine is slow
        ended = running.poll()
    finally:
        running.kill()
        feeder.join(timeout=10)
        _, err = running.communicate()
    return ended, err.decode()


@pytest.mark.process
def test_interrupted_is_130_and_leaves_nothing(tmp_path: Path) -> None:
    """Ctrl-C during a run: 130, at most one line, and no file, complete or partial."""
    with ThreadPoolExecutor(3) as pool:
        futures = [pool.submit(interrupted, tmp_path / str(index), 0.15 * index) for index in range(3)]
        ended = [future.result() for future in futures]
    assert [code for code, _ in ended] == [130] * 3, ended
    assert [err for _, err in ended if len(err.strip().splitlines()) > 1] == []
    assert [listing(tmp_path / str(index)) for index in range(3)] == [[]] * 3


@pytest.mark.process
@pytest.mark.parametrize("extra", [[], ["--format", "arrow"]], ids=["csv", "arrow"])
def test_a_closed_pipe_is_quiet(tmp_path: Path, extra: list[str]) -> None:
    """A closed pipe (``| head -1``) exits without an error and without output on stderr."""
    words = " ".join(["nlosctl", "simulate", "ring", "-n", "40000", *extra])
    script = f"{words} | head -c 10 > /dev/null; echo ${{PIPESTATUS[0]}}"
    done = subprocess.run(
        ["bash", "-c", script], capture_output=True, cwd=tmp_path, env=plain_environment(), check=False, timeout=60
    )
    assert done.stderr == b""
    assert done.stdout.strip() == b"0"


@pytest.mark.process
def test_the_process_exits_as_the_function_returns(tmp_path: Path) -> None:
    """The installed program exits with the code of the function, and prints errors to stderr."""
    outcome = process("localize", "absent.csv", cwd=tmp_path)
    assert (outcome.code, outcome.out) == (1, b"")
    assert outcome.err == "nlosctl: absent.csv: there is no such file\n"


def test_an_interrupt_while_a_class_is_made_is_130() -> None:
    """Python 3.11 wraps an interrupt within ``__set_name__`` in a RuntimeError; another RuntimeError passes."""
    from nlosctl.cli.main import _guarded, _StoppedError

    class Interrupting:
        def __set_name__(self, owner: type, name: str) -> None:
            raise KeyboardInterrupt

    def command() -> None:
        type("Made", (), {"field": Interrupting()})

    def broken() -> None:
        raise RuntimeError("broken")

    with pytest.raises(_StoppedError) as stopped:
        _guarded(command)()
    assert stopped.value.exit_code == 130
    with pytest.raises(RuntimeError, match="broken"):
        _guarded(broken)()
