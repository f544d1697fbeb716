"""When a step counts as solved."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass

from gossamer_fx.checks.arguments import check_arguments
from gossamer_fx.checks.errors import check


@check_arguments
@dataclass(frozen=True)
class Tolerances:
    """When a step counts as solved.

    `relative`: field residual over that of the predictor; residuals below `absolute` [N] count as zero, whatever
    their ratio.  So do those below `floor` units in the last place of the forces, diag(K) q and the inertia (K is the
    tangent without inertia), and below four times as much if they no longer fall.  `energy`: work of the residual in a
    step, by which the energy of the whole is off, over the largest energy so far; asked while the residual falls.
    `scalars`: largest fraction in the border equations.
    `constraint`: largest violation of a constraint between points, in its own units (m, or 1 for directions).
    """

    relative: float = 1e-10
    absolute: float = 0.0
    _: KW_ONLY
    floor: float = 4.0
    energy: float = 1e-12
    scalars: float = 1e-12
    constraint: float = 1e-12
    max_iterations: int = 40

    def __post_init__(self) -> None:
        for name in ("relative", "absolute", "floor", "energy", "scalars", "constraint"):
            value = getattr(self, name)
            check(value >= 0, f"Tolerances: {name} is {value!r}; give zero or a positive number.")
        for name in ("relative", "energy", "scalars"):
            value = getattr(self, name)
            check(
                value < 1,
                f"Tolerances: {name} is {value!r}, which any state meets; give a number below 1.",
            )
        check(
            self.max_iterations >= 1,
            f"Tolerances: max_iterations is {self.max_iterations!r}; allow at least one.",
        )
