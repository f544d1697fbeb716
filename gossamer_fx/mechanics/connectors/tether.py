"""Tethers that a reel pays out."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import KW_ONLY, dataclass

from gossamer_fx.core.checks.arguments import check_arguments
from gossamer_fx.core.checks.errors import InputError, check, check_positive
from gossamer_fx.core.checks.user_functions import ask_numbers
from gossamer_fx.core.model.body import Attached, Port
from gossamer_fx.core.model.state import State
from gossamer_fx.core.model.terms import Term
from gossamer_fx.mechanics.bodies.between import Between
from gossamer_fx.mechanics.connectors.paid_out_ropes import PaidOutRope
from gossamer_fx.mechanics.connectors.spring import half_distance_squared


@check_arguments
@dataclass(frozen=True, eq=False)
class Tether(Between):
    """A rope without mass from a reel at one of two points: tension k (l - L) beyond its length L,
    else none.

    Either L is a function of time, and the work of the reel counts as supplied (negative while it
    pays out under tension), or a brake holds the reel and slips where the tension would exceed B:
    the loss B ΔL counts as dissipated.  A brake torque M on a reel of radius r is B = M/r.  Energy
    closes exactly; momentum and angular momentum are kept.

    Args:
        a, b: ports of bodies; one of them may be a `Ground`.
        stiffness: k [N/m] at every length, positive.
        length: L [m], a positive number with a `brake_force`, else a function of time [s].
        brake_force: B [N], positive; None: no brake.
        total_length: [m] that a braked reel has in all; default: without end.
        name: name in messages and output.

    Raises:
        InputError: a length that is not positive, a brake in addition to a function, a number
            without a brake.

    Example:
        >>> reel = hub.port((0.0, 0.0, 0.1))
        >>> braked = gx.connectors.Tether(
        ...     reel, mass.port(), stiffness=1e3, length=1.1, brake_force=2.0, total_length=5.0
        ... )
        >>> driven = gx.connectors.Tether(
        ...     reel, mass.port(), stiffness=1e3, length=lambda t: 1.1 + 0.2 * t, name="winch"
        ... )
    """

    a: Attached
    b: Attached
    _: KW_ONLY
    stiffness: float
    length: float | Callable[[float], float]
    brake_force: float | None = None
    total_length: float = math.inf
    name: str = "tether"

    def __post_init__(self) -> None:
        """Check ends, stiffness [N/m], length [m], brake force [N] and total length [m] of the
        tether.

        Raises:
            InputError: both ends are of the ground, a number is not positive, a length that is a
                number has no brake, one that is a function has a brake, or the total length is
                below the length.
        """
        super().__post_init__()
        check_positive(self, "stiffness", "N/m")
        if callable(self.length):
            check(
                self.brake_force is None,
                f"Tether '{self.name}': its length is given as a function; leave the brake out.",
            )
            return
        check_positive(self, "length", "m")
        check(
            self.brake_force is not None,
            f"Tether '{self.name}': its length is a number; give a brake, or a function of time, "
            "or take a Rope.",
        )
        check_positive(self, "brake_force", "N")
        check(
            self.total_length >= self.length,
            f"Tether '{self.name}': total_length is {self.total_length!r} m; give "
            f"{self.length:g} m or more.",
        )

    @property
    def lines_to_draw(self) -> Sequence[tuple[Attached, Attached]]:
        """The two ends of the line, for pictures."""
        return [(self.a, self.b)]

    def terms(self, start: State) -> Iterable[Term]:
        """The rope on its reel, with a given length or a brake: what it adds to the equations.

        Raises:
            InputError: on all ranks, if the function does not return a positive length at t = 0 (or
                later, in the run).
        """
        measure = half_distance_squared(self.a, self.b)
        given = self.length
        if not callable(given):
            # `__post_init__` refuses a number without a brake.
            assert self.brake_force is not None
            yield PaidOutRope(
                name=self.name,
                measure=measure,
                stiffness=self.stiffness,
                length=given,
                history=None,
                brake=self.brake_force,
                total_length=self.total_length,
            )
            return
        # One of the ends is a port: `Between` refuses two points of the ground.
        comm = next(port.body.comm for port in (self.a, self.b) if isinstance(port, Port))

        def history(t: float) -> float:
            """Length L [m] at a time t [s]; the same on every rank, and positive."""
            what = f"Length of '{self.name}' at t = {t:.6g} s"
            length = float(ask_numbers(comm, what, lambda: given(t)))
            if length <= 0:
                raise InputError(f"{what} is {length:g} m; give a function that is positive.")
            return length

        yield PaidOutRope(self.name, measure, self.stiffness, history(0.0), history)
