"""Entry point of the program: an interrupt is reported in one line even during the imports."""

from __future__ import annotations

import os
import sys

__all__ = ["main"]

_THREADS_OF_LIBRARIES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
"""Set to 1 by default: ``--jobs`` uses the cores, and more threads in each worker would slow it down."""


def main() -> int:
    """Run the program and return its exit code.

    After an interrupt and its clean-up the process exits immediately: threads of the libraries may be blocked on an
    input that never ends, and the interpreter would wait for them.
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
