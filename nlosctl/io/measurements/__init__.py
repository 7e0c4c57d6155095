"""From a reader to chunks of whole snapshots, every row checked."""
