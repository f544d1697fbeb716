"""Running a scene: steps and their control, events, signals, checkpoints, the log."""
