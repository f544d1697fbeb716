"""The stiffness of pairs that begin to touch: given, or enough to stop them, or to carry the loads
of an equilibrium.

A pair whose sides close at a speed v has to take up their kinetic energy within the activation
distance.  A given stiffness that is too small for that is warned of once.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Mapping, Sequence

import numpy as np
from mpi4py import MPI

from gossamer_fx.mechanics.contact.contract import Array, ContactAssembly, Int32Array
from gossamer_fx.mechanics.contact.geometry.collision_mesh import CollisionMesh
from gossamer_fx.mechanics.contact.narrow_phase.closest_points import closest_points
from gossamer_fx.mechanics.contact.pair_table import CandidatePairs
from gossamer_fx.mechanics.contact.stencils import stencils_of

LOG = logging.getLogger("gossamer_fx")

# A pair with the area density σ and the closing speed v is stopped within the activation distance d
# if its stiffness K d² per area is this multiple of σ v²; the derived stiffness is just that.
STOPPING_FACTOR = 4


class StiffnessWarning:
    """Warns if K d² < 4 σ v²: layers then come so near each other that no step is short enough.

    Args:
        names: of bodies and obstacles.

    Attributes:
        was_given: whether the warning was given.
    """

    def __init__(
        self, activation_distance: float, names: Sequence[str], comm: MPI.Intracomm
    ) -> None:
        self._activation_distance = activation_distance
        self._names = names
        self._comm = comm
        self.was_given = False

    def check(self, stiffness: float, bodies: Int32Array, density: Array, speed: Array) -> None:
        """Warn once, in the log, if the given stiffness [N/m³] cannot stop a contact pair;
        collective.  Of all ranks' pairs the one is named that needs most.

        `bodies`: numbers (n, 2) of both sides; `density`: area density of the lighter one (n,)
        [kg/m²]; `speed`: closing speed (n,) [m/s].
        """
        if self.was_given:
            return
        needed = STOPPING_FACTOR * density * speed**2
        present = stiffness * self._activation_distance**2
        largest = 0.0
        message = ""
        if len(needed) and needed.max() > present:
            row = int(needed.argmax())
            largest = float(needed[row])
            one, other = (self._names[number] for number in bodies[row])
            message = (
                f"Contact: a stiffness of {stiffness:.3g} N/m³ is too soft to stop '{one}' "
                f"and '{other}', which close at {speed[row]:.3g} m/s; "
                f"give {largest / self._activation_distance**2:.2g} N/m³ at least, or leave it out."
            )
        _, message = max(self._comm.allgather((largest, message)))
        self.was_given = bool(message)
        if message and self._comm.rank == 0:
            LOG.warning(message)


# Closing speed over that at the start of the step: a pair may be faster when it meets.
SPEED_RESERVE = 1.25

# The reference speed crosses this part of the activation distance in the first step: a pair that
# hardly moves is not so soft that a step compresses it altogether.
REFERENCE_WAY = 0.5

# Part of a step over which the closing speed is a difference quotient.
SHORT_TIME = 1e-3

# Pressure of pairs that are closed by the whole activation distance, over that of the loads of an
# equilibrium, of which a small area may have to carry much.
STATIC_FACTOR = 10.0

# Mean energy of pairs over their stiffness from which an equilibrium stiffens them: they are closed
# to about 0.3 of the activation distance, two surfaces with a barrier to 0.56.
CLOSED_ENERGY = 0.25

# By how much they are stiffened at once, and in all: bodies between rigid boundaries stay closed,
# however stiff contact is.
STIFFENING = 10.0
MAX_STIFFENING = 1e6

# No density: divisions by smaller ones are meaningless.
TINY = 1e-300


class PairStiffness:
    """Chooses k [J] of pairs that begin to touch.

    Attributes:
        given: K [N/m³], or None.
        static_pressure: pressure [N/m²] of the loads and the prestress of an equilibrium; zero in
            dynamics.
    """

    def __init__(
        self,
        mesh: CollisionMesh,
        stiffness: float | None,
        activation_distance: float,
        system: ContactAssembly,
    ) -> None:
        self._mesh = mesh
        self.given = stiffness
        self._activation_distance = activation_distance
        self._system = system
        self._warning = StiffnessWarning(activation_distance, mesh.names, system.comm)
        self._density: Array | None = None
        self.static_pressure = 0.0
        self._stiffening = 1.0  # of an equilibrium, see `stiffen`

    def reference_speed(self, step: float) -> float:
        """Return the least closing speed [m/s] for which stiffness is derived; `step` is the length
        of the first step [s]."""
        return REFERENCE_WAY * self._activation_distance / step

    def choose(
        self,
        pairs: CandidatePairs,
        squared_distance: Array,
        x0: Array,
        v: Array,
        reference_speed: float,
    ) -> Array:
        """Return the stiffness k (n,) [J] of contact pairs that begin to touch; collective.

        It is the given one, warned of once if it cannot stop the pairs; else in an equilibrium that
        which carries the static pressure; else that which stops the closing speed.  All are
        proportional to the area for which a pair stands.  `squared_distance`: of the closest points
        at x0 (n,); `reference_speed`: closing speed [m/s] that is assumed at least.
        """
        sides = np.column_stack([pairs.points[:, 0], pairs.second_point])
        bodies = self._mesh.body[sides]
        density = self.densities()[bodies]
        rate = self._rate_of_distance(pairs, squared_distance, x0, v)
        if self.given is not None:
            # In an equilibrium there is nothing to stop.
            if not self._system.rule.is_static:
                self._warning.check(
                    self.given,
                    bodies=bodies,
                    density=density.min(axis=1),
                    speed=np.maximum(-rate, 0),
                )
            return self.given * self._activation_distance**2 * pairs.area
        if self.static_pressure:
            pressure = STATIC_FACTOR * self._stiffening * self.static_pressure
            return pressure * self._activation_distance * pairs.area
        # The density that acts between two free sides, twice the harmonic sum; that of one side,
        # doubled, against an obstacle.
        both_sides = 2 / np.maximum((1 / density).sum(axis=1), TINY)
        speed = np.maximum(reference_speed, SPEED_RESERVE * np.abs(rate))
        return self._stiffening * STOPPING_FACTOR * both_sides * speed**2 * pairs.area

    def set_static_load(self, force: float, tensions: Mapping[str, float]) -> None:
        """Derive the pressure that contact may have to carry in an equilibrium from the norm of all
        loads [N], and from tensions by the names of bodies: of films [N/m], of lines [N].
        Collective.

        A pressure p on nodes that stand for the areas A is the force p |A|.  A tension T presses
        on an obstacle of the radius R by T/R.  Edges of the length l keep off it if l²/8 R < d, so
        that T d/l² is about the largest pressure that a mesh can have.
        """
        mesh = self._mesh
        comm = self._system.comm
        is_own = mesh.shared.is_own
        body = mesh.known.points.body[is_own]
        area = mesh.known.points.area[is_own]
        radius = mesh.radius[: len(is_own)][is_own]
        squares = comm.allreduce(float(area @ area))
        pressure = force / math.sqrt(squares)
        for k in range(len(mesh.bodies)):
            tension = tensions.get(mesh.names[k], 0.0)
            if tension <= 0:
                continue
            of_body = area[body == k]
            own_sums = np.array([of_body.sum(), radius[body == k].sum(), float(len(of_body))])
            total, radii, count = comm.allreduce(own_sums)
            squared_length = total / count
            if mesh.bodies[k].space.mesh.topology.dim == 1:
                # The area of a node is that of a strip as wide as the line.
                width = 2 * radii / count
                squared_length = (squared_length / width) ** 2
                tension = tension / width
            pressure = max(pressure, tension * self._activation_distance / squared_length)
        self.static_pressure = pressure

    def stiffen(self, mean_energy: float) -> bool:
        """Stiffen pairs of an equilibrium if their mean energy over their stiffness [-] says that
        they are nearly closed; return whether they were stiffened."""
        if mean_energy < CLOSED_ENERGY or self._stiffening >= MAX_STIFFENING:
            return False
        self._stiffening *= STIFFENING
        return True

    def densities(self) -> Array:
        """Return the area density (k,) [kg/m²] of bodies and obstacles, computed once."""
        if self._density is None:
            self._density = self._mesh.body_densities(self._system)
        return self._density

    def rescale(self, stiffness: float) -> float:
        """Give the contact another K [N/m³]; return it over the one before."""
        assert self.given is not None, "only a given stiffness is changed"
        factor = stiffness / self.given
        self.given = stiffness
        return factor

    def masses_changed(self) -> None:
        """Forget the densities; they are computed again when they are needed."""
        self._density = None

    def _rate_of_distance(
        self, pairs: CandidatePairs, squared_distance: Array, x0: Array, v: Array
    ) -> Array:
        """Return by how much the distances of contact pairs grow (n,) [m/s]; negative where they
        close. It is a difference quotient over a thousandth of the step."""
        duration = SHORT_TIME * self._system.h
        later, _ = closest_points(pairs, np.ascontiguousarray(x0 + duration * v))
        rate = np.empty(len(pairs))
        for stencil, rows in stencils_of(pairs.kind):
            change = stencil.distance(later[rows]) - stencil.distance(squared_distance[rows])
            rate[rows] = change / duration
        return rate
