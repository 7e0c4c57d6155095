"""Completion in bash, zsh and fish: names of methods, parameters and others, without heavy imports."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from cli_support import PROGRAM, plain_environment

from nlosctl import registry
from nlosctl.cli.options.source_index import glance
from nlosctl.contract.options import describe_options
from nlosctl.scenarios.catalogue import find_scenario, scenario_module, scenarios

SHELLS = ["bash", "zsh", "fish"]
HEAVY = ["numpy", "scipy", "pyarrow", "msgspec", "pandas", "matplotlib"]

COMPLETE = """
import contextlib, io, json, sys
from nlosctl.cli.main import run
output = io.StringIO()
with contextlib.redirect_stdout(output), contextlib.suppress(SystemExit):
    run([])
print(json.dumps([output.getvalue(), sorted({name.partition(".")[0] for name in sys.modules})]))
"""

CASES = {
    "nlosctl localize -m st": ["stansfield", "stansfield-focused"],
    "nlosctl localize --kind ranges -m ": ["mixture-ml", "ml", "r-ls", "sr-ls"],
    "nlosctl detect-ip -m ": ["chi2", "joint", "tdaj"],
    "nlosctl identify-los --method t": ["tca"],
    "nlosctl localize -m ml-grid -p ": ["width_m=", "height_m=", "step_m=", "min_range_m="],
    "nlosctl identify-los -m extended-tca -p et": ["eta="],
    "nlosctl simulate li": ["liang"],
    "nlosctl simulate liang -p nlos": ["nlos_range="],
    "nlosctl methods show sequ": ["sequential"],
    "nlosctl localize --column azi": ["azimuth_ccw_deg=", "azimuth_ccw_mdeg=", "azimuth_deg=", "azimuth_mdeg="],
    "nlosctl localize --kind b": ["bearings"],
    "nlosctl validate --input-format pa": ["parquet"],
    "nlosctl schema trip": ["triplets"],
    "nlosctl config show ident": ["identify-los"],
    "nlosctl convert --from kr": ["kraken-csv", "kraken-json", "kraken-xml"],
    "nlosctl convert --to ge": ["geojson", "geoparquet"],
    "nlosctl convert --from uwb -p range": ["range=", "range_std_m=", "range_unit="],
    "nlosctl convert --to kml -p ": ["ellipse=", "line_length_m=", "vertices="],
    "nlosctl plot --view ro": ["roc"],
}


def asked(line: str, shell: str) -> dict[str, str]:
    """Return the variables by which a shell requests the completion of a line."""
    if shell == "bash":
        words = line.split(" ")
        return {"_NLOSCTL_COMPLETE": "complete_bash", "COMP_WORDS": line, "COMP_CWORD": str(len(words) - 1)}
    action = {"_TYPER_COMPLETE_FISH_ACTION": "get-args"} if shell == "fish" else {}
    return {"_NLOSCTL_COMPLETE": f"complete_{shell}", "_TYPER_COMPLETE_ARGS": line, **action}


def offered(line: str, shell: str) -> tuple[list[str], list[str]]:
    """Return the words that the program offers a shell, and the top-level modules that it imported."""
    done = subprocess.run(
        [sys.executable, "-c", COMPLETE],
        capture_output=True,
        text=True,
        check=True,
        env=plain_environment(**asked(line, shell)),
    )
    output, modules = json.loads(done.stdout)
    lines = output.strip().splitlines()
    if shell == "zsh":
        lines = [line.removeprefix("_arguments '*: :((").split(":")[0].strip("\"()'") for line in lines]
    return [line.split("\t")[0] for line in lines], modules


@pytest.mark.process
@pytest.mark.parametrize("line", CASES)
def test_completions(line: str) -> None:
    """Words with the prefix are offered, for the command's job and kind, without heavy imports."""
    words, modules = offered(line, SHELLS[sorted(CASES).index(line) % 3])
    assert sorted(words) == sorted(CASES[line])
    assert [name for name in HEAVY if name in modules] == []


@pytest.mark.process
@pytest.mark.parametrize("shell", SHELLS)
def test_every_shell_gets_the_same_names(shell: str) -> None:
    """The protocol of each shell gives the same names."""
    assert sorted(offered("nlosctl localize -m st", shell)[0]) == ["stansfield", "stansfield-focused"]


@pytest.mark.parametrize("entry", registry.entries(), ids=lambda entry: entry.full_name)
def test_options_from_the_source_are_those_of_the_method(entry: registry.MethodEntry) -> None:
    """Job, parameters and meanings as read from the source are those of the method once it is imported."""
    declared, spec = glance(entry.entry_point.module, entry.entry_point.attr), registry.load(entry)
    assert declared.job == spec.job
    assert list(declared.options) == [(item["name"], item["meaning"]) for item in describe_options(spec.options)]


@pytest.mark.extensive
@pytest.mark.parametrize("name", scenarios())
def test_options_from_the_source_are_those_of_the_scenario(name: str) -> None:
    """The parameters of a scenario as read from its source are its actual parameters."""
    names = [item["name"] for item in describe_options(find_scenario(name).options)]
    assert [option for option, _ in glance(str(scenario_module(name)), "SCENARIO").options] == names


def test_a_missing_source_has_no_options() -> None:
    """A module that can't be found, or a missing attribute, gives no completions and no exception."""
    for module, attribute in (("no_such.module", "METHOD"), ("nlosctl.errors", "METHOD"), ("math", "pi")):
        assert (glance(module, attribute).job, glance(module, attribute).options) == ("", ())


DRIVERS = {
    "bash": 'source ~/.bashrc; COMP_WORDS=(nlosctl localize -m st); COMP_CWORD=3; _nlosctl_completion "$0"; '
    'printf "%s\\n" "${COMPREPLY[@]}"',
    "fish": 'complete -C "nlosctl localize -m st"',
}


@pytest.mark.process
@pytest.mark.parametrize("shell", DRIVERS)
def test_a_real_shell_completes(tmp_path: Path, shell: str) -> None:
    """After ``nlosctl --install-completion`` the shell offers the methods."""
    if shutil.which(shell) is None:
        pytest.skip(f"no {shell} on this machine")
    environment = plain_environment(HOME=str(tmp_path), _TYPER_COMPLETE_TEST_DISABLE_SHELL_DETECTION="1")
    environment.pop("XDG_CONFIG_HOME", None)
    install = [str(PROGRAM), "--install-completion", shell]
    assert subprocess.run(install, capture_output=True, env=environment, check=False).returncode == 0
    command = [shell, "-c", DRIVERS[shell], *([str(PROGRAM)] if shell == "bash" else [])]
    done = subprocess.run(command, capture_output=True, text=True, env=environment, check=False, timeout=60)
    assert [line.split("\t")[0] for line in done.stdout.split("\n") if line] == ["stansfield", "stansfield-focused"]


@pytest.mark.process
def test_zsh_completion_is_installed(tmp_path: Path) -> None:
    """``--install-completion zsh`` writes the function and loads it at start."""
    environment = plain_environment(HOME=str(tmp_path), _TYPER_COMPLETE_TEST_DISABLE_SHELL_DETECTION="1")
    done = subprocess.run(
        [str(PROGRAM), "--install-completion", "zsh"], capture_output=True, env=environment, check=False
    )
    assert done.returncode == 0
    assert "#compdef nlosctl" in (tmp_path / ".zfunc" / "_nlosctl").read_text()
    assert "compinit" in (tmp_path / ".zshrc").read_text()
