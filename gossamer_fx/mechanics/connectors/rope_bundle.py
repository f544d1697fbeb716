"""Ropes of one kind as one part: the tethers or shrouds of a sail."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import KW_ONLY, dataclass
from typing import Any

from gossamer_fx.core.checks.arguments import check_arguments
from gossamer_fx.core.checks.errors import check, check_positive, require_positive
from gossamer_fx.core.model.body import Attached
from gossamer_fx.core.model.parameters import Parameter
from gossamer_fx.core.model.state import State
from gossamer_fx.core.model.terms import Term
from gossamer_fx.mechanics.bodies.between import bodies_of
from gossamer_fx.mechanics.connectors.spring import (
    STIFFNESS,
    LengthSpring,
    RopeDamper,
    half_distance_squared,
)
from gossamer_fx.mechanics.terms.point_energies import PointDissipation, PointStoredEnergy


@check_arguments
@dataclass(frozen=True, eq=False)
class RopeBundle:
    """Ropes without mass, each as a `Rope`, that are evaluated at once and have one line in the
    ledger.

    Args:
        ends: pairs of ports, or of a port and a `Ground`.
        stiffness: k of each [N/m], positive.
        lengths: L of each [m], positive; as many as pairs.
        damping: c of each [N s/m], which acts where the rope is stretched; zero or positive.
        name: name in messages and output.

    Raises:
        InputError: no rope, not as many lengths as pairs, a number that is not positive, a pair
            without a body.

    Example:
        >>> corners = [film.port("top left"), film.port("top right")]
        >>> ends = [(corner, gx.Ground((0.5, 2.0, 0.0))) for corner in corners]
        >>> ropes = gx.connectors.RopeBundle(ends, stiffness=1e3, lengths=[1.2, 1.2])
        >>> ropes.lengths
        [1.2, 1.2]
    """

    ends: Sequence[tuple[Attached, Attached]]
    _: KW_ONLY
    stiffness: float
    lengths: Sequence[float]
    damping: float = 0.0
    name: str = "ropes"

    def __post_init__(self) -> None:
        """Check the ends, the lengths [m], the stiffness [N/m] and the damping [N s/m] of the
        ropes.

        Raises:
            InputError: there is no rope, not one length for each pair of ends, a pair without a
                body, a length or stiffness that is not positive, or a negative damping.
        """
        check(
            bool(len(self.ends)) and len(self.ends) == len(self.lengths),
            f"RopeBundle '{self.name}' has {len(self.ends)} pairs and {len(self.lengths)} lengths; "
            "give as many of "
            "both, and at least one.",
        )
        for k, (pair, length) in enumerate(zip(self.ends, self.lengths, strict=True)):
            check(
                bool(list(bodies_of(*pair))),
                f"RopeBundle '{self.name}': rope {k} joins the ground to itself; give a port of a "
                "body.",
            )
            require_positive(f"RopeBundle '{self.name}': length {k}", length, "m")
        check_positive(self, "stiffness", "N/m")
        check(
            math.isfinite(self.damping) and self.damping >= 0,
            f"RopeBundle '{self.name}': damping is {self.damping!r} N s/m; give none or a positive "
            "one.",
        )

    def requires(self) -> Iterable[Any]:
        for pair in self.ends:
            yield from bodies_of(*pair)

    @property
    def lines_to_draw(self) -> Sequence[tuple[Attached, Attached]]:
        """The two ends of each rope, for pictures."""
        return self.ends

    def terms(self, start: State) -> Iterable[Term]:
        """Stored energy and, with damping, dissipation of each rope.

        Yields:
            The terms, i.e. what the ropes add to the equations; all have the same name, under which
            the ledger sums them.
        """
        # Terms of one name are summed in the energy balance; those of one kind are one array.
        for k, (pair, length) in enumerate(zip(self.ends, self.lengths, strict=True)):
            measure = half_distance_squared(*pair)
            density = LengthSpring(self.stiffness, float(length), side=1)
            numbers = (STIFFNESS, Parameter("lengths", "m", "L", entry=k))
            yield PointStoredEnergy(self.name, measure, density, numbers)
            if self.damping:
                loss = RopeDamper(self.damping, self.stiffness, float(length))
                of_loss = (*numbers, Parameter("damping", "N s/m", "c"))
                yield PointDissipation(f"{self.name} damping", measure, loss, of_loss)
