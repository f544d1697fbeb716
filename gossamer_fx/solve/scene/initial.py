"""Initial conditions of a whole scene: a rigid motion, or a state that was computed before."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass

import numpy as np

from gossamer_fx.core.checks.arguments import check_arguments
from gossamer_fx.core.checks.errors import check, is_vector
from gossamer_fx.core.model.body import Array, Vector, is_on_mesh
from gossamer_fx.core.model.state import BodyState, InitialState
from gossamer_fx.mechanics.terms.assembly import Assembly


@check_arguments
@dataclass(frozen=True, eq=False)
class RigidMotion:
    """Adds a rigid motion to the initial velocities of all bodies: v + Ω × (x - c), and Ω × d for
    directors.

    Args:
        spin: Ω [rad/s].
        velocity: v [m/s].
        centre: c [m].

    Raises:
        InputError: an argument that is not three finite numbers.

    Example:
        >>> spinning = gx.Scene(hub, gx.RigidMotion(spin=(0.0, 0.0, 2.0)))
        >>> run = gx.Simulation(spinning, gx.Midpoint(dt=0.01))
        >>> round(gx.probes.AngularVelocity(hub.frame(), "z")(run), 12)
        2.0
    """

    spin: Vector = (0.0, 0.0, 0.0)
    velocity: Vector = (0.0, 0.0, 0.0)
    _: KW_ONLY
    centre: Vector = (0.0, 0.0, 0.0)
    name: str = "rigid motion"

    def __post_init__(self) -> None:
        for argument in ("spin", "velocity", "centre"):
            value = getattr(self, argument)
            check(
                is_vector(value),
                f"RigidMotion '{self.name}': {argument} is {value!r}; give three finite numbers.",
            )

    def initialise(self, start: InitialState) -> None:
        spin = np.asarray(self.spin, dtype=float)
        # v + Ω × (x - c) = Ω × x + (v - Ω × c); directors have the first part only.
        at_origin = np.asarray(self.velocity, dtype=float) - np.cross(spin, self.centre)
        for body in start:
            rates = body.rates() + np.cross(spin, body.coordinates())
            rates[:, 0] += at_origin
            start.set_in_motion(body.body, rates)


@check_arguments
@dataclass(frozen=True, eq=False)
class StartFrom:
    """Takes the initial positions and directors from another compiled scene of the same bodies.

    The other scene is, for example, that of an equilibrium.  A reduced film also starts from its
    full one: from the part of that shape which its modes hold.

    Args:
        system: the other scene's system, e.g. `equilibrium.system`.

    Raises:
        InputError: something that is not a compiled scene; when the scene is compiled, a body that
            the other scene does not have, or has with another mesh.

    Example:
        >>> weight = gx.Gravity(mass, (0.0, 0.0, -10.0))
        >>> top = gx.Ground((0.0, 0.0, 0.0))
        >>> spring = gx.connectors.Spring(mass.port(), top, stiffness=100.0, length=1.0)
        >>> equilibrium = gx.Equilibrium(gx.Scene(weight, spring))
        >>> result = equilibrium.find()
        >>> start = gx.StartFrom(equilibrium.system)
        >>> swing = gx.Simulation(gx.Scene(weight, spring, start), gx.Midpoint(dt=0.01))
        >>> round(gx.probes.Position(mass.port(), "z")(swing), 3)
        -1.1
    """

    system: Assembly
    _: KW_ONLY
    name: str = "start"

    def initialise(self, start: InitialState) -> None:
        for body in start:
            start.place(body.body, self._coordinates(body))

    def _coordinates(self, here: BodyState) -> Array:
        """Positions [m] and directors of this rank's nodes of the body of the same name in the
        other scene, flattened; of a reduced film the coefficients [m] of its modes, projected from
        a full film."""
        body = here.body
        there = self.system.state.named(body.name)
        full = body.full if is_on_mesh(body) else body
        # Only a reduced film differs from its full one.
        from_full = full is not body and there is not None and there.body is full
        check(
            there is not None and (from_full or there.body.block.size == body.block.size),
            f"'{self.name}' has no body '{body.name}' like this scene's; "
            "start from the same bodies.",
        )
        assert there is not None
        values = there.coordinates().ravel()
        if from_full:
            values = body.reduced(values)  # type: ignore[attr-defined]
        check(
            len(values) == here.coordinates().size,
            f"'{body.name}' has other nodes in '{self.name}'; use the same mesh.",
        )
        return values
