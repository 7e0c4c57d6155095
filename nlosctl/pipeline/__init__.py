"""From flat files to dense batches and back: streams of snapshots, blocks, workers, the run report."""
