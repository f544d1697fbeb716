"""Clamped edges: edges of plates whose slope is fixed or prescribed.

The slope is held by Nitsche's method (`forms.bending`).  The energy of that is part of the plate's
bending energy.  Where the edge is turned or heated, the quadratic form of this energy changes with
time; the work of that counts as supplied.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import ufl
from dolfinx import fem

from gossamer_fx.core.checks.errors import check, check_on_all
from gossamer_fx.core.forms.backend import cell_nodes
from gossamer_fx.core.forms.bending import EDGE_DEGREE
from gossamer_fx.core.forms.compilation import constant
from gossamer_fx.core.forms.kinematics import Expr
from gossamer_fx.core.model.body import Array, MeshBody, Vector, unit
from gossamer_fx.core.model.item import Item
from gossamer_fx.core.model.state import InitialState, State
from gossamer_fx.core.model.terms import Term
from gossamer_fx.mechanics.bodies.membrane import edge_measure
from gossamer_fx.mechanics.bodies.plate import Plate
from gossamer_fx.mechanics.terms.assembly import Compiler
from gossamer_fx.mechanics.terms.coordinates import Coordinates
from gossamer_fx.mechanics.terms.energies_in_time import Change, EnergiesInTime, StepForms, Varying
from gossamer_fx.mechanics.terms.quadratic_energies import QuadraticEnergy

# Smallest sine of the angle between a clamped edge and the direction of the plate across it: 6
# degrees.
MIN_SINE = 0.1


def check_is_rim(plate: Plate, edges: str) -> None:
    """Raise `InputError`, on all ranks, unless the group names curves on the rim of the plate."""
    found = plate.mesh.curve(edges, f"Fixed on '{plate.name}'")
    check_on_all(
        plate.comm,
        bool(plate.mesh.edges.is_boundary[found].all()),
        f"Fixed: the group '{edges}' has edges inside '{plate.name}'; name a part of its rim.",
    )


@dataclass(frozen=True)
class EdgeRotation(Item):
    """The direction of a plate at an edge of its rim, see `Fixed` for the arguments."""

    name: str
    plate: Plate
    edges: str
    direction: Vector | Callable[[Array, float], Array] | None

    def terms(self, start: State) -> Iterable[Term]:
        """The energies [J] by which Nitsche's method keeps a plate tangent to a direction at an
        edge: one that changes with time for a direction that does, and another for a plate with a
        difference of temperature across its thickness."""
        # X (3, n) [m] are nodes of the edge, d the direction; x and w trial and test functions.
        ds = self._measure()
        slope = self._slope(start[self.plate].positions().ravel())
        name = f"{self.plate.name} bending"
        if callable(self.direction):
            nodes = self.plate.nodes(self.edges)
            X = self.plate.space.tabulate_dof_coordinates()[nodes].T
            self._check_is_across(start, lambda midpoints: self._directions(midpoints, 0.0))
            check(
                not self.plate.has_thermal_curvature,
                f"'{self.name}' turns with time, "
                f"but '{self.plate.name}' has a gradient of temperature; "
                "clamp it in a constant direction, or leave the gradient out.",
            )

            def set_directions(directions: fem.Function, t: float) -> None:
                directions.x.array.reshape(-1, 3)[nodes] = self._directions(X, t)

            at_start = fem.Function(self.plate.space)
            set_directions(at_start, 0.0)
            side = ufl.sign(ufl.dot(slope, at_start))

            yield MovingEnergy(
                name=name,
                body=self.plate,
                form=lambda x, w, d: self.plate.bending.clamp(x, w, side * d, ds),
                space=self.plate.space,
                set=set_directions,
            )
            return
        if self.direction is None:
            # Not that of the start: Nitsche's method lets an equilibrium turn a little there.
            assert isinstance(start, InitialState)
            slope = self._slope(start.made(self.plate))
            d = slope / ufl.sqrt(ufl.dot(slope, slope))
        else:
            direction = unit(self.direction)
            self._check_is_across(
                start, lambda midpoints: np.tile(direction, (midpoints.shape[1], 1))
            )
            given = fem.Constant(self.plate.mesh.domain, direction)
            d = ufl.sign(ufl.dot(slope, given)) * given
        yield QuadraticEnergy(name, self.plate, lambda x, w: self.plate.bending.clamp(x, w, d, ds))
        if self.plate.has_thermal_curvature:
            yield self._thermal_moment(name, d, ds)

    def _thermal_moment(self, name: str, d: Expr, ds: ufl.Measure) -> Term:
        """The energy that the thermal curvature of a plate adds at the clamped edge, where it is
        tangent to the unit vector d (3,)."""
        from gossamer_fx.mechanics.bodies.thermal_expansion import thermal_curvature

        thermal = thermal_curvature(self.plate)

        def form(x: Expr, w: Expr, difference: Expr) -> ufl.Form:
            curvature = ufl.replace(thermal.curvature, {thermal.difference: difference})
            return self.plate.bending.rest_clamp(x, w, d, curvature, ds)

        return MovingEnergy(
            name=name,
            body=self.plate,
            form=form,
            space=thermal.difference.function_space,
            set=thermal.set,
        )

    def _directions(self, X: Array, t: float) -> Array:
        """Unit directions (n, 3) at points X (3, n) [m] of the stress-free edge at a time [s], from
        the user's function.  Collective."""
        # d (3, n): the directions, of any length.
        assert callable(self.direction)
        d = np.asarray(self.direction(X, t), dtype=float)
        is_right = d.shape == X.shape and bool(np.isfinite(d).all())
        check_on_all(
            self.plate.comm,
            is_right and bool(np.linalg.norm(d, axis=0).all()),
            f"'{self.name}': its direction at t = {t:.6g} s is not finite, or zero, "
            f"somewhere, or of shape {d.shape} instead of {X.shape}; correct its function.",
        )
        return (d / np.linalg.norm(d, axis=0)).T

    def _check_is_across(self, start: State, directions: Callable[[Array], Array]) -> None:
        """Refuse a direction that lies along the edge, to which the plate is tangent there in any
        case; `directions` gives unit directions (n, 3) at midpoints (3, n) [m] of edges.
        Collective."""
        mesh = self.plate.mesh
        edges = mesh.curve(self.edges, "Fixed")
        edges = edges[edges < mesh.edges.owned]
        x = fem.Function(self.plate.space)
        # The initial state may be folded: what is along an edge there need not be so on the mesh.
        self.plate.reconstruct(x, start[self.plate].positions().ravel())
        positions = x.x.array.reshape(-1, 3)
        reference = self.plate.space.tabulate_dof_coordinates()
        # An edge on the rim has one triangle, in either column.
        column = mesh.edges.cells[edges].argmax(axis=1)
        cells = mesh.edges.cells[edges, column]
        sides = mesh.edges.sides[edges, column]
        nodes = cell_nodes(self.plate.space)[cells]
        first = nodes[np.arange(len(edges)), (sides + 1) % 3]
        second = nodes[np.arange(len(edges)), (sides + 2) % 3]
        tangents = positions[second] - positions[first]
        tangents /= np.linalg.norm(tangents, axis=1, keepdims=True)
        midpoints = (reference[first] + reference[second]) / 2
        along = directions(midpoints.T)
        sines = np.linalg.norm(np.cross(tangents, along), axis=1)
        worst: tuple[float, list[float], list[float]] = (np.inf, [], [])
        if len(sines):
            k = int(sines.argmin())
            worst = (float(sines[k]), along[k].tolist(), midpoints[k].tolist())
        # The worst edge of all ranks, so that all raise the same message.
        sine, direction, point = min(self.plate.comm.allgather(worst))
        check(
            sine >= MIN_SINE,
            f"'{self.name}': "
            f"its direction ({_three(direction)}) lies along the edge at ({_three(point)}) m; "
            "give the direction across the edge, to which the plate is tangent there.",
        )

    def _measure(self) -> ufl.Measure:
        """The measure over the lengths [m] of the clamped edge, for UFL forms."""
        edges = self.plate.mesh.curve(self.edges, "Fixed")
        return edge_measure(self.plate, "ds", edges, EDGE_DEGREE)

    def _slope(self, coordinates: Array) -> Expr:
        """The slope (3,) along the outer conormal of the edge, of coordinates of this rank's nodes.
        A given direction gets the sign with which it points along this slope."""
        x = fem.Function(self.plate.space)
        self.plate.reconstruct(x, coordinates)
        return self.plate.bending.slope(x)


def _three(vector: list[float]) -> str:
    """The numbers of a vector, for messages."""
    return ", ".join(f"{value:.4g}" for value in vector)


class MovingEnergies(EnergiesInTime["MovingEnergy"]):
    """All `MovingEnergy` terms of a scene.

    With the matrices K0, K1 of both ends of a step the force is ½ (K0 + K1) q_mid; what changes the
    form supplies ¼ (q1·(K1 - K0) q1 + q0·(K1 - K0) q0), and both together change the energy
    exactly.
    """

    def _step_forms(self, term: MovingEnergy, at: Coordinates) -> StepForms:
        before = fem.Function(term.space)
        after = fem.Function(term.space)
        # Where forces act at the end, so does the matrix; else it is the mean of both ends.
        at_end = self._system.rule.acts_at_end
        share = constant(term.body.space.mesh, 1.0 if at_end else 0.5)
        ends = (after,) if at_end else (before, after)
        # With the matrix K of a, a(d; q, q) = q·K q, twice the stored energy.
        at_start = term.form(at.q0, at.q0, before)
        change_at_start = term.form(at.q0, at.q0, after) - at_start
        change_at_end = term.form(at.q1, at.q1, after) - term.form(at.q1, at.q1, before)
        work = 0.25 * (change_at_start + change_at_end)
        return StepForms(
            residual=sum(share * term.form(at.mid, at.w, d) for d in ends),
            tangent=sum(at.α * share * term.form(at.dq, at.w, d) for d in ends),
            energy=0.5 * at_start,
            change=Change(Varying(after, term.set), before, work),
        )


@dataclass(frozen=True, eq=False)
class MovingEnergy:
    """Stored energy ½ a(d; q, q) of a symmetric bilinear form, written form(q, w, d), with a
    function d of time.

    `set` gives a function of `space` the values of d at a time [s].  The work of what changes d is
    supplied.
    """

    name: str
    body: MeshBody
    form: Callable[[Expr, Expr, Expr], ufl.Form]
    space: fem.FunctionSpace
    set: Callable[[fem.Function, float], None]
    compiler: ClassVar[Compiler] = MovingEnergies
