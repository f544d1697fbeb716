"""Tethers: ropes whose length changes in a step, along a given history or against the friction of a
brake.

With the distance l of the ends and the natural length L the stretch is y = l - L, the stored energy
½ k y² for y > 0. In a step from (l0, L0) to (l1, L1) the mean tension T_mean is the average of T(y)
over y0 ≤ y ≤ y1, so that exactly

    given L(t)   y1 = l1 - L1, T = k y     T_mean Δl = Δψ + T_mean ΔL   the reel supplies -T_mean ΔL
    brake B      y1 = l1 - L0, T ≤ B       T_mean Δl = Δψ + B ΔL        the brake dissipates B ΔL

with ΔL = max(y1 - B/k, 0).  In both cases T_mean is the derivative of a convex potential of l1.  At
the length `total_length` the reel is empty: the rope pays out no more, and T may exceed B.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Annotated, Any

from gossamer_fx.core.checks.arguments import check_arguments, not_negative
from gossamer_fx.core.checks.errors import InputError, check, check_positive
from gossamer_fx.core.checks.relations import exactly_one, rising
from gossamer_fx.core.checks.user_functions import ask_numbers
from gossamer_fx.core.laws.tracing import Number
from gossamer_fx.core.model.body import Port
from gossamer_fx.core.model.state import State
from gossamer_fx.core.model.terms import Parameter, Term
from gossamer_fx.mechanics.bodies.frames import LineBetween
from gossamer_fx.mechanics.connectors.spring import (
    LENGTH,
    STIFFNESS,
    Stiffness,
    half_distance_squared,
    length_of,
    natural_length,
)
from gossamer_fx.mechanics.terms.rows import Response, Rows, one_sided_average, positive_part

BRAKE = Parameter("brake_force", "N", "brake")

# [m] A reel that never gets empty
ENDLESS = 1e100


def driven_rope(e0: Any, e1: Any, z0: Any, h: Number, numbers: Any) -> Response:
    """A rope whose length is L0 at the start and L1 at the end of a step."""
    l0 = length_of(e0[0])
    l1 = length_of(e1[0])
    y1 = l1 - numbers.L1
    tension = numbers.k * one_sided_average(l0 - numbers.L0, y1)
    return Response(
        [tension / ((l0 + l1) / 2)],
        energy=numbers.k * positive_part(y1) ** 2 / 2,
        supplied=-tension * (numbers.L1 - numbers.L0),
    )


def braked_rope(e0: Any, e1: Any, z0: Any, h: Number, numbers: Any) -> Response:
    """A rope whose reel slips at the brake force; its history is the length L that is out.

    Its tension is k y up to the stretch at which the brake slips, the brake force as long as rope
    remains on the reel, and rises again behind that.
    """
    k = numbers.k
    [L] = z0
    l0 = length_of(e0[0])
    l1 = length_of(e1[0])
    y0 = l0 - L
    y1 = l1 - L
    slips_from = numbers.brake / k
    slips_to = slips_from + positive_part(numbers.total_length - L)

    def slip(y: Number) -> Number:
        """Length [m] that is let out up to a stretch."""
        return positive_part(y - slips_from) - positive_part(y - slips_to)

    # The tension changes its slope at three stretches, and is averaged exactly.
    stretch = one_sided_average(y0, y1)
    stretch = stretch - one_sided_average(y0 - slips_from, y1 - slips_from)
    stretch = stretch + one_sided_average(y0 - slips_to, y1 - slips_to)
    return Response(
        [k * stretch / ((l0 + l1) / 2)],
        energy=k * positive_part(y1 - slip(y1)) ** 2 / 2,
        loss=numbers.brake * (slip(y1) - slip(y0)),
        history=[L + slip(y1)],
    )


@check_arguments(
    exactly_one("length", "initial_tension"),
    rising("initial_tension", "brake_force", give="a brake_force at which it does not slip"),
)
@dataclass(frozen=True, eq=False, kw_only=True)
class Tether(LineBetween):
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
        initial_tension: of a braked rope in place of its length, the tension [N] in the shape in
            which the scene starts, up to the brake force.
        brake_force: B [N], positive; None: no brake.
        total_length: [m] that a braked reel has in all; default: without end.
        name: name in messages and output.

    Raises:
        InputError: a length that is not positive, a brake or a tension in addition to a function,
            a number without a brake, a tension beyond the brake force; when the scene is compiled:
            a tension that needs a length below zero.

    Example:
        >>> reel = hub.port((0.0, 0.0, 0.1))
        >>> braked = gx.connectors.Tether(
        ...     reel, mass.port(), stiffness=1e3, length=1.1, brake_force=2.0, total_length=5.0
        ... )
        >>> driven = gx.connectors.Tether(
        ...     reel, mass.port(), stiffness=1e3, length=lambda t: 1.1 + 0.2 * t, name="winch"
        ... )
    """

    stiffness: Stiffness
    length: float | Callable[[float], float] | None = None
    initial_tension: Annotated[float, not_negative("N")] | None = None
    brake_force: float | None = None
    total_length: float = math.inf
    name: str = "tether"

    def __post_init__(self) -> None:
        super().__post_init__()
        if callable(self.length):
            check(
                self.brake_force is None,
                f"Tether '{self.name}': its length is given as a function; leave the brake out.",
            )
            return
        check(
            self.brake_force is not None,
            f"Tether '{self.name}': its length does not follow a function of time; give a brake, "
            "or a function, or take a Rope.",
        )
        check_positive(self, "brake_force", "N")
        assert self.brake_force is not None
        if self.length is not None:
            check_positive(self, "length", "m")
            self._check_reel(self.length)

    def _check_reel(self, length: float) -> None:
        """Raise `InputError` unless a reel has the length [m] that is out at the start."""
        check(
            self.total_length >= length,
            f"Tether '{self.name}': total_length is {self.total_length!r} m; "
            f"give {length:g} m or more.",
        )

    def terms(self, start: State) -> Iterable[Term]:
        measure = half_distance_squared(self.a, self.b)
        given = self.length
        if not callable(given):
            # `__post_init__` refuses a number without a brake.
            assert self.brake_force is not None
            if given is None:
                assert self.initial_tension is not None
                given = natural_length(
                    f"Tether '{self.name}'",
                    self.a,
                    self.b,
                    stiffness=self.stiffness,
                    tension=self.initial_tension,
                    start=start,
                )
                self._check_reel(given)
            yield Rows(
                self.name,
                measure,
                braked_rope,
                {
                    "k": self.stiffness,
                    "brake": self.brake_force,
                    "total_length": min(self.total_length, ENDLESS),
                },
                parameters=(STIFFNESS, LENGTH, BRAKE),
                variables={"L": given},
                needs_both_ends=True,
            )
            return
        # One of the ends is a port: `Between` refuses two points of the ground.
        comm = next(port.body.comm for port in (self.a, self.b) if isinstance(port, Port))

        def course(t: float) -> float:
            """Length L [m] at a time t [s]; the same on every rank, and positive."""
            what = f"Length of '{self.name}' at t = {t:.6g} s"
            length = float(ask_numbers(comm, what, lambda: given(t)))
            if length <= 0:
                raise InputError(f"{what} is {length:g} m; give a function that is positive.")
            return length

        numbers = {"k": self.stiffness}
        yield Rows(self.name, measure, driven_rope, numbers, (STIFFNESS,), driven={"L": course})
