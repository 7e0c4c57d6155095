"""The HTML of the page: one file with its styles, its scripts and its data, which loads nothing else."""

from __future__ import annotations

import base64
import hashlib
import json
from collections.abc import Mapping
from html import escape
from importlib.resources import files
from typing import Any

__all__ = ["page_bytes"]

_ASSETS = "nlosctl.pipeline.report"
_ESCAPED = {"<": "\\u003c", ">": "\\u003e", "&": "\\u0026"}


def page_bytes(content: Mapping[str, Any]) -> bytes:
    """Return the page of a report's ``content`` as UTF-8: the same bytes for the same content.

    Names from files are data alone: JSON without any character that could end its element, which the script writes as
    text. A content security policy allows the page's own scripts and styles by their hashes, and nothing else.
    """
    library, script = _asset("leaflet.js").rpartition("//# sourceMappingURL")[0], _asset("page.js")
    styles = _asset("leaflet.css"), _asset("page.css")
    policy = (
        f"default-src 'none'; script-src {_hashes(library, script)}; style-src {_hashes(*styles)}; "
        "base-uri 'none'; form-action 'none'"
    )
    slots = {
        "title": escape(str(content["title"])),
        "policy": policy,
        "licence": _asset("leaflet-LICENSE.txt").strip(),
        "library-style": styles[0],
        "style": styles[1],
        "data": json_for_html(content),
        "library": library,
        "script": script,
    }
    page = _asset("page.html")
    parts = page.split("{{")
    filled = [parts[0]]
    for part in parts[1:]:
        name, _, rest = part.partition("}}")
        filled += [slots[name], rest]
    return "".join(filled).encode("utf-8", errors="replace")  # a title may have bytes of a file's name


def json_for_html(content: Mapping[str, Any]) -> str:
    """Return values as JSON for the inside of an element: ASCII, and without <, > and &."""
    text = json.dumps(content, ensure_ascii=True, allow_nan=False, separators=(",", ":"))
    for character, code in _ESCAPED.items():
        text = text.replace(character, code)
    return text


def _asset(name: str) -> str:
    return files(_ASSETS).joinpath("assets", name).read_text(encoding="utf-8")


def _hashes(*texts: str) -> str:
    digests = (base64.b64encode(hashlib.sha256(text.encode("utf-8")).digest()).decode() for text in texts)
    return " ".join(f"'sha256-{digest}'" for digest in digests)
