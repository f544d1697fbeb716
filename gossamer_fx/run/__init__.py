"""The loop over steps: events, signals, checkpoints."""
