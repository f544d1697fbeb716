"""Why a step cannot stand as it is."""


class NotConverged(Exception):
    """Newton's iteration failed; the message holds reason and place."""


class Inadmissible(NotConverged):
    """It ended, but what it found cannot be: what passed through something else, a negative volume."""
