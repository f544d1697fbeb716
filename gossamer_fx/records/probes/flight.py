"""Probes of scenes in orbit: orbital elements, sunlight, attitude, and resultants of loads."""

from __future__ import annotations

import math
from typing import Literal, get_args

import numpy as np
from mpi4py import MPI

from gossamer_fx.core.checks.arguments import check_arguments
from gossamer_fx.core.checks.errors import check
from gossamer_fx.core.forms.backend import cell_nodes
from gossamer_fx.core.model.body import Array, Port
from gossamer_fx.mechanics.bodies.membrane import Membrane
from gossamer_fx.mechanics.orbit.elements import elements_of
from gossamer_fx.mechanics.orbit.environment import local_axes
from gossamer_fx.mechanics.orbit.orbit import Orbit
from gossamer_fx.records.probes.points import AXES, AxisName
from gossamer_fx.solve.view import StateView

# Osculating elements: attributes of `orbit.elements.Elements`
Element = Literal["a", "e", "i", "node", "perigee", "anomaly"]

# Axes of the orbit: columns of `orbit.environment.local_axes`
OrbitAxis = Literal["outward", "along", "across"]


@check_arguments
class OrbitState:
    """Quantity of the orbit of the centre of mass.

    Args:
        orbit: the orbit of the scene.
        quantity: one of

            - the osculating elements "a" [m], "e", "i", "node", "perigee" and "anomaly" [rad];
            - "altitude" [m] above the radius of the central body;
            - "depth" [m] in the cylinder of the shadow, negative outside: an eclipse begins and
              ends where it is zero;
            - "sunlit", the share of the Sun's disc that is visible, 0 to 1.

    Raises:
        InputError: the quantity is unknown.

    Example:
        >>> altitude = gx.probes.OrbitState(orbit, "altitude")
    """

    def __init__(
        self, orbit: Orbit, quantity: Element | Literal["altitude", "depth", "sunlit"]
    ) -> None:
        self.orbit = orbit
        self.quantity = quantity

    def __call__(self, run: StateView) -> float:
        """The quantity in the present state of a run: angles in rad, lengths in m.  Collective.

        Args:
            run: of a scene with the orbit.

        Raises:
            InputError: the orbit is not in the scene, the motion has no orbital elements (a fall
                straight down or a parabola), or the direction to the Sun is not known.
        """
        position, velocity = self.orbit.flight(run.system.unknowns).state()
        if self.quantity in get_args(Element):
            elements = elements_of(position, velocity, self.orbit.mu)
            return float(getattr(elements, self.quantity))
        if self.quantity == "altitude":
            return float(np.linalg.norm(position)) - self.orbit.radius
        if self.quantity == "depth":
            return self.orbit.depth(position, run.time)
        return self.orbit.sunlit(position, self.orbit.sun(run.time))


@check_arguments
class SunAngle:
    """Angle [rad] between the direction to the Sun and a film's mean normal, or a director of a
    frame.

    Args:
        orbit: the orbit of the scene.
        of: a film, or a director such as `body.frame().directors[2]`.

    Raises:
        InputError: `of` is neither a film nor a port.

    Example:
        >>> incidence = gx.probes.SunAngle(orbit, film)
    """

    def __init__(self, orbit: Orbit, of: Membrane | Port) -> None:
        self.orbit = orbit
        self.of = of

    def __call__(self, run: StateView) -> float:
        """The angle [rad] in the state of a run, 0 to π."""
        position, _ = self.orbit.flight(run.system.unknowns).state()
        to_sun = self.orbit.sun(run.time) - position
        return _angle(to_sun, direction_of(run, self.of))


@check_arguments
class Attitude:
    """Angle [rad] between an axis of the orbit and a film's mean normal, or a director of a frame.

    Args:
        orbit: the orbit of the scene.
        of: a film, or a director such as `body.frame().directors[2]`.
        axis: "outward" (away from the central body), "along" (the motion) or "across" (normal to
            the orbit).

    Raises:
        InputError: `of` is neither a film nor a port, or the axis is unknown.

    Example:
        >>> tilt = gx.probes.Attitude(orbit, film, axis="outward")
    """

    def __init__(self, orbit: Orbit, of: Membrane | Port, *, axis: OrbitAxis) -> None:
        self.orbit = orbit
        self.of = of
        self.axis = axis

    def __call__(self, run: StateView) -> float:
        """The angle [rad] in the state of a run, 0 to π."""
        position, velocity = self.orbit.flight(run.system.unknowns).state()
        axes = local_axes(position, velocity)
        column = get_args(OrbitAxis).index(self.axis)
        return _angle(axes[:, column], direction_of(run, self.of))


@check_arguments
class LoadResultant:
    """Component of the force [N] of a load, or of its torque [N m], in the last step.

    Args:
        about: point (3,) [m] of the torque, fixed in space; or the orbit of the scene, for the
            torque about the centre of mass.
        load: name of a load: of a pressure, weight, wind, sunlight, force, thruster.  Loads of one
            name are added.  The load of the orbit itself is gravity less the acceleration of the
            frame that flies with it.
        action: "force" or "torque".
        axis: "x", "y" or "z".

    Raises:
        InputError: the action or axis is unknown; when called, the scene has no such load.

    Example:
        >>> thrust = gx.probes.LoadResultant(orbit, "sunlight", action="force", axis="x")
        >>> tilt = gx.probes.LoadResultant((0, 0, 0), "wind", action="torque", axis="y")
    """

    def __init__(
        self,
        about: Orbit | tuple[float, float, float],
        load: str,
        *,
        action: Literal["force", "torque"],
        axis: AxisName,
    ) -> None:
        self.about = about
        self.load = load
        self.action = action
        self.axis: AxisName = axis
        self.unit = {"force": "N", "torque": "N m"}[action]

    def __call__(self, run: StateView) -> float:
        """The component of the force [N] or torque [N m] in the last step of a run.  Collective.

        Args:
            run: of a scene with the load; before the first step the component is zero.

        Raises:
            InputError: the scene has no load of this name, or the orbit is not in it.
        """
        force, torque = resultant(run, self.load)
        component = AXES[self.axis]
        if self.action == "force":
            return float(force[component])
        # Resultants are about the origin; that of a frame in orbit only follows the centre of mass.
        if isinstance(self.about, Orbit):
            centre = self.about.flight(run.system.unknowns).centre
        else:
            centre = np.asarray(self.about, dtype=float)
        about_centre = torque - np.cross(centre, force)
        return float(about_centre[component])

    @classmethod
    def components(
        cls,
        load: str,
        name: str = "",
        *,
        about: Orbit | tuple[float, float, float] = (0.0, 0.0, 0.0),
    ) -> dict[str, LoadResultant]:
        """Probes of all six components by the names of their columns, "NAME force x [N]" to "NAME
        torque z [N m]", as those of `Reaction.components`.

        Args:
            load: name of the load.
            name: with which the names of the columns begin; empty: that of the load.
            about: of the torques.

        Example:
            >>> list(gx.probes.LoadResultant.components("wind"))[:2]
            ['wind force x [N]', 'wind force y [N]']
        """
        actions: tuple[Literal["force", "torque"], ...] = ("force", "torque")
        probes = [cls(about, load, action=action, axis=axis) for action in actions for axis in AXES]
        return {f"{name or load} {one.action} {one.axis} [{one.unit}]": one for one in probes}


def resultant(run: StateView, load: str) -> Array:
    """Force [N] and torque about the origin [N m] of a load in the last step, (2, 3)."""
    found = run.system.balance.resultants()
    # Before the first step no load has acted, so none has a resultant yet.
    names = ", ".join(f"'{name}'" for name in found) or "none"
    check(
        load in found or run.step == 0,
        f"The scene has no load '{load}'; give the name of one of its loads, which are: {names}.",
    )
    return found.get(load, np.zeros((2, 3)))


def direction_of(run: StateView, of: Membrane | Port) -> Array:
    """The mean normal of a film, or the vector of a port, (3,); not of unit length.  Collective.

    The mean normal is the sum of the triangles' area vectors, here times two [m²].

    Args:
        of: the film, or a vector attached to a body, such as a director [-].
    """
    if isinstance(of, Port):
        return run.system.unknowns.state.vector(of)
    positions = run.system.unknowns.state[of].local_positions()
    owned = of.mesh.domain.topology.index_map(2).size_local
    # The first three nodes of a triangle are its corners, also of order 2.
    corners = cell_nodes(of.space)[:owned, :3]
    a = positions[corners[:, 0]]
    b = positions[corners[:, 1]]
    c = positions[corners[:, 2]]
    own_sum = np.cross(b - a, c - a).sum(axis=0)
    return run.comm.allreduce(own_sum, op=MPI.SUM)


def _angle(a: Array, b: Array) -> float:
    """Angle [rad] between two vectors (3,); the arc tangent is accurate also near 0 and π."""
    return math.atan2(float(np.linalg.norm(np.cross(a, b))), float(a @ b))
