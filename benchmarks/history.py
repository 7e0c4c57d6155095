"""The figures of a run as JSON, one file a run, and what got slower between two of them.

python benchmarks/history.py [OLD.json NEW.json]     (without names: the last two in benchmarks/history/)
"""

from __future__ import annotations

import json
import re
import sys
from datetime import UTC, datetime
from pathlib import Path

FOLDER = Path(__file__).parent / "history"
_LEAST_RATIO = 1.15
_FASTER_IS_MORE = ("throughput", "jobs 1 / jobs 2")


def figures(lines: list[str]) -> dict[str, float]:
    """Return every number of the Markdown tables in ``lines`` as ``section / row / column``."""
    found: dict[str, float] = {}
    section, header = "", list[str]()
    for line in lines:
        if line.startswith("## "):
            section, header = line[3:], []
        elif line.startswith("|") and not header:
            header = [cell.strip() for cell in line.strip("|").split("|")]
        elif line.startswith("|") and not line.startswith("|---"):
            cells = [cell.strip() for cell in line.strip("|").split("|")]
            for name, cell in zip(header[1:], cells[1:], strict=False):
                if re.fullmatch(r"-?[\d.]+(e-?\d+)?", cell):
                    found[f"{section} / {cells[0]} / {name}"] = float(cell)
        elif not line.startswith("|"):
            header = []
    return found


def keep(lines: list[str], versions: dict[str, str]) -> Path:
    """Write the figures of a run to the history and return the file."""
    FOLDER.mkdir(exist_ok=True)
    path = FOLDER / f"{datetime.now(UTC):%Y-%m-%dT%H%M%S}.json"
    content = {"versions": versions, "figures": figures(lines)}
    path.write_text(json.dumps(content, indent=1, sort_keys=True) + "\n", encoding="utf-8")
    return path


def slower(old: dict[str, float], new: dict[str, float]) -> list[str]:
    """Return a line for each figure that is worse by more than 15 %."""
    lines = []
    for name in sorted(old.keys() & new.keys()):
        more_is_better = any(word in name.rpartition(" / ")[2] for word in _FASTER_IS_MORE)
        before, after = (new[name], old[name]) if more_is_better else (old[name], new[name])
        if before > 0.0 and after / before > _LEAST_RATIO:
            lines.append(f"{name}: was {old[name]:g}, is {new[name]:g}")
    return lines


def main() -> int:
    """Compare two runs; return 1 where something got slower."""
    paths = [Path(word) for word in sys.argv[1:]] or sorted(FOLDER.glob("*.json"))[-2:]
    if len(paths) != 2:
        print("name two files of benchmarks/history/, or make two runs first: make benchmark")
        return 2
    old, new = (json.loads(path.read_text(encoding="utf-8"))["figures"] for path in paths)
    lines = slower(old, new)
    print("\n".join(lines) or f"nothing of {len(old.keys() & new.keys())} figures got slower by more than 15 %")
    return 1 if lines else 0


if __name__ == "__main__":
    sys.exit(main())
