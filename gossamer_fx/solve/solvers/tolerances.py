"""Tolerances of Newton's iteration."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass

from gossamer_fx.core.checks.arguments import check_arguments
from gossamer_fx.core.checks.errors import check


@check_arguments
@dataclass(frozen=True)
class Tolerances:
    """When the equations of a step count as solved; `solvers.convergence` has the complete test.

    Args:
        relative: norm of the residual over that of the first guess of the step.
        absolute: residuals below this count as zero [N], whatever their ratio.
        floor: residuals below this number of units in the last place of the forces that cancel in
            them count as zero; four times as many if the residual no longer falls.
        energy: work of the residual in a step, which is the error of the total energy, over the
            largest energy so far; asked while the residual still falls.
        scalars: largest relative residual of the equations of scalar unknowns, such as gas
            pressures.
        constraint: largest violation of a constraint between points, in the units of the constraint
            (m, or 1 for directions).
        max_iterations: number of Newton iterations after which the step has failed.

    The tolerances are those of one step.  What steps leave below them may add up, as all may miss
    to the same side: a free rigid body closes its energy to 2e-12 in 400 steps of 26 ms, where two
    iterations just pass the test of the residual, and to 1e-15 with `relative` 1e-12
    (`tests/bodies/test_multibody_motion.py`).

    Raises:
        InputError: a tolerance is negative, or one that has to be below 1 is not, or no iteration
            is allowed.

    Example:
        >>> stepper = gx.Midpoint(dt=1e-3, tolerances=gx.Tolerances(relative=1e-12))
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
        """Refuse tolerances that are negative, or that the first guess would meet.

        Raises:
            InputError: a tolerance is negative, `relative`, `energy` or `scalars` is not below 1,
                or `max_iterations` is below 1.
        """
        for name in ("relative", "absolute", "floor", "energy", "scalars", "constraint"):
            value = getattr(self, name)
            check(value >= 0, f"Tolerances: {name} is {value!r}; give zero or a positive number.")
        # With a fraction of 1 or more, the first guess would already count as solved.
        for name in ("relative", "energy", "scalars"):
            value = getattr(self, name)
            check(value < 1, f"Tolerances: {name} is {value!r}; give a number below 1.")
        check(
            self.max_iterations >= 1,
            f"Tolerances: max_iterations is {self.max_iterations!r}; give a number of at least "
            "one.",
        )
