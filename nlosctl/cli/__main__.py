"""The entry of the program: an interrupt is met in one line even while the rest is being imported."""

from __future__ import annotations

import os
import sys

__all__ = ["main"]

_THREADS_OF_LIBRARIES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
"""Held to one unless the user says otherwise: ``--jobs`` is what uses the cores, and threads of threads slow it."""


def main() -> int:
    """Run the program and return its exit code.

    Once interrupted and tidied up it leaves at once: threads of the libraries may still wait for an input that never
    ends, and the interpreter would wait for them.
    """
    for variable in _THREADS_OF_LIBRARIES:
        os.environ.setdefault(variable, "1")
    try:
        from nlosctl.cli.main import run

        code = run()
    except KeyboardInterrupt as stop:
        if sys.stderr is not None:
            sys.stderr.write("nlosctl: interrupted\n")
        code = 128 + getattr(stop, "number", 2)
    if code > 128:
        if sys.stderr is not None:
            sys.stderr.flush()
        os._exit(code)
    return code


if __name__ == "__main__":
    sys.exit(main())
