"""An installed third-party plugin: listed, loaded and checked like a built-in method."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

pytestmark = [pytest.mark.process, pytest.mark.xdist_group("plugin")]

HERE = Path(__file__).parent

LIST = """
import json
from nlosctl import registry
print(json.dumps([[e.full_name, e.distribution, e.version] for e in registry.entries()]))
"""

LOAD = """
import json, sys
from nlosctl import registry
from nlosctl.errors import NlosctlError
result = {}
for entry in registry.entries():
    try:
        result[f"{entry.full_name} of {entry.distribution}"] = registry.load(entry).summary
    except NlosctlError as error:
        result[f"{entry.full_name} of {entry.distribution}"] = f"fault: {error}"
print(json.dumps(result))
"""

RESOLVE = """
import json, sys
from nlosctl import registry
from nlosctl.errors import NlosctlError
try:
    print(json.dumps(registry.resolve(sys.argv[1], "bearings", "localize").full_name))
except NlosctlError as error:
    print(json.dumps(f"{type(error).__name__}: {error}"))
"""

CHECK = """
import json
from nlosctl import registry
from nlosctl.testing import LawBroken, check_method
spec = registry.resolve("crossings-centroid", "bearings")
for seed in range(3):
    check_method(spec, seed=seed)
print(json.dumps("obeys"))
"""


def install(package: str, work: Path) -> Path:
    """Install a package of this folder by pip without network, and return the folder for the path."""
    source = work / package
    shutil.copytree(HERE / package, source, ignore=shutil.ignore_patterns("__pycache__"))
    target = work / f"{package}_installed"
    command = [sys.executable, "-m", "pip", "install", "--quiet", "--no-index", "--no-deps", "--no-build-isolation"]
    command += ["--disable-pip-version-check", "--no-compile", "--target", str(target), str(source)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return target


@pytest.fixture(scope="module")
def centroid(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder with the valid plugin."""
    return install("nlosctl_centroid", tmp_path_factory.mktemp("centroid"))


@pytest.fixture(scope="module")
def broken(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder with the broken plugin."""
    return install("nlosctl_broken", tmp_path_factory.mktemp("broken"))


def run(program: str, *arguments: str, path: list[Path], **environment: str) -> Any:
    """Return the JSON output of a program run by a Python process that sees the installed plugins."""
    joined = os.pathsep.join([*map(str, path), *filter(None, [os.environ.get("PYTHONPATH")])])
    plain = {name: value for name, value in os.environ.items() if name != "NLOSCTL_NO_PLUGINS"}
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", program, *arguments],
        capture_output=True,
        text=True,
        check=False,
        env={**plain, "PYTHONPATH": joined, **environment},
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def test_a_plugin_is_listed_with_its_distribution(centroid: Path) -> None:
    """An installed plugin is in the list beside the built-in methods, with its distribution and version."""
    listed = run(LIST, path=[centroid])
    assert ["bearings.crossings-centroid", "nlosctl-centroid", "0.3.1"] in listed
    assert "bearings.ml" in [name for name, _, _ in listed]


def test_without_it_there_is_no_such_method() -> None:
    """Without its installation the name is unknown."""
    message = run(RESOLVE, "crossings-centroid", path=[])
    assert message.startswith("UsageError: no method 'crossings-centroid' for bearings")


def test_a_plugin_is_resolved_by_its_name(centroid: Path) -> None:
    """A plugin's method is found by its bare name, like a built-in one."""
    assert run(RESOLVE, "crossings-centroid", path=[centroid]) == "bearings.crossings-centroid"


def test_a_plugin_obeys_the_laws(centroid: Path) -> None:
    """The laws hold for a method written by the contract only."""
    assert run(CHECK, path=[centroid]) == "obeys"


def test_plugins_can_be_hidden(centroid: Path) -> None:
    """``NLOSCTL_NO_PLUGINS=1`` lists and resolves built-in methods only."""
    listed = run(LIST, path=[centroid], NLOSCTL_NO_PLUGINS="1")
    assert {distribution for _, distribution, _ in listed} == {"nlosctl"}
    message = run(RESOLVE, "crossings-centroid", path=[centroid], NLOSCTL_NO_PLUGINS="1")
    assert message.startswith("UsageError: no method 'crossings-centroid'")


def test_a_broken_plugin_is_reported(centroid: Path, broken: Path) -> None:
    """A plugin that fails on import is reported with method, distribution and fault; others load."""
    loaded = run(LOAD, path=[centroid, broken])
    assert loaded.pop("bearings.broken of nlosctl-broken") == (
        "fault: method 'bearings.broken' of nlosctl-broken 0.0.1 can't be loaded: "
        "ImportError: libfoo.so.3: cannot open shared object file"
    )
    assert loaded.pop("bearings.ls of nlosctl-broken").startswith("fault: ")
    assert {"bearings.ls of nlosctl", "bearings.ml of nlosctl"} < loaded.keys()
    assert not [summary for summary in loaded.values() if summary.startswith("fault: ")]


def test_ambiguous_names_are_errors_when_used(broken: Path) -> None:
    """A name of two distributions is an error that names both when used; other names work."""
    message = run(RESOLVE, "ls", path=[broken])
    assert message == "UsageError: method 'bearings.ls' is provided by nlosctl and nlosctl-broken; uninstall one of them"
    assert run(RESOLVE, "ml", path=[broken]) == "bearings.ml"
