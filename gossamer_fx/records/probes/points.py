"""Probes of points, frames, joints, chambers and rings."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np
from petsc4py import PETSc

from gossamer_fx.core.algebra.point_measures import attach, is_evaluated_here
from gossamer_fx.core.checks.arguments import check_arguments
from gossamer_fx.core.checks.errors import check
from gossamer_fx.core.checks.lookups import check_in_scene
from gossamer_fx.core.model.body import Array, Port
from gossamer_fx.core.model.item import Item
from gossamer_fx.core.model.state import HasSystem
from gossamer_fx.mechanics.bodies.frames import Frame
from gossamer_fx.records.fields.reactions import GroundForce, Joint, joint_force
from gossamer_fx.records.probes.objective import ForceObjective, Objective
from gossamer_fx.solve.system.system import System
from gossamer_fx.solve.view import ForSystem, StateView, chamber_state

# The gas package is imported for its types only: most scenes with probes have no gas.
if TYPE_CHECKING:
    from gossamer_fx.mechanics.gas.contract import Opening, Volume
    from gossamer_fx.mechanics.gas.ring import Loop, Ring
    from gossamer_fx.records.fields.reaction_derivatives import ReactionDerivative

# Components of a vector by name
AxisName = Literal["x", "y", "z"]
AXES: dict[AxisName, int] = {"x": 0, "y": 1, "z": 2}

# Quantities of `GasState`; attributes of `gas.contract.ChamberState`
GasQuantity = Literal["pressure", "temperature", "volume", "mass"]
GAS: tuple[GasQuantity, ...] = get_args(GasQuantity)
GAS_UNITS: dict[GasQuantity, str] = {
    "pressure": "Pa",
    "temperature": "K",
    "volume": "m³",
    "mass": "kg",
}


@check_arguments
class Position(Objective):
    """Coordinate [m] of a point of a body.

    Args:
        port: the point.
        axis: "x", "y" or "z".

    Raises:
        InputError: the axis is unknown; when called, the body is not in the scene.

    Example:
        >>> height = gx.probes.Position(mass.port(), "z")
        >>> height(run)
        -1.0
    """

    def __init__(self, port: Port, axis: AxisName) -> None:
        self.port = port
        self.axis: AxisName = axis

    unit = "m"

    def __call__(self, run: StateView) -> float:
        """The coordinate [m] in the state of a run."""
        return float(run.system.unknowns.state.vector(self.port)[AXES[self.axis]])

    def add_derivative(
        self, system: System, by_position: PETSc.Vec, by_velocity: PETSc.Vec
    ) -> None:
        """Add the derivative of this probe by the coordinates to `by_position`, for
        `gx.analysis.gradient`."""
        self._add_weights(system, by_position)

    def add_initial_derivative(self, system: System, share: float, by_position: PETSc.Vec) -> None:
        """Add a share of the derivative of this probe by the coordinates at the start of the run,
        if it measures from there.  Collective."""

    def _add_weights(self, system: System, vector: PETSc.Vec) -> None:
        """Add the weights with which the port takes the coordinate from the unknowns of its
        body."""
        indices, weights, _ = attach(
            system.unknowns.numbering, system.unknowns.bodies, (self.port,)
        )
        if is_evaluated_here((self.port,)):
            row = weights[AXES[self.axis]]
            # One rank adds the weights, some of which may belong to unknowns of another.
            vector.setValues(indices, row, addv=PETSc.InsertMode.ADD_VALUES)
        vector.assemble()


@check_arguments
class Displacement(Position):
    """Component [m] of the displacement of a point from its initial position.

    Args:
        port: the point.
        axis: "x", "y" or "z".

    Raises:
        InputError: the axis is unknown; when called, the body is not in the scene.

    Example:
        >>> deflection = gx.probes.Displacement(mass.port(), "z")
        >>> deflection(run)
        0.0
    """

    def __call__(self, run: StateView) -> float:
        """The component [m] in the state of a run."""
        start = run.system.unknowns.initial.vector(self.port)
        return super().__call__(run) - float(start[AXES[self.axis]])

    def add_initial_derivative(self, system: System, share: float, by_position: PETSc.Vec) -> None:
        weights = system.unknowns.numbering.vector()
        self._add_weights(system, weights)
        by_position.axpy(-share, weights)
        weights.destroy()


@check_arguments
class Velocity(Position):
    """Component [m/s] of the velocity of a point.

    Args:
        port: the point.
        axis: "x", "y" or "z".

    Raises:
        InputError: the axis is unknown; when called, the body is not in the scene.

    Example:
        >>> speed = gx.probes.Velocity(mass.port(), "x")
        >>> speed(run)
        0.0
    """

    unit = "m/s"

    def __call__(self, run: StateView) -> float:
        """The component [m/s] in the state of a run."""
        return float(run.system.unknowns.state.rate(self.port)[AXES[self.axis]])

    def add_derivative(
        self, system: System, by_position: PETSc.Vec, by_velocity: PETSc.Vec
    ) -> None:
        """Add the derivative of this probe by the velocities to `by_velocity`, for
        `gx.analysis.gradient`."""
        self._add_weights(system, by_velocity)


@check_arguments
class GasState:
    """Quantity of the gas in a chamber: pressure [Pa], temperature [K], volume [m³] or mass [kg].

    Args:
        chamber: a chamber or tank.
        quantity: "pressure", "temperature", "volume" or "mass".

    Raises:
        InputError: the quantity is unknown; when called, the chamber is not in the scene.

    Example:
        >>> pressure = gx.probes.GasState(tank, "pressure")
        >>> pressure(run)
        200000.0
    """

    def __init__(self, chamber: Volume, quantity: GasQuantity) -> None:
        self.chamber = chamber
        self.quantity = quantity

    def __call__(self, run: StateView) -> float:
        """The quantity in the state of a run: pressure [Pa], temperature [K], volume [m³] or mass
        [kg].

        Raises:
            InputError: the chamber is not in the scene of the run.
        """
        return float(getattr(chamber_state(run.system, self.chamber.name), self.quantity))


@check_arguments
class GasFlow:
    """Mass flow [kg/s] of gas through an opening, from its end `a` to `b`: mean of the last step.

    Args:
        opening: an orifice of the scene.

    Raises:
        InputError: when called, the opening is not in the scene.

    Example:
        >>> vent = gx.Orifice(tank, gx.gas.Ambient(), area=1e-6)
        >>> flow = gx.probes.GasFlow(vent)
    """

    unit = "kg/s"

    def __init__(self, opening: Opening) -> None:
        self.opening = opening

    def __call__(self, run: HasSystem) -> float:
        """The flow [kg/s], which is what the balance of both ends counts in the last step."""
        flows = gas_flows(run.system)
        name = self.opening.name
        check_in_scene(f"'{name}'", name in flows)
        return flows[name]


def gas_flows(system: System) -> dict[str, float]:
    """Mass flows [kg/s] through all openings by name, means of the last step."""
    found: dict[str, float] = {}
    for scalars in system.equations.scalar_unknowns:
        found |= scalars.flows()
    return found


@check_arguments
class AngularVelocity:
    """Component [rad/s] of the angular velocity of a frame.

    With orthonormal directors d_i, ω = ½ Σ d_i × ḋ_i.

    Args:
        frame: of a body, not of the ground.
        axis: "x", "y" or "z".

    Raises:
        InputError: the frame is that of the ground, or the axis is unknown.

    Example:
        >>> spin = gx.probes.AngularVelocity(hub.frame(), "z")
        >>> spin(run)
        0.0
    """

    def __init__(self, frame: Frame, axis: AxisName) -> None:
        self.axis: AxisName = axis
        self._directors = [port for port in frame.directors if isinstance(port, Port)]
        check(
            len(self._directors) == len(frame.directors),
            "AngularVelocity: the ground does not turn; give the frame of a body.",
        )

    def __call__(self, run: StateView) -> float:
        """The component [rad/s] in the state of a run."""
        directors = run.system.unknowns.state.vectors(self._directors)
        rates = run.system.unknowns.state.rates(self._directors)
        # A beam's section has two directors; the sum needs the normal too.
        if len(directors) == 2:
            directors, rates = _with_normal(directors, rates)
        angular_velocity = np.cross(directors, rates).sum(axis=0) / 2
        return float(angular_velocity[AXES[self.axis]])


@check_arguments
class JointForce:
    """Component [N] of the force that a joint exerts on its second side `b`, in the last step.

    Args:
        joint: a joint of the scene.
        axis: "x", "y" or "z".

    Raises:
        InputError: the axis is unknown; when called, the joint is not in the scene.

    Example:
        >>> hinge = gx.constraints.BallJoint(hub.port((0.0, 0.0, 0.0)), mass.port())
        >>> tension = gx.probes.JointForce(hinge, "x")
    """

    def __init__(self, joint: Joint, axis: AxisName) -> None:
        self.joint = joint
        self.axis: AxisName = axis

    def __call__(self, run: StateView) -> float:
        """The component [N] in the last step of a run."""
        force, _ = joint_force(run.system, self.joint)
        return float(force[AXES[self.axis]])


@check_arguments
class Reaction(ForceObjective):
    """Component of the force [N], or of its moment [N m], that the ground exerts on the scene
    through a support, joint or connector, in the last step.

    Of a joint or connector between two bodies it is what its second side `b` bears; side `a` bears
    the opposite.  The force of a rope or spring includes that of its damping.  In a run the forces
    through all items on the ground, and those of loads (`LoadResultant`) and obstacles
    (`ContactForce`), are the change of the momentum over the step; at rest their sum is zero.  In
    an equilibrium it has derivatives, for `gx.analysis.gradient`.

    Args:
        of: a support such as `Fixed`, a joint, or a spring, damper, rope, tether or stop of the
            scene.
        axis: "x", "y" or "z".
        action: "force", or "moment".
        about: point (3,) [m] of the moment, fixed in space.

    Raises:
        InputError: the axis is unknown; when called, the item is not in the scene, or is none that
            holds something.

    Example:
        >>> weight = gx.Gravity(mass, (0.0, 0.0, -10.0))
        >>> hook = gx.Ground((0.0, 0.0, 1.0))
        >>> spring = gx.connectors.Spring(mass.port(), hook, stiffness=100.0, length=1.0)
        >>> statics = gx.Equilibrium(gx.Scene(weight, spring))
        >>> result = statics.find()
        >>> round(gx.probes.Reaction(spring, "z")(statics), 6)
        10.0
    """

    def __init__(
        self,
        of: Item,
        axis: AxisName,
        *,
        action: Literal["force", "moment"] = "force",
        about: tuple[float, float, float] = (0.0, 0.0, 0.0),
    ) -> None:
        self.of = of
        self.axis: AxisName = axis
        self.action: Literal["force", "moment"] = action
        self.about = about
        self.unit = {"force": "N", "moment": "N m"}[action]
        self._force = ForSystem(lambda system: GroundForce(system, of))

    def __call__(self, run: StateView) -> float:
        """The component in the last step of a run, or in an equilibrium.  Collective."""
        force, moment = self._force(run.system)(self.about)
        vector = force if self.action == "force" else moment
        return float(vector[AXES[self.axis]])

    def _derivative(self, system: System) -> ReactionDerivative:
        # Imported here: most scenes ask for no derivative.
        from gossamer_fx.records.fields.reaction_derivatives import ReactionDerivative

        about = self.about if self.action == "moment" else None
        direction = np.eye(3)[AXES[self.axis]]
        return ReactionDerivative(system, self._force(system), direction, about)

    def add_derivative(
        self, system: System, by_position: PETSc.Vec, by_velocity: PETSc.Vec
    ) -> None:
        """Add the derivative in an equilibrium by the coordinates; `InputError` in a run."""
        self._derivative(system).add(by_position)

    def add_scalar_derivative(self, system: System, by_scalars: Array) -> None:
        """Add the derivative by the pressures of gas."""
        self._derivative(system).add_scalars(by_scalars)

    def residual_weights(self, system: System) -> PETSc.Vec:
        return self._derivative(system).residual_weights()

    def by_number(self, system: System, compiled: Any, term: Any, key: str) -> float:
        return self._derivative(system).by_number(compiled, term, key)

    @classmethod
    def components(
        cls, of: Item, name: str, *, about: tuple[float, float, float] = (0.0, 0.0, 0.0)
    ) -> dict[str, Reaction]:
        """Probes of all six components by the names of their columns, "NAME force x [N]" to "NAME
        moment z [N m]", e.g. for `Series`, `outputs.Probes` or `Case`.

        Args:
            of: a support, joint or connector of the scene.
            name: with which the names of the columns begin.
            about: point (3,) [m] of the moments.

        Example:
            >>> clamp = gx.Fixed(film, "left")
            >>> list(gx.probes.Reaction.components(clamp, "clamp"))[:2]
            ['clamp force x [N]', 'clamp force y [N]']
        """
        actions: tuple[Literal["force", "moment"], ...] = ("force", "moment")
        probes = [cls(of, axis, action=action, about=about) for action in actions for axis in AXES]
        return {f"{name} {one.action} {one.axis} [{one.unit}]": one for one in probes}


@check_arguments
class RingArea:
    """Deformed area [m²] of a ring of a film, through which gas may pass.

    Args:
        ring: the ring.

    Raises:
        InputError: when called, the film is not in the scene, or the edges form no closed line.

    Example:
        >>> area = gx.probes.RingArea(gx.gas.Ring(tube, "ring 1"))
    """

    def __init__(self, ring: Ring) -> None:
        self.ring = ring
        self._loop = ForSystem(self._loop_in)

    def __call__(self, run: StateView) -> float:
        """The area [m²] of the ring in the state of a run.  Collective.

        Args:
            run: of a scene with the film of the ring.

        Raises:
            InputError: the film is not in the scene, or the edges of the ring form no closed line.
        """
        # a step of no length: the area of the current state
        return float(self._loop(run.system).aperture(0.0))

    def _loop_in(self, system: System) -> Loop:
        """The edges of the ring, which are found once in a scene and measured at every call."""
        from gossamer_fx.mechanics.gas.ring import Loop

        body = self.ring.body
        check_in_scene(f"'{body.name}'", body in system.unknowns.bodies)
        return Loop(self.ring, system.unknowns)


def _with_normal(directors: Array, rates: Array) -> tuple[Array, Array]:
    """The normal d2 × d3 and its rate in front of two directors and their rates, (3, 3) each."""
    normal = np.cross(directors[0], directors[1])
    normal_rate = np.cross(rates[0], directors[1]) + np.cross(directors[0], rates[1])
    return np.vstack([normal, directors]), np.vstack([normal_rate, rates])
