"""Commands in pipes of a shell."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from cli_support import Outcome, plain_environment

pytestmark = pytest.mark.process

Cli = Callable[..., Outcome]


def shell(script: str, cwd: Path) -> tuple[int, bytes, str]:
    """Run a script by bash, failing when any part of a pipe fails."""
    done = subprocess.run(
        ["bash", "-o", "pipefail", "-c", script],
        capture_output=True,
        cwd=cwd,
        env=plain_environment(),
        check=False,
        timeout=60,
    )
    return done.returncode, done.stdout, done.stderr.decode()


@pytest.mark.parametrize("extra", ["", "--format arrow"], ids=["csv", "arrow"])
def test_simulate_localize_evaluate(cli: Cli, tmp_path: Path, extra: str) -> None:
    """The pipe of three gives the metrics of the same steps through files, and exits 4 by ``--fail-if``."""
    code, out, err = shell(
        f"nlosctl simulate ring -n 300 --seed 2 -q {extra} | nlosctl localize -m ml -m ls -q {extra} - "
        "| nlosctl evaluate --json - --fail-if 'rmse_m>1e-3'",
        tmp_path,
    )
    assert code == 4
    assert [line.split(" is ")[0] for line in err.splitlines()] == [
        f"nlosctl: rmse_m of {name}" for name in ("ml", "ls")
    ]
    figures: dict[str, Any] = json.loads(out)
    assert len(figures.pop("failed")) == 2
    assert [group["method"] for group in figures["groups"]] == ["ml", "ls"]
    assert sum(group["rows"] for group in figures["groups"]) == 600
    assert cli("simulate", "ring", "-n", 300, "--seed", 2, "-o", "m.parquet").code == 0
    assert cli("localize", "m.parquet", "-m", "ml", "-m", "ls", "-o", "e.parquet").code == 0
    assert cli("evaluate", "e.parquet", "--json").json == {**figures, "failed": []}


def test_flags_are_the_next_input(cli: Cli, tmp_path: Path) -> None:
    """Flags go from one ``localize`` to the next through a pipe, with the scene in the stream."""
    assert cli("simulate", "song-flat", "-n", 20, "-o", "m.parquet").code == 0
    assert cli("localize", "m.parquet", "-m", "ls", "-o", "e.parquet", "--flags-out", "f.arrows").code == 0
    code, out, err = shell("cat f.arrows | nlosctl localize - -q", tmp_path)
    assert (code, err) == (0, "")
    assert out == cli("localize", "m.parquet", "-q").out


def test_an_error_upstream_fails_the_pipe(tmp_path: Path) -> None:
    """If the first command fails the second has no input: both exit 1 with one line."""
    code, out, err = shell("nlosctl localize absent.csv | nlosctl evaluate -", tmp_path)
    assert (code, out) == (1, b"")
    assert sorted(line.split(":")[1] for line in err.splitlines()) == [" absent.csv", " stdin"]
