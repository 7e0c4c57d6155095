"""The registry: listing and loading methods."""

from __future__ import annotations

import dataclasses
import subprocess
import sys
from importlib.metadata import EntryPoint
from pathlib import Path

import pytest

from nlosctl import registry
from nlosctl.contract import methods
from nlosctl.errors import MethodError, UsageError
from nlosctl.methods import bearings_ml

HERE = "nlosctl.methods.bearings_ml:METHOD"


@dataclasses.dataclass
class FakeDistribution:
    """The attributes of a distribution that the registry uses."""

    name: str
    version: str = "1.0"


def point(name: str, value: str = HERE, distribution: str = "nlosctl") -> EntryPoint:
    """Return an entry point of a distribution that is not installed."""
    made = EntryPoint(name=name, value=value, group=registry.GROUP)
    vars(made)["dist"] = FakeDistribution(distribution)
    return made


@pytest.fixture
def installed(monkeypatch: pytest.MonkeyPatch) -> list[EntryPoint]:
    """Replace the installed entry points by this list."""
    points = [point("bearings.ml"), point("bearings.ls"), point("ranges.taylor")]
    monkeypatch.setattr(registry, "entry_points", lambda group: list(points))
    monkeypatch.delenv("NLOSCTL_NO_PLUGINS", raising=False)
    return points


def entry(made: EntryPoint) -> registry.MethodEntry:
    """Return the entry of an entry point."""
    return next(one for one in registry.entries() if one.entry_point is made)


@pytest.mark.usefixtures("installed")
def test_entries_are_ordered_and_know_their_distribution() -> None:
    """Entries are sorted by kind and name, with distribution and version."""
    found = registry.entries()
    assert [one.full_name for one in found] == ["bearings.ls", "bearings.ml", "ranges.taylor"]
    assert {(one.distribution, one.version) for one in found} == {("nlosctl", "1.0")}


@pytest.mark.usefixtures("installed")
@pytest.mark.parametrize("name", ["ml", "bearings.ml"])
def test_a_name_is_resolved_by_the_kind(name: str) -> None:
    """A bare name and a full name give the same specification."""
    assert registry.resolve(name, "bearings", "localize") is bearings_ml.METHOD


@pytest.mark.usefixtures("installed")
@pytest.mark.parametrize(
    ("name", "kind", "says"),
    [
        ("taylr", "ranges", "no method 'taylr' for ranges (did you mean 'taylor'?); there are: taylor"),
        ("nonsense", "bearings", "no method 'nonsense' for bearings; there are: ls, ml"),
        ("taylor", "bearings", "method 'taylor' is for ranges, not for bearings; there are: ls, ml"),
        ("ranges.taylor", "bearings", "method 'ranges.taylor' is for ranges, not for bearings; there are: ls, ml"),
    ],
)
def test_unknown_methods_suggest_the_nearest(name: str, kind: str, says: str) -> None:
    """An unknown method is a usage error with the nearest names, or the kinds that have it."""
    with pytest.raises(UsageError) as caught:
        registry.resolve(name, kind)
    assert str(caught.value) == says


@pytest.mark.usefixtures("installed")
def test_a_method_of_another_job_is_refused() -> None:
    """A method of another job is a usage error."""
    with pytest.raises(UsageError, match="'ml' is for 'localize', not for 'detect-ip'"):
        registry.resolve("ml", "bearings", "detect-ip")


def test_ambiguous_names_are_errors_when_used(installed: list[EntryPoint]) -> None:
    """Two distributions with one name are both listed; using the name is an error that names them."""
    installed.append(point("bearings.ml", distribution="rival"))
    assert [one.full_name for one in registry.entries()].count("bearings.ml") == 2
    with pytest.raises(UsageError, match=r"'bearings\.ml' is provided by nlosctl and rival"):
        registry.resolve("ml", "bearings")
    assert entry(installed[1]).full_name == "bearings.ls"


def test_a_distribution_found_twice_is_listed_once(installed: list[EntryPoint]) -> None:
    """The same entry point found twice on the path is one method."""
    installed.append(installed[0])
    assert [one.full_name for one in registry.entries()].count("bearings.ml") == 1


@pytest.mark.parametrize(("value", "others"), [("1", False), ("true", False), ("0", True), ("", True)])
def test_plugins_can_be_hidden(
    installed: list[EntryPoint], monkeypatch: pytest.MonkeyPatch, value: str, others: bool
) -> None:
    """``NLOSCTL_NO_PLUGINS`` leaves only built-in methods; 0 and an empty value have no effect."""
    installed.append(point("bearings.other", distribution="other"))
    monkeypatch.setenv("NLOSCTL_NO_PLUGINS", value)
    assert ("bearings.other" in {one.full_name for one in registry.entries()}) is others


@pytest.mark.parametrize(
    ("name", "value", "says"),
    [
        ("bearings.gone", "no_such_module_at_all:METHOD", "can't be loaded: ModuleNotFoundError"),
        ("bearings.gone", "nlosctl.methods.bearings_ml:NOTHING", "can't be loaded: AttributeError"),
        (
            "bearings.class",
            "nlosctl.contract.methods:MethodSpec",
            "is a type, not a nlosctl.contract.methods.MethodSpec",
        ),
        ("bearings.mlx", HERE, "has the name 'bearings.ml' in its spec; entry point and spec must agree"),
    ],
)
def test_broken_entries_are_reported(installed: list[EntryPoint], name: str, value: str, says: str) -> None:
    """A method that cannot be loaded or is invalid is reported with method, distribution and fault."""
    made = point(name, value, "plugin")
    installed.append(made)
    with pytest.raises(MethodError) as caught:
        registry.load(entry(made))
    assert str(caught.value).startswith(f"method {name!r} of plugin 1.0 ")
    assert says in str(caught.value)


@pytest.mark.parametrize(
    ("stated", "fault"),
    [
        (None, "doesn't state its contract version: give its MethodSpec contract_version=3"),
        (4, "was written for contract version 4, newer than 3 of this nlosctl: upgrade nlosctl"),
        (1, "was written for contract version 1, older than 2, the oldest that this nlosctl works with: upgrade the"),
    ],
)
def test_unsupported_contract_versions_are_refused(
    monkeypatch: pytest.MonkeyPatch, installed: list[EntryPoint], stated: int | None, fault: str
) -> None:
    """A plugin with a newer, older or missing contract version is refused with the cure."""
    set_versions(monkeypatch, stated)
    installed.append(point("bearings.ml", distribution="other"))
    with pytest.raises(MethodError) as caught:
        registry.load(entry(installed[-1]))
    assert str(caught.value).startswith(f"method 'bearings.ml' of other 1.0 {fault}")


@pytest.mark.parametrize("stated", [2, 3])
def test_supported_contract_versions_are_loaded(
    monkeypatch: pytest.MonkeyPatch, installed: list[EntryPoint], stated: int
) -> None:
    """Plugins of the newest and the oldest supported version are loaded; built-in methods state none."""
    set_versions(monkeypatch, stated)
    installed.append(point("bearings.ml", distribution="other"))
    assert registry.load(entry(installed[-1])).contract_version == stated
    set_versions(monkeypatch, None)
    assert registry.load(entry(installed[0])).name == "ml"


def set_versions(monkeypatch: pytest.MonkeyPatch, stated: int | None) -> None:
    """Make this nlosctl support contract versions 2 and 3, and the method ml state ``stated``."""
    monkeypatch.setattr(methods, "CONTRACT_VERSION", 3)
    monkeypatch.setattr(methods, "OLDEST_CONTRACT_VERSION", 2)
    monkeypatch.setattr(bearings_ml, "METHOD", dataclasses.replace(bearings_ml.METHOD, contract_version=stated))


@pytest.mark.parametrize(
    "source",
    [
        "from nlosctl.contract.methods import NoSuchName",
        "from nlosctl.contract.methods import MethodSpec; MethodSpec(new=1)",
    ],
)
def test_missing_names_report_the_contract_version(
    monkeypatch: pytest.MonkeyPatch, installed: list[EntryPoint], tmp_path: Path, source: str
) -> None:
    """A plugin that uses a name or argument missing from the contract is reported with the version of this nlosctl."""
    (tmp_path / "too_new_plugin.py").write_text(source)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "too_new_plugin", raising=False)
    installed.append(point("bearings.new", "too_new_plugin:METHOD", "plugin"))
    with pytest.raises(MethodError, match=r"can't be loaded: .* \(this nlosctl has contract version 1\)"):
        registry.load(entry(installed[-1]))


@pytest.mark.process
def test_listing_imports_no_method_and_no_numpy() -> None:
    """Listing the methods imports none of them, and no numpy, scipy or pyarrow."""
    program = (
        "import sys; from nlosctl import registry; assert registry.entries(); "
        "heavy = {'numpy', 'scipy', 'pyarrow'} & sys.modules.keys(); "
        "print([*heavy, *(name for name in sys.modules if name.startswith('nlosctl.m'))])"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
