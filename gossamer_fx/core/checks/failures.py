"""Reasons to reject a step."""


class NotConverged(Exception):
    """Newton's iteration failed; the message holds PETSc's reason and where the residual is
    largest."""


class Inadmissible(NotConverged):
    """Newton's iteration converged to an inadmissible state: interpenetration, a negative
    volume."""
