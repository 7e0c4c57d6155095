"""Fields of a log that an importer copies (``keep``) or that separate snapshots (``group``), chosen by the user."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from nlosctl.contract.formats import ForeignFile
from nlosctl.contract.options import option
from nlosctl.errors import DataError, did_you_mean
from nlosctl.formats.fields import KEEP_MEANING, kept_cells, listed

__all__ = ["OwnFieldOptions", "OwnFields"]


@dataclass(frozen=True, kw_only=True)
class OwnFieldOptions:
    """The fields by name, separated by commas."""

    group: str | None = option(
        None, meaning="column, or several (A,B), whose values separate snapshots; default: the tag or frequency"
    )
    keep: str | None = option(None, meaning=KEEP_MEANING)


class OwnFields:
    """Takes the fields of ``group`` and ``keep`` from records whose fields may differ from one to the next."""

    def __init__(self, group: str | None, keep: str | None) -> None:
        self._by, self._keep = listed(group), listed(keep)
        self.wanted = [*self._by, *self._keep]
        self._known: dict[str, None] = {}

    def group(self, cells: Mapping[str, str], default: str) -> str:
        """Return what separates the snapshots of a record: the fields of ``group``, or the default without any."""
        return "/".join(cells.get(name, "") for name in self._by) if self._by else default

    def kept(self, cells: Mapping[str, str]) -> dict[str, str | None]:
        """Return the fields of ``keep`` as text, None for one that is empty or absent."""
        if self.wanted:
            self._known.update(dict.fromkeys(cells))
        return kept_cells({name: cells.get(name, "") for name in self._keep}, self._keep)

    def check(self, file: ForeignFile) -> None:
        """Raise DataError if no record has a field that is wanted; for the end of the log."""
        for name in self.wanted if self._known else ():
            if name not in self._known:
                near = did_you_mean(name, self._known)
                raise DataError(f"{file.name}: no field {name!r}{near}. The log has: {', '.join(self._known)}")
