"""Constraints: supports, prescribed motion, ties, rigid regions and joints."""
