"""Probes: functions of a run that return one number."""
