"""The one drive through a sequence: filters and smoothers over frames, what is kept of them, checkpoints and results."""
