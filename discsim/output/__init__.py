"""Output of a run: snapshots, history, checkpoints and figures."""
