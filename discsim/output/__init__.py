"""What a run leaves: snapshots, history, checkpoints, figures."""
