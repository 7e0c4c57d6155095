"""The jobs of the command line and of ``import nlosctl``: from inputs to complete outputs, or to none."""
