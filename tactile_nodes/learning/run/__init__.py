"""Training runs on disk: folders, checkpoints, comparisons."""
