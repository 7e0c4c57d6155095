"""What methods share: batched optimizers and the checks of a fix."""
