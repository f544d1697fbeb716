"""Edges of plates whose direction is held, or turned."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import KW_ONLY, dataclass
from typing import Any

import numpy as np
import ufl
from dolfinx import fem
from dolfinx.mesh import meshtags

from gossamer_fx.bodies.plate import Plate
from gossamer_fx.checks.arguments import check_arguments
from gossamer_fx.checks.errors import check, check_on_all
from gossamer_fx.constraints.fixed import Fixed, Prescribed, check_support
from gossamer_fx.constraints.moving_energies import MovingEnergy
from gossamer_fx.forms.bending import EDGE_DEGREE
from gossamer_fx.forms.kinematics import Expr
from gossamer_fx.model.body import Array, Vector
from gossamer_fx.model.ports import unit
from gossamer_fx.model.state import State
from gossamer_fx.model.terms import Term
from gossamer_fx.terms.quadratic_energies import QuadraticEnergy


@check_arguments
@dataclass(frozen=True, eq=False)
class ClampedEdge:
    """A clamped edge of a plate: it keeps its position and direction, or moves and turns as prescribed.

    The direction is held by Nitsche's method (`forms.bending`), and the energy of that is part of the
    plate's bending energy; the work of what moves or turns the edge is booked as supplied.

    Args:
        body: a plate.
        edges: name of curves on its rim.
        components: which of x, y, z (0, 1, 2) of its positions are held: (0,) with the direction
            (1, 0, 0) is a plane of symmetry x = 0.
        normal: instead of components, the one direction along which the nodes do not move, as of `Fixed`.
        direction: vector to which the plate is tangent at the edge, across it; or a function of the
            points (3, n) of the stress-free shape and the time [s] that returns (3, n).  None: as it
            starts.
        motion: displacement [m] of the edge, as of `Prescribed`.  None: no displacement.
        name: name in messages and output.

    Raises:
        InputError: edges inside the plate, components that are not coordinates, a direction of length
            zero; during a run: a direction or motion that is not finite.

    Example:
        >>> gx.constraints.ClampedEdge(plate, "left").name
        'plate/left fixed (0, 1, 2)'
    """

    body: Plate
    edges: str
    _: KW_ONLY
    components: tuple[int, ...] = (0, 1, 2)
    normal: Vector | None = None
    direction: Vector | Callable[[Array, float], Array] | None = None
    motion: Callable[[Array, float], Array] | None = None
    name: str = ""

    def __post_init__(self) -> None:
        edges = self.body.mesh.curve(self.edges, "ClampedEdge")
        check_on_all(
            self.body.comm,
            bool(self.body.mesh.edges.is_boundary[edges].all()),
            f"ClampedEdge: the group '{self.edges}' has edges inside '{self.body.name}'; name a part of its rim.",
        )
        if self.direction is not None and not callable(self.direction):
            check(
                any(self.direction),
                f"ClampedEdge: direction is {self.direction!r}; give three finite numbers, not all zero.",
            )
        check_support("ClampedEdge", self.body, self.edges, self.components)
        if not self.name:
            object.__setattr__(self, "name", self._held.name)

    @property
    def _held(self) -> Fixed:
        """The positions of the edge, where they are held and not moved."""
        return Fixed(
            self.body,
            self.edges,
            components=self.components,
            normal=self.normal,
            name=self.name,
        )

    def requires(self) -> Iterable[Any]:
        yield self.body

    def terms(self, start: State) -> Iterable[Term]:
        plate = self.body
        name = f"{plate.name} bending"
        if self.motion is None:
            yield from self._held.terms(start)
        else:
            moved = Prescribed(
                plate,
                self.edges,
                motion=self.motion,
                components=self.components,
                name=self.name,
            )
            yield from moved.terms(start)
        clamp = plate.bending.clamp
        ds = self._edges()
        if callable(self.direction):
            nodes, turned = plate.nodes(self.edges), self.direction
            X = plate.space.tabulate_dof_coordinates()[nodes].T

            def values(t: float) -> Array:
                d = np.asarray(turned(X, t), dtype=float)
                good = d.shape == X.shape and bool(
                    np.isfinite(d).all() and np.linalg.norm(d, axis=0).all()
                )
                check_on_all(
                    plate.comm,
                    good,
                    f"'{self.name}': its direction at t = {t:.6g} s is not finite, or zero, somewhere, or of shape "
                    f"{d.shape} instead of {X.shape}; correct its function.",
                )
                result: Array = (d / np.linalg.norm(d, axis=0)).T
                return result

            yield MovingEnergy(name, plate, lambda x, w, d: clamp(x, w, d, ds), nodes, values)
        else:
            d = (
                self._initial()
                if self.direction is None
                else fem.Constant(plate.mesh.domain, unit(self.direction))
            )
            yield QuadraticEnergy(name, plate, lambda x, w: clamp(x, w, d, ds))

    def _edges(self) -> ufl.Measure:
        domain = self.body.mesh.domain
        domain.topology.create_connectivity(1, 2)
        edges = self.body.mesh.curve(self.edges, "ClampedEdge")
        tags = meshtags(domain, 1, edges, np.ones(len(edges), dtype=np.int32))
        return ufl.Measure(
            "ds", domain, subdomain_data=tags, metadata={"quadrature_degree": EDGE_DEGREE}
        )(1)

    def _initial(self) -> Expr:
        """The direction as it starts."""
        start = fem.Function(self.body.space)
        positions, _ = self.body.initial_state()
        start.x.array[: len(positions)] = positions
        start.x.scatter_forward()
        slope = ufl.dot(ufl.grad(start), ufl.FacetNormal(self.body.mesh.domain))
        return slope / ufl.sqrt(ufl.dot(slope, slope))
