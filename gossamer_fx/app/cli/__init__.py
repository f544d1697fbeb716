"""Scene files and the command line."""
