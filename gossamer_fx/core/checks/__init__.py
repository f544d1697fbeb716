"""Errors, checks that raise them in one sentence, how a program ends, and lazy public names."""
