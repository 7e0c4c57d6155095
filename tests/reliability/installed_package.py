"""Test an installed package from outside its source tree: `python installed_package.py FIXTURES`."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path

__all__: list[str] = []


def main() -> int:
    """Run the program next to this interpreter on the fixtures; return 0 if all runs succeed."""
    fixtures = Path(sys.argv[1]).resolve()
    program = Path(sys.executable).with_name("nlosctl")
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        import nlosctl

        place = Path(nlosctl.__file__).resolve()
        assert "site-packages" in place.parts, f"{place} is not the installed package"
        assert (place.parent / "py.typed").exists()
        lines = [
            ["localize", fixtures / "good_bearings.parquet", "-o", "fixes.parquet", "-q"],
            ["evaluate", "fixes.parquet", "--json"],
            ["identify-los", fixtures / "good_echoes.csv", "-q", "-o", "flags.csv"],
            ["detect-ip", fixtures / "good_triplets.parquet", "-q", "-o", "paths.csv"],
            ["simulate", "ring", "-n", "10", "-q", "-o", "m.arrow"],
            ["bound", "m.arrow", "-q", "-o", "b.csv"],
            ["report", "m.arrow", "fixes.parquet", "-o", "report.html", "-q"],
            ["methods", "--check"],
        ]
        for line in lines:
            subprocess.run([program, *map(str, line)], check=True, stdout=subprocess.DEVNULL)
        table = nlosctl.simulate("ring", trials=5, seed=1)
        assert nlosctl.localize(table).estimates.num_rows == 5
        os.chdir("/")
    sys.stdout.write(f"{place.parent}: all of it works\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
