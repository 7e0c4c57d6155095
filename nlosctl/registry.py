"""The installed methods and formats: their entry points and how they are loaded. Does not import NumPy."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from importlib.metadata import EntryPoint, entry_points
from typing import TYPE_CHECKING, Any

from nlosctl.errors import MethodError, UsageError, did_you_mean, in_one_line

if TYPE_CHECKING:
    from nlosctl.contract.formats import ExporterSpec, ImporterSpec
    from nlosctl.contract.methods import MethodSpec

__all__ = [
    "MethodEntry",
    "entries",
    "format_entries",
    "is_built_in",
    "load",
    "load_format",
    "resolve",
    "resolve_format",
]

GROUP = "nlosctl.methods"
FORMATS_GROUP = "nlosctl.formats"
DISTRIBUTION = "nlosctl"


@dataclass(frozen=True, kw_only=True)
class MethodEntry:
    """An installed method or format, not imported yet; the ``kind`` of a format is import or export."""

    kind: str
    name: str
    distribution: str
    version: str
    entry_point: EntryPoint

    @property
    def full_name(self) -> str:
        """The name of the entry point: ``kind.name``."""
        return f"{self.kind}.{self.name}"


def entries() -> list[MethodEntry]:
    """Return all methods, ordered by kind and name; ``NLOSCTL_NO_PLUGINS=1`` omits those of other distributions."""
    return _entries(GROUP)


def format_entries() -> list[MethodEntry]:
    """Return all importers and exporters of files, as `entries` does."""
    return _entries(FORMATS_GROUP)


def _entries(group: str) -> list[MethodEntry]:
    found = [_entry(point) for point in entry_points(group=group)]
    if os.environ.get("NLOSCTL_NO_PLUGINS", "") not in ("", "0"):
        found = [entry for entry in found if entry.distribution == DISTRIBUTION]
    return sorted(set(found), key=lambda entry: (entry.kind, entry.name, entry.distribution))


def resolve(name: str, kind: str, job: str | None = None) -> MethodSpec:
    """Return the loaded method ``name`` for a kind of measurement (``kind.name`` is accepted too).

    Raises UsageError if it does not exist or is ambiguous, with the closest name and the kinds that have it.
    """
    known = entries()
    wanted = name if "." in name else f"{kind}.{name}"
    matches = [entry for entry in known if entry.full_name == wanted and entry.kind == kind]
    if not matches:
        raise UsageError(_unknown(name, kind, known))
    spec = load(_single(matches, f"method {wanted!r}"))
    if job is not None and spec.job != job:
        raise UsageError(f"method {name!r} is for '{spec.job}', not for '{job}'")
    return spec


def resolve_format(name: str, way: str) -> ImporterSpec | ExporterSpec:
    """Return the loaded importer or exporter ``name``; ``way`` is import or export.

    Raises UsageError if it does not exist or is ambiguous, with the closest name.
    """
    known = [entry for entry in format_entries() if entry.kind == way]
    matches = [entry for entry in known if name in (entry.name, entry.full_name)]
    if not matches:
        names = [entry.name for entry in known]
        raise UsageError(f"no {way}er {name!r}{did_you_mean(name, names)}; there are: {', '.join(names) or 'none'}")
    return load_format(_single(matches, f"{way}er {name!r}"))


def load(entry: MethodEntry) -> MethodSpec:
    """Import a method and check it against its entry point; raises MethodError with the fault."""
    from nlosctl.contract.methods import CONTRACT_VERSION, MethodSpec, contract_fault

    spec: MethodSpec = _load(entry, "method", MethodSpec, CONTRACT_VERSION, contract_fault)
    return spec


def is_built_in(spec: MethodSpec) -> bool:
    """Whether a method is part of nlosctl, and therefore need not state a version of the contract."""
    built_in = [
        entry for entry in entries() if entry.distribution == DISTRIBUTION and entry.full_name == spec.full_name
    ]
    return any(load(entry) is spec for entry in built_in)


def load_format(entry: MethodEntry) -> ImporterSpec | ExporterSpec:
    """Import an importer or exporter and check it, as `load` does for a method."""
    from nlosctl.contract.formats import FORMATS_VERSION, ExporterSpec, ImporterSpec, formats_fault

    wanted = {"import": ImporterSpec, "export": ExporterSpec}.get(entry.kind)
    if wanted is None:
        raise MethodError(f"format {entry.full_name!r} of {entry.distribution}: expected import.NAME or export.NAME")
    spec: ImporterSpec | ExporterSpec = _load(entry, "format", wanted, FORMATS_VERSION, formats_fault)
    return spec


def _load(
    entry: MethodEntry, what: str, wanted: type[Any], version: int, find_fault: Callable[[int | None], str]
) -> Any:
    where = f"{what} {entry.full_name!r} of {entry.distribution} {entry.version}"
    try:
        spec = entry.entry_point.load()
    except (Exception, SystemExit) as error:  # any exception on import is a fault of the plugin
        hint = f" (this nlosctl has contract version {version})" if _touches_contract(error, wanted) else ""
        raise MethodError(f"{where} can't be loaded: {in_one_line(error)}{hint}") from error
    if not isinstance(spec, wanted):
        raise MethodError(f"{where} is a {type(spec).__name__}, not a {wanted.__module__}.{wanted.__name__}")
    if spec.full_name != entry.full_name:
        raise MethodError(f"{where} has the name {spec.full_name!r} in its spec; entry point and spec must agree")
    built_in = entry.distribution == DISTRIBUTION and spec.contract_version is None
    fault = "" if built_in else find_fault(spec.contract_version)
    if fault:
        raise MethodError(f"{where} {fault}")
    return spec


def _touches_contract(error: BaseException, wanted: type[Any]) -> bool:
    """Whether an error may come from another version of the contract, which has other names or arguments."""
    missing = isinstance(error, ImportError) and str(error.name).startswith(DISTRIBUTION)
    return missing or (isinstance(error, TypeError) and wanted.__name__ in str(error))


def _single(matches: list[MethodEntry], what: str) -> MethodEntry:
    if len(matches) > 1:
        owners = " and ".join(sorted(entry.distribution for entry in matches))
        raise UsageError(f"{what} is provided by {owners}; uninstall one of them")
    return matches[0]


def _entry(point: EntryPoint) -> MethodEntry:
    kind, _, name = point.name.partition(".")
    distribution = point.dist
    return MethodEntry(
        kind=kind,
        name=name,
        distribution=distribution.name if distribution is not None else "unknown",
        version=distribution.version if distribution is not None else "unknown",
        entry_point=point,
    )


def _unknown(name: str, kind: str, known: list[MethodEntry]) -> str:
    bare = name.rpartition(".")[2]
    others = sorted({entry.kind for entry in known if entry.name == bare})
    names = sorted({entry.name for entry in known if entry.kind == kind})
    if others:
        return f"method {name!r} is for {', '.join(others)}, not for {kind}; there are: {', '.join(names) or 'none'}"
    near = did_you_mean(bare, names) or did_you_mean(bare, {entry.name for entry in known})
    return f"no method {name!r} for {kind}{near}; there are: {', '.join(names) or 'none'}"
