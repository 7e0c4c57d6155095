"""Which methods there are, and loading one. The only reader of entry points; imports neither numpy nor pyarrow."""

from __future__ import annotations

import os
from dataclasses import dataclass
from importlib.metadata import EntryPoint, entry_points
from typing import TYPE_CHECKING

from nlosctl.errors import MethodError, UsageError, did_you_mean, in_one_line

if TYPE_CHECKING:
    from nlosctl.contract.methods import MethodSpec

__all__ = ["MethodEntry", "entries", "load", "resolve"]

GROUP = "nlosctl.methods"
DISTRIBUTION = "nlosctl"


@dataclass(frozen=True, kw_only=True)
class MethodEntry:
    """A method that is installed, not imported yet."""

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
    """Return all methods, ordered by kind and name; ``NLOSCTL_NO_PLUGINS=1`` leaves out those of others."""
    found = [_entry(point) for point in entry_points(group=GROUP)]
    if os.environ.get("NLOSCTL_NO_PLUGINS", "") not in ("", "0"):
        found = [entry for entry in found if entry.distribution == DISTRIBUTION]
    return sorted(set(found), key=lambda entry: (entry.kind, entry.name, entry.distribution))


def resolve(name: str, kind: str, job: str | None = None) -> MethodSpec:
    """Return the loaded method ``name`` for a kind of measurement (``kind.name`` is accepted too).

    Raises UsageError where there is none, or more than one, with the nearest names and the kinds it exists for.
    """
    known = entries()
    wanted = name if "." in name else f"{kind}.{name}"
    matches = [entry for entry in known if entry.full_name == wanted and entry.kind == kind]
    if not matches:
        raise UsageError(_unknown(name, kind, known))
    if len(matches) > 1:
        owners = " and ".join(sorted(entry.distribution for entry in matches))
        raise UsageError(f"method {wanted!r} is provided more than once, by {owners}; uninstall one of them")
    spec = load(matches[0])
    if job is not None and spec.job != job:
        raise UsageError(f"method {name!r} does the job of '{spec.job}', not of '{job}'")
    return spec


def load(entry: MethodEntry) -> MethodSpec:
    """Import a method and check that it is what its entry point says; raises MethodError that tells the fault."""
    from nlosctl.contract.methods import CONTRACT_VERSION, MethodSpec, contract_fault

    where = f"method {entry.full_name!r} of {entry.distribution} {entry.version}"
    try:
        spec = entry.entry_point.load()
    except (Exception, SystemExit) as error:  # whatever a plugin raises on import is its fault, not ours
        hint = f" (this nlosctl has contract version {CONTRACT_VERSION})" if _touches_contract(error) else ""
        raise MethodError(f"{where} can't be loaded: {in_one_line(error)}{hint}") from error
    if not isinstance(spec, MethodSpec):
        raise MethodError(f"{where} is a {type(spec).__name__}, not a nlosctl.contract.methods.MethodSpec")
    if spec.full_name != entry.full_name:
        raise MethodError(f"{where} calls itself {spec.full_name!r}; entry point and spec must agree")
    built_in = entry.distribution == DISTRIBUTION and spec.contract_version is None
    fault = "" if built_in else contract_fault(spec.contract_version)
    if fault:
        raise MethodError(f"{where} {fault}")
    return spec


def _touches_contract(error: BaseException) -> bool:
    """Whether what went wrong may come from another version of the contract: a name or an argument that it lacks."""
    missing = isinstance(error, ImportError) and str(error.name).startswith(DISTRIBUTION)
    return missing or (isinstance(error, TypeError) and "MethodSpec" in str(error))


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
    if others:
        return f"method {name!r} exists for {', '.join(others)}, not for {kind}"
    names = sorted({entry.name for entry in known if entry.kind == kind})
    near = did_you_mean(bare, names) or did_you_mean(bare, {entry.name for entry in known})
    return f"no method {name!r} for {kind}{near}; there are: {', '.join(names) or 'none'}"
