"""Masses at points of bodies."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import KW_ONLY, dataclass
from typing import Any

import numpy as np

from gossamer_fx.core.algebra.point_measures import translation_weight
from gossamer_fx.core.checks.arguments import check_arguments
from gossamer_fx.core.checks.errors import check, check_positive
from gossamer_fx.core.model.body import Port
from gossamer_fx.core.model.state import State
from gossamer_fx.core.model.terms import Term
from gossamer_fx.mechanics.terms.point_energies import AttachedKineticEnergy


@check_arguments
@dataclass(frozen=True, eq=False)
class AttachedMass:
    """A mass at a point of a body, e.g. at the tip of a sail: kinetic energy ½ m |v|² of the point.

    It adds no unknowns.  `Gravity` and `Centrifugal` of the body act on it, too.

    Args:
        port: a point of a film, plate, cable, beam or rigid body.
        mass: m [kg], positive.
        name: name in messages and output.

    Raises:
        InputError: a port that is a direction, a mass that is not positive.

    Example:
        >>> gx.connectors.AttachedMass(film.port("top right"), 0.5).mass
        0.5
    """

    port: Port
    mass: float
    _: KW_ONLY
    name: str = "attached mass"

    def __post_init__(self) -> None:
        """Check the arguments, which the class describes; raises `InputError`."""
        # The weights of a direction add up to zero: it would have no mass in translation.
        check(
            bool(np.isclose(translation_weight(self.port), 1.0)),
            f"AttachedMass '{self.name}': its port is not a point of a body; give one, as "
            "film.port('tip').",
        )
        check_positive(self, "mass", "kg")

    def requires(self) -> Iterable[Any]:
        yield self.port.body

    def terms(self, start: State) -> Iterable[Term]:
        yield AttachedKineticEnergy([(self.port,)], np.full((1, 1, 1), self.mass))
