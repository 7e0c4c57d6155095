"""The jobs of the command line and of ``import nlosctl``: each goes from inputs to outputs, all or nothing."""
