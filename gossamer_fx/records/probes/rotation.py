"""Probes of the rotation of a whole scene: angular momentum about its centre of mass, and
nutation."""

from __future__ import annotations

import math

import numpy as np

from gossamer_fx.core.checks.arguments import check_arguments
from gossamer_fx.core.checks.errors import check
from gossamer_fx.core.model.body import Array
from gossamer_fx.mechanics.bodies.frames import Frame
from gossamer_fx.records.probes.points import AXES, check_axis
from gossamer_fx.solve.system.system import System
from gossamer_fx.solve.view import StateView


@check_arguments
class AngularMomentum:
    """Component [kg m²/s] of the angular momentum of the scene about its centre of mass.

    In axes of space it is constant without external loads.  In the axes of a hub its first two
    components grow as the hub leans away from it.

    Args:
        axis: "x", "y" or "z": of space, or the first, second or third axis of `frame`.
        frame: with three directors, of a body or of the ground; None: axes of space.

    Raises:
        InputError: the axis is unknown, or the frame has two directors only.

    Example:
        >>> along_hub = gx.probes.AngularMomentum("z", frame=hub.frame())
        >>> along_hub(run)
        0.0
    """

    unit = "kg m²/s"

    def __init__(self, axis: str, *, frame: Frame | None = None) -> None:
        check_axis(axis)
        check(
            frame is None or len(frame.directors) == 3,
            "AngularMomentum: the frame has no third axis; give one with three directors.",
        )
        self.axis = axis
        self.frame = frame

    def __call__(self, run: StateView) -> float:
        """The component [kg m²/s] in the state of a run."""
        momentum = angular_momentum_about_centre(run)
        if self.frame is None:
            return float(momentum[AXES[self.axis]])
        director = self.frame.directors[AXES[self.axis]]
        return float(momentum @ run.system.state.vectors([director])[0])


@check_arguments
class Nutation:
    """Angle [rad], 0 to π, between the third axis of a frame and the scene's angular momentum about
    its centre of mass.

    The nutation angle of a rigid symmetric body is constant; where energy is dissipated it decays
    if the third axis is that of the largest moment of inertia, and grows otherwise.

    Args:
        frame: with three directors, of a body.

    Raises:
        InputError: the frame has two directors only.

    Example:
        >>> nutation = gx.probes.Nutation(hub.frame())
    """

    unit = "rad"

    def __init__(self, frame: Frame) -> None:
        check(
            len(frame.directors) == 3,
            "Nutation: the frame has no third axis; give one with three directors.",
        )
        self.frame = frame

    def __call__(self, run: StateView) -> float:
        """The angle [rad] in the state of a run; 0 where nothing turns."""
        momentum = angular_momentum_about_centre(run)
        axis = run.system.state.vectors([self.frame.directors[2]])[0]
        # The angle from its sine and its cosine: the cosine alone has no digits of small ones.
        across = float(np.linalg.norm(np.cross(axis, momentum)))
        return math.atan2(across, float(axis @ momentum))


def angular_momentum_about_centre(run: StateView) -> Array:
    """Angular momentum (3,) [kg m²/s] of all bodies about their centre of mass."""
    system = run.system
    momenta = system.v0.duplicate()
    system.M.mult(system.v0, momenta)
    is_position = system.position_marks
    size = 3 * len(is_position)  # without multipliers
    # p: momenta [kg m/s], q: coordinates [m] of this rank's vectors (n, 3): positions and
    # directors.
    p = momenta.array_r[:size].reshape(-1, 3)
    q = system.q0.array_r[:size].reshape(-1, 3)
    # Directors have angular momentum, but no momentum.
    own = np.concatenate([is_position @ p, np.cross(q, p).sum(axis=0)])
    momenta.destroy()
    sums = run.comm.allreduce(own)
    about_centre: Array = sums[3:] - np.cross(centre_of_mass(system), sums[:3])
    return about_centre


def centre_of_mass(system: System) -> Array:
    """Centre of mass (3,) [m] of all bodies of a scene; NaN for a scene without mass."""
    is_position = system.position_marks
    size = 3 * len(is_position)
    translation = system.q0.duplicate()
    weight = system.q0.duplicate()
    masses = np.zeros(3)
    first_moments = np.zeros(3)
    for axis in range(3):
        translation.set(0.0)
        with translation as entries:
            # A translation moves positions, not directors and multipliers.
            entries[:size].reshape(-1, 3)[:, axis] = is_position
        system.M.mult(translation, weight)
        masses[axis] = weight.dot(translation)
        first_moments[axis] = weight.dot(system.q0)
    translation.destroy()
    weight.destroy()
    return first_moments / masses
