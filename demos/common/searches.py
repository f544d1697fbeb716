"""What several searches for equilibria have needed together."""

from __future__ import annotations

from dataclasses import dataclass

import gossamer_fx as gx


@dataclass
class Effort:
    """Newton iterations and CPU time [s] of several searches, and the largest unbalanced force that
    one of them left."""

    iterations: int = 0
    seconds: float = 0.0
    residual: float = 0.0

    def add(self, found: gx.analysis.EquilibriumResult) -> gx.analysis.EquilibriumResult:
        """Count a search; returns its result."""
        self.iterations += found.iterations
        self.seconds += found.seconds
        self.residual = max(self.residual, found.residual)
        return found
