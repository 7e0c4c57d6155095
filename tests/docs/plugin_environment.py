"""A virtual environment with everything that is installed here, into which a test may install more."""

from __future__ import annotations

import site
import sys
import venv
from pathlib import Path

__all__ = ["make_environment"]

_SCRIPTS = {
    "pip": '#!/bin/bash\nexec "{python}" -m pip "${{@/#-e/--no-compile}}" --no-index --no-deps --no-build-isolation\n',
    "nlosctl": '#!/bin/sh\nexec "{python}" -W error -m nlosctl.cli "$@"\n',
    "pytest": '#!/bin/sh\nexec "{python}" -m pytest -p no:cacheprovider -W error "$@"\n',
}


def make_environment(folder: Path, source: Path | None = None) -> None:
    """Make a fresh environment in ``folder``: pip installs local folders, nothing from the network.

    Modules of ``source`` are imported from there, as after an editable install. An editable install by pip is a copy,
    because pip would have to fetch a package for it.
    """
    venv.create(folder, with_pip=False, symlinks=True)
    packages = next((folder / "lib").glob("python*")) / "site-packages"
    installed = [path for path in sys.path if path.endswith("-packages")] + site.getsitepackages()
    lines = [f"import site; site.addsitedir({path!r})" for path in dict.fromkeys(installed)]
    (packages / "installed.pth").write_text("\n".join([*([] if source is None else [str(source)]), *lines]) + "\n")
    for name, text in _SCRIPTS.items():
        (folder / "bin" / name).write_text(text.format(python=folder / "bin" / "python"))
        (folder / "bin" / name).chmod(0o755)
