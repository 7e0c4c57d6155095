"""``python -m nlosctl`` works like the command ``nlosctl``."""

import sys

from nlosctl.cli.__main__ import main

if __name__ == "__main__":
    sys.exit(main())
