"""Errors, and the checks that raise them in one sentence."""
