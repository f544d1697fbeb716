"""Gradients of results with respect to parameters: the public entry."""

from __future__ import annotations

from collections.abc import Sequence

from gossamer_fx.analysis.sensitivity.objectives import Objective
from gossamer_fx.analysis.sensitivity.results import Gradient
from gossamer_fx.analysis.sensitivity.static import StaticGradients
from gossamer_fx.analysis.sensitivity.tape import RunTape
from gossamer_fx.analysis.sensitivity.transient import TransientGradients
from gossamer_fx.analysis.statics.equilibrium import Equilibrium
from gossamer_fx.core.checks.arguments import check_arguments
from gossamer_fx.core.checks.errors import check


@check_arguments
def gradient(source: Equilibrium | RunTape, *, of: Objective, by: Sequence[str]) -> Gradient:
    """The exact gradient of a result with respect to any number of parameters.

    Of an equilibrium it takes one solve with the transposed tangent, Kᵀ λ = ∂J/∂q, and
    dJ/dθ = ∂J/∂θ - λ·∂r/∂θ for each parameter θ.  Of a run it takes one such solve for each step of
    its `RunTape`, from the last to the first.  The lengths of the steps count as given.

    Parameters are named "item.parameter".  They are numbers and fields of the laws of films and
    cables (E, nu, thickness, density, EA, ...), "shape", the stress-free places of the nodes of a
    mesh, constant loads (pressure, force, g), stiffness and length of springs and ropes, stiffness
    and rest angle of creases and torsion springs.  Fixed coordinates do not move when the
    stress-free shape changes. Of a run, "body.initial_position" and "body.initial_velocity" are
    parameters, too; so are the gains of attitude control, and friction and stiffness of contact.
    Friction and yielding are piecewise smooth: the gradient is that of what slips in this run, as
    `Gradient.notes` says. Of gas they are pressure, temperature and volume of chambers and tanks at
    the start of the tape ("tank.pressure", "tank.volume", "bag.dead_volume"), area and
    discharge_coefficient of orifices, conductance and temperature of walls (coefficient of
    `FilmHeat`), pressure and temperature of reservoirs and surroundings.

    In a run the derivative of fluttering or touching films grows exponentially, as the distance of
    neighbouring motions does.  A warning tells for how long it predicts finite changes.

    Args:
        source: an equilibrium that was found, or the tape of a run that stands at its last step.
        of: a probe with derivatives (`probes.Position`, `probes.Displacement`, `probes.Velocity`),
            an `Integral`, an `EnclosedVolume`, the `Energy`, or a `Functional`; of a run, at its
            end.
        by: names of the parameters.

    Raises:
        InputError: no equilibrium was found, a parameter that the scene has not, a part of the
            scene that has no gradient, or a singular tangent.
        StepFailure: a step of the run cannot be repeated.

    Example:
        >>> weight = gx.Gravity(mass, (0.0, 0.0, -10.0))
        >>> top = gx.Ground((0.0, 0.0, 0.0))
        >>> spring = gx.connectors.Spring(mass.port(), top, stiffness=100.0, length=1.0)
        >>> equilibrium = gx.Equilibrium(gx.Scene(weight, spring))
        >>> result = equilibrium.find()
        >>> height = gx.probes.Position(mass.port(), "z")
        >>> found = gx.analysis.gradient(equilibrium, of=height, by=["spring.length"])
        >>> found["spring.length"].values.round(6), found["spring.length"].unit
        (array([-1.]), 'm/m')
    """
    check(
        isinstance(of, Objective),
        f"gradient: of is {of!r}, which has no derivative; give a Position, Integral, "
        "EnclosedVolume, Energy or Functional.",
    )
    if isinstance(source, RunTape):
        return TransientGradients(source, by).of(of)
    gradients = StaticGradients(source, by)
    gradients.factorise()
    return gradients.of(of)
