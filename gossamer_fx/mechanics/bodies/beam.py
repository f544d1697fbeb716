"""Beams: positions and two directors of the section."""

from __future__ import annotations

from collections.abc import Iterable
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import ufl
from dolfinx import fem, la
from dolfinx.mesh import Mesh as DolfinxMesh
from mpi4py import MPI

from gossamer_fx.core.algebra.point_measures import PointMeasure
from gossamer_fx.core.checks.arguments import check_arguments
from gossamer_fx.core.checks.errors import InputError
from gossamer_fx.core.checks.relations import at_most_one
from gossamer_fx.core.forms.compilation import compile_form
from gossamer_fx.core.forms.kinematics import Expr, beam_strain, beam_strain_change
from gossamer_fx.core.mesh.mesh import Mesh
from gossamer_fx.core.model.body import Array, Indices, Port, Vector
from gossamer_fx.core.model.state import State
from gossamer_fx.core.model.terms import Term
from gossamer_fx.core.sections import Section
from gossamer_fx.mechanics.bodies.cable import Curve
from gossamer_fx.mechanics.bodies.frames import Frame
from gossamer_fx.mechanics.bodies.initial_strain import Numbers, stored_energy
from gossamer_fx.mechanics.bodies.meshed import PointFunction, checked, global_node
from gossamer_fx.mechanics.bodies.rigid_body import orthonormality
from gossamer_fx.mechanics.materials.film import constants
from gossamer_fx.mechanics.terms.masses import KineticEnergy
from gossamer_fx.mechanics.terms.point_constraints import PointConstraint

if TYPE_CHECKING:
    from gossamer_fx.mechanics.materials.thermal import ThermalExpansion

# Sine of the angle between the given normal and the beam, below which the normal counts as parallel
# to it: the direction of the section would be round-off.
PARALLEL = 1e-6
# Directions for the section, in the order in which they are tried.
AXES: tuple[Vector, ...] = ((0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0))


@check_arguments(at_most_one("initial_strain", "initial_tension"))
class Beam(Curve):
    """A shear-deformable beam in the coordinates (x, d2, d3): 9 numbers a node, quadratic elements.

    Material points x + X2 d2 + X3 d3.  Strains, taken at two Gauss points where nothing locks,

        Γ = x'·d1 - 1   γ_i = x'·d_i   κ_i = d1·d_i'   τ = ½(d2'·d3 - d3'·d2)

    with the unit normal d1 = d2 × d3 of the section, less those of the mesh, to which an initial
    axial strain may be added; W = ½(EA Γ² + GA_i γ_i² + EI_i κ_i² + GJ τ²) per length; kinetic
    energy ½∫(μ|ẋ|² + ρI_i |ḋ_i|²) dS.  The directors stay orthonormal at the nodes, by multipliers:
    imposed between nodes it would lock.  See Simo, CMAME 49 (1985) 55, whose strains they are, and
    Betsch & Steinmann, IJNME 54 (2002) 1775, for beams in directors.

    Args:
        mesh: line elements in space, straight or curved: the stress-free shape.
        section: stiffness and inertia, e.g. `tube(...)`.
        normal: direction of d2, made normal to the beam; it must not be along the beam.  Default:
            that of z; of x if the beam is along z somewhere; of y if it is along x somewhere, too.
        thermal: thermal expansion along the beam, with its temperature; default none.
        initial_tension: axial force N0 [N] of the beam in the shape of its mesh, negative for
            compression: a number; {group: number} of curves of the mesh, elsewhere none; or a
            function of points (3, n) that returns (n,).
        initial_strain: axial strain in place of a force, given in the same way.
        velocity: initial velocity [m/s], a function of the points (3, n) that returns (3, n);
            directors move with the difference that it makes over their length, which is exact for
            rigid motions.  Default: at rest.
        name: name in messages and output.

    Raises:
        InputError: the mesh does not consist of lines in space, the normal is along the beam
            somewhere, tension and strain are both given, or a function returns something else.

    Example:
        >>> section = gx.sections.tube(0.02, 5e-4, E=100e9, nu=0.3, density=1560.0)
        >>> beam = gx.Beam(curve, section, normal=(0.0, 1.0, 0.0), name="boom")
        >>> beam.block.size
        9
    """

    strains = 6
    discrete_derivative = staticmethod(beam_strain_change)

    def __init__(
        self,
        mesh: Mesh | DolfinxMesh,
        section: Section,
        *,
        normal: Vector | None = None,
        thermal: ThermalExpansion | None = None,
        initial_tension: Numbers | None = None,
        initial_strain: Numbers | None = None,
        velocity: PointFunction | None = None,
        name: str = "beam",
    ) -> None:
        self._take_mesh(name, mesh, 2, size=9, dim=1)
        self.section = section
        self.constants = constants(section, self.mesh.domain)
        self._take_expansion(thermal)
        self._velocity = checked(velocity, f"Beam '{name}': its velocity", mesh.comm)
        self._frames: dict[int, Frame] = {}
        self._take_prestress(initial_tension, initial_strain)
        tangents = self._tangents()
        direction = self._direction_across(tangents, normal)
        # A restart compares this argument, see `outputs.output`.
        self._normal = tuple(direction)
        self._reference = self._stress_free(tangents, np.asarray(direction, dtype=float))

    def _tangents(self) -> Array:
        """Mean unit tangents (n, 3) at the nodes, ghosts included.  Collective."""
        # J (3,): derivative of the positions by the coordinate of the reference cell; w: test
        # function; t: tangents at the nodes.
        J = ufl.Jacobian(self.mesh.domain)[:, 0]
        w = ufl.TestFunction(self.space)
        tangent = J / ufl.sqrt(ufl.dot(J, J))
        # The tangent may jump between cells; at a node it is the mean of both sides.
        weighted_tangent = sum(tangent[i] * w[i] for i in range(3)) * self.mass_dx
        mean = fem.assemble_vector(compile_form(weighted_tangent))
        mean.scatter_reverse(la.InsertMode.add)
        mean.scatter_forward()
        t = mean.array.reshape(-1, 9)[:, :3]
        return np.asarray(t / np.linalg.norm(t, axis=1, keepdims=True))

    def _direction_across(self, tangents: Array, normal: Vector | None) -> Vector:
        """The direction of d2 that is given, or else the first of z, x, y that is nowhere along the
        tangents (n, 3).  Collective.  `InputError`: a direction that is given is along the beam."""
        for direction in AXES if normal is None else (normal,):
            across = np.linalg.norm(np.cross(tangents, direction), axis=1)
            own = bool((across > PARALLEL * np.linalg.norm(direction)).all())
            if self.comm.allreduce(own, op=MPI.LAND):
                return direction
        text = "each of the axes" if normal is None else f"its normal {list(map(float, normal))}"
        raise InputError(
            f"Beam '{self.name}': {text} is along the beam somewhere; give another direction as "
            "normal, e.g. normal=(1.0, 1.0, 1.0)."
        )

    def _stress_free(self, tangents: Array, normal: Array) -> fem.Function:
        """Positions [m] of the mesh and directors d2 and d3 (unit vectors) at each node, as a
        function with 9 numbers a node, ghosts included. d2 is the part of `normal` (3,) across the
        tangents (n, 3), one vector for all of a bent beam.  Collective."""
        d2 = normal - (tangents @ normal)[:, None] * tangents
        d2 = d2 / np.linalg.norm(d2, axis=1, keepdims=True)
        q = fem.Function(self.space)
        x = self.space.tabulate_dof_coordinates()
        q.x.array[:] = np.hstack([x, d2, np.cross(tangents, d2)]).ravel()
        return q

    def stress_free(self, nodes: Indices) -> Array:
        """Position and directors (n, 3, 3) of local nodes where the beam is free of stress."""
        return self._reference.x.array.reshape(-1, 3, 3)[nodes]

    def measure(self, q: Expr) -> Expr:
        """Strains (Γ, γ2, γ3, κ2, κ3, τ) of the coordinates q (9,), less those of the mesh, with
        the initial strain added to Γ; κ and τ in [1/m]."""
        strains = beam_strain(q) - beam_strain(self._reference)
        initial = self.initial_strain
        if initial is None:
            return strains
        # UFL wants components of one kind: a plain 0 would be of another.
        zero = 0 * initial
        return strains + ufl.as_vector([initial, zero, zero, zero, zero, zero])

    def density(self, e: Expr) -> Expr:
        """Stored energy per unit reference length [J/m] of the strains e (6,)."""
        c = self.constants
        stiffnesses = (c.EA, c.GA2, c.GA3, c.EI2, c.EI3, c.GJ)
        return sum(stiffness * e[i] ** 2 for i, stiffness in enumerate(stiffnesses)) / 2

    def _free_strain(self, alphas: tuple[Expr, ...], ΔT: Expr) -> Expr:
        return ufl.as_vector([alphas[0] * ΔT] + [0 * ΔT] * (self.strains - 1))

    def axial_strain(self, e: Expr) -> Expr:
        """Axial strain Γ [-] of the strains e (6,) of `measure` less the thermal strain."""
        return e[0]

    def axial_force(self, q: Expr, S: Expr) -> Expr:
        """Axial force [N] of the stress S (6,) of the density, whatever the coordinates q (9,): the
        component along the normal of the section."""
        return S[0]

    def mass(self, v: Expr, w: Expr) -> ufl.Form:
        """Bilinear form of the mass of velocities v = (ẋ, ḋ2, ḋ3); ½ mass(v, v) is the kinetic
        energy [J]."""
        c = self.constants
        inertia = [c.line_density] * 3 + [c.rotary2] * 3 + [c.rotary3] * 3
        return sum(m * v[i] * w[i] for i, m in enumerate(inertia)) * self.mass_dx

    def terms(self, start: State) -> Iterable[Term]:
        yield KineticEnergy(self, self.mass)
        yield stored_energy(self, (), quadratic=True, discrete_derivative=self.discrete_derivative)
        # Orthonormality is ½ X·H X + L·X + c = 0 for the stacked directors X of a node: three
        # equations, and three multipliers, at each owned node.
        first, end = self.block.index_map.local_range
        directors = [self._directors(node) for node in range(first, end)]
        H, L, c = orthonormality(2)
        measure = PointMeasure(directors, H, L, c)
        yield PointConstraint(f"{self.name} directors", measure, keeps_orthonormal=True)

    def _directors(self, node: int) -> tuple[Port, Port]:
        """d2 and d3 of a global node as ports."""
        d2 = Port(self, (node,), weights=(1.0,), vectors=(1,))
        d3 = Port(self, (node,), weights=(1.0,), vectors=(2,))
        return d2, d3

    @check_arguments
    def frame(self, group: str) -> Frame:
        """Position and directors (d2, d3) at a named point of the mesh."""
        node = global_node(self, group)
        # One object for one node: frames are compared by identity.
        if node not in self._frames:
            position = Port(self, (node,))
            directors = self._directors(node)
            self._frames[node] = Frame(position, directors, name=f"{self.name}/{group}")
        return self._frames[node]

    @cached_property
    def _start(self) -> tuple[Array, Array]:
        """Coordinates and velocities at the start.  The rate [1/s] of a director is the difference
        of the given velocities at its tip and its root: a rigid velocity field gives exactly the
        rates of a rigid rotation."""
        # Coordinates q and rates v (n, 3, 3): position and two directors of each owned node.
        q = self._reference.x.array.reshape(-1, 3, 3)[: self.block.index_map.size_local]
        v = np.zeros_like(q)
        if self._velocity is not None:
            x = q[:, 0]
            v[:, 0] = self._velocity(x.T).T
            for k in (1, 2):
                v[:, k] = self._velocity((x + q[:, k]).T).T - v[:, 0]
        return q.ravel(), v.ravel()
