"""What a run leaves: fields, probes, files, checkpoints, pictures and reports."""
