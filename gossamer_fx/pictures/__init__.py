"""Pictures of a run, or of its folder: without a screen, and without gathering fields on one rank."""
