"""Clamped edges: edges of plates whose slope is fixed or prescribed.

The slope is held by Nitsche's method (`forms.bending`).  The energy of that is part of the plate's
bending energy; the work of what turns the edge counts as supplied.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
import ufl
from dolfinx import fem
from dolfinx.mesh import meshtags

from gossamer_fx.core.checks.errors import check, check_on_all
from gossamer_fx.core.forms.backend import cell_nodes
from gossamer_fx.core.forms.bending import EDGE_DEGREE
from gossamer_fx.core.forms.kinematics import Expr
from gossamer_fx.core.model.body import Array, Vector, unit
from gossamer_fx.core.model.state import State
from gossamer_fx.core.model.terms import Term
from gossamer_fx.mechanics.bodies.plate import Plate
from gossamer_fx.mechanics.constraints.moving_energies import MovingEnergy
from gossamer_fx.mechanics.terms.quadratic_energies import QuadraticEnergy

# Smallest sine of the angle between a clamped edge and the direction of the plate across it: 6
# degrees.
MIN_SINE = 0.1


def check_is_rim(plate: Plate, edges: str) -> None:
    """Raise `InputError`, on all ranks, unless the group names curves on the rim of the plate."""
    found = plate.mesh.curve(edges, "Fixed")
    check_on_all(
        plate.comm,
        bool(plate.mesh.edges.is_boundary[found].all()),
        f"Fixed: the group '{edges}' has edges inside '{plate.name}'; name a part of its rim.",
    )


@dataclass(frozen=True)
class EdgeRotation:
    """The direction of a plate at an edge of its rim, see `Fixed` for the arguments."""

    name: str
    plate: Plate
    edges: str
    direction: Vector | Callable[[Array, float], Array] | None

    def terms(self, start: State) -> Iterable[Term]:
        """The energies by which Nitsche's method keeps a plate tangent to a direction at an edge.

        Yields:
            One quadratic energy [J] for a constant direction; one that changes with time for a
            direction that does, or in addition for a plate with a difference of temperature across
            its thickness.

        Raises:
            InputError: the direction lies along the edge, or it turns with time on a plate with
                such a difference of temperature.
        """
        # X (3, n) [m] are nodes of the edge, d the direction; x and w trial and test functions.
        clamp = self.plate.bending.clamp
        ds = self._measure()
        name = f"{self.plate.name} bending"
        if callable(self.direction):
            nodes = self.plate.nodes(self.edges)
            X = self.plate.space.tabulate_dof_coordinates()[nodes].T
            self._check_is_across(start, lambda midpoints: self._directions(midpoints, 0.0))
            check(
                not self.plate.has_thermal_curvature,
                f"'{self.name}' turns with time, but '{self.plate.name}' has a gradient of "
                "temperature; clamp it in a "
                "constant direction, or leave the gradient out.",
            )

            def set_directions(directions: fem.Function, t: float) -> None:
                directions.x.array.reshape(-1, 3)[nodes] = self._directions(X, t)

            yield MovingEnergy(
                name=name,
                body=self.plate,
                form=lambda x, w, d: clamp(x, w, d, ds),
                space=self.plate.space,
                set=set_directions,
            )
            return
        if self.direction is None:
            d = self._initial_direction()
        else:
            direction = unit(self.direction)
            self._check_is_across(
                start, lambda midpoints: np.tile(direction, (midpoints.shape[1], 1))
            )
            d = fem.Constant(self.plate.mesh.domain, direction)
        yield QuadraticEnergy(name, self.plate, lambda x, w: clamp(x, w, d, ds))
        if self.plate.has_thermal_curvature:
            yield self._thermal_moment(name, d, ds)

    def _thermal_moment(self, name: str, d: Expr, ds: ufl.Measure) -> Term:
        """The energy that the thermal curvature of the plate adds at the clamped edge, as a term.

        Args:
            d: unit vector (3,) to which the plate is tangent at the edge.
        """
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
            set=thermal.given.set,
        )

    def _directions(self, X: Array, t: float) -> Array:
        """Unit directions (n, 3) at points of the edge, from the user's function.  Collective.

        Args:
            X: points (3, n) [m] of the stress-free shape.
            t: time [s].

        Raises:
            InputError: on all ranks, if a direction is not finite or zero, or the shape is another.
        """
        # d (3, n): the directions, of any length.
        assert callable(self.direction)
        d = np.asarray(self.direction(X, t), dtype=float)
        is_right = d.shape == X.shape and bool(np.isfinite(d).all())
        check_on_all(
            self.plate.comm,
            is_right and bool(np.linalg.norm(d, axis=0).all()),
            f"'{self.name}': its direction at t = {t:.6g} s is not finite, or zero, somewhere, or "
            f"of shape {d.shape} instead of {X.shape}; correct its function.",
        )
        unit_directions: Array = (d / np.linalg.norm(d, axis=0)).T
        return unit_directions

    def _check_is_across(self, start: State, directions: Callable[[Array], Array]) -> None:
        """Refuse a direction that lies along the edge, to which the plate is tangent there in any
        case.

        Collective.

        Args:
            directions: function of midpoints (3, n) [m] of edges of the stress-free mesh that
                returns unit directions (n, 3).

        Raises:
            InputError: on all ranks, if the sine of the angle between both is below `MIN_SINE` at
                some edge.
        """
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
            f"'{self.name}': its direction ({_three(direction)}) lies along the edge at "
            f"({_three(point)}) m; give the "
            "direction across the edge, to which the plate is tangent there.",
        )

    def _measure(self) -> ufl.Measure:
        """The measure over the lengths [m] of the clamped edge, for UFL forms.

        It integrates over the named group of edges on the rim of the plate.
        """
        domain = self.plate.mesh.domain
        # Integrals over edges need the triangles next to them.
        domain.topology.create_connectivity(1, 2)
        edges = self.plate.mesh.curve(self.edges, "Fixed")
        tags = meshtags(domain, 1, edges, np.ones(len(edges), dtype=np.int32))
        ds = ufl.Measure(
            "ds", domain, subdomain_data=tags, metadata={"quadrature_degree": EDGE_DEGREE}
        )
        return ds(1)

    def _initial_direction(self) -> Expr:
        """The unit direction across the edge in the initial state that the plate has by itself."""
        start = fem.Function(self.plate.space)
        positions, _ = self.plate.initial_state()
        self.plate.reconstruct(start, positions)
        slope = ufl.dot(ufl.grad(start), ufl.FacetNormal(self.plate.mesh.domain))
        return slope / ufl.sqrt(ufl.dot(slope, slope))


def _three(vector: list[float]) -> str:
    return ", ".join(f"{value:.4g}" for value in vector)
