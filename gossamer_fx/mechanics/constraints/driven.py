"""Rigid bodies that a motor turns."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import KW_ONLY, dataclass
from typing import Any

import numpy as np

from gossamer_fx.core.algebra.rotations import rotations
from gossamer_fx.core.checks.arguments import check_arguments
from gossamer_fx.core.checks.errors import check
from gossamer_fx.core.checks.user_functions import ask_numbers
from gossamer_fx.core.model.body import Array, Vector, unit
from gossamer_fx.core.model.state import State
from gossamer_fx.core.model.terms import Term
from gossamer_fx.mechanics.bodies.rigid_body import RigidBody
from gossamer_fx.mechanics.terms.supports import Support


@check_arguments
@dataclass(frozen=True, eq=False)
class Driven:
    """A rigid body whose position is fixed and that turns about an axis as prescribed, as a hub on
    a motor.

    The directors are d(t) = R(axis, angle(t)) d(0); the work of the motor counts as supplied.  The
    scene gives the body the rate at which the angle begins, e.g. by `RigidMotion`: a difference
    stays, as of `Fixed` with a motion.

    Args:
        body: what turns.
        axis: direction in space through its centre of mass, of any length.
        angle: [rad] as a function of time [s], zero at the start.
        name: name in messages and output.

    Raises:
        InputError: an axis of length zero; during a run: an angle that is not finite.

    Example:
        >>> gx.constraints.Driven(hub, (0.0, 0.0, 1.0), angle=lambda t: 5.0 * t).name
        'motor'
    """

    body: RigidBody
    axis: Vector
    _: KW_ONLY
    angle: Callable[[float], float]
    name: str = "motor"

    def __post_init__(self) -> None:
        """Check the arguments, which the class describes; raises `InputError`."""
        check(
            any(self.axis),
            f"Driven '{self.name}': axis is {self.axis!r}; give three numbers, not all zero.",
        )

    def requires(self) -> Iterable[Any]:
        yield self.body

    def terms(self, start: State) -> Iterable[Term]:
        """The support that fixes the body's position and turns its axes with time.

        A support eliminates coordinates from the equations.

        Raises, in the run:
            InputError: the user's function does not return a finite angle [rad], the same on all
                ranks.
        """
        body = self.body
        axis = unit(self.axis)
        first = start[body].coordinates().copy()

        def path(t: float) -> Array:
            """Coordinates of the body on this rank at a time t [s]."""
            source = f"Angle of '{self.name}' at t = {t:.6g} s"
            angle = ask_numbers(body.comm, source, lambda: self.angle(t))
            # From the first state, not from the last step: errors do not add up.
            turned = first.copy()
            turned[:, 1:] = first[:, 1:] @ rotations(axis, float(angle)).T
            return turned.ravel()

        yield Support(self.name, body, np.arange(first.size, dtype=np.int32), path)
