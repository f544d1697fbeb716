"""The command, and the runs of many cases."""
