"""Films: membranes without bending stiffness on a triangle mesh in space."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import cached_property
from typing import TYPE_CHECKING, Annotated

import numpy as np
import ufl
from dolfinx import fem
from dolfinx.mesh import Mesh as DolfinxMesh
from dolfinx.mesh import meshtags

from gossamer_fx.core.checks.arguments import Mark, Range, check_arguments
from gossamer_fx.core.checks.errors import check
from gossamer_fx.core.checks.relations import at_most_one
from gossamer_fx.core.forms.backend import geometry_element
from gossamer_fx.core.forms.kinematics import (
    Expr,
    area_vector,
    cell_axes,
    green_lagrange,
    surface_gradient,
    tension,
)
from gossamer_fx.core.forms.strain_path import Piece
from gossamer_fx.core.mesh.mesh import Mesh
from gossamer_fx.core.model.body import Array, Indices
from gossamer_fx.core.model.state import State
from gossamer_fx.core.model.terms import Term
from gossamer_fx.mechanics.bodies.initial_strain import (
    Tensors,
    check_strain,
    check_stress,
    film_tensors,
    stored_energy,
    strain_in_frame,
    strain_of_stress,
)
from gossamer_fx.mechanics.bodies.meshed import (
    Meshed,
    PointFunction,
    checked,
    checked_function,
    positions,
)
from gossamer_fx.mechanics.bodies.properties import Property
from gossamer_fx.mechanics.materials.film import FilmLaw, parameters
from gossamer_fx.mechanics.terms.masses import KineticEnergy

if TYPE_CHECKING:
    from gossamer_fx.mechanics.materials.thermal import ThermalExpansion


@check_arguments(at_most_one("initial_strain", "initial_stress", "initial_tension"))
class Membrane(Meshed):
    """A film whose stress-free shape is the mesh, unless it is prestressed.

    Kinetic energy ½∫ρt |v|² dA, stored energy ∫W(E + E0) dA with the Green-Lagrange strain E of the
    surface from the mesh and the initial strain E0; dA is the reference area.

    Args:
        mesh: triangles in space, flat or curved.
        law: energy per unit area, e.g. `Miyazaki`.
        order: 1 (constant strain) or 2.
        properties: numbers of the law that differ from cell to cell, by "E", "nu", "density",
            "thickness": {group: value} for surfaces of the mesh (elsewhere the law's own), or a
            function of the cells' midpoints (3, n) that returns (n,).  E.g. devices on a sail:
            {"density": {"device": 2000.0}, "thickness": {"device": 25e-6}}.
        thermal: thermal expansion, with the temperature of the film; default none.
        initial_tension: the same as a force over a length [N/m], stress times thickness.
        initial_stress: stress [Pa] of the film in the shape of the mesh: a number (the same in all
            directions) or a tensor (3, 3), whose part in the film counts; {group: number or tensor}
            of surfaces of the mesh, elsewhere none; or a function of points (3, n) that returns
            (n,) or (3, 3, n).  Tensile for laws that wrinkle.
        initial_strain: E0 in place of a stress, given in the same way.
        displacement: initial displacement [m], a function of the points (3, n) that returns (3, n),
            or {group: function} of surfaces or lines of the mesh, elsewhere none, e.g. to open
            layers that coincide; of groups that share a node the last one counts there; default
            none.
        velocity: initial velocity [m/s], given in the same way.
        name: name in messages and output.

    Raises:
        InputError: a mesh or order that does not fit, both initial stress and strain, a compressive
            initial stress of film that wrinkles.

    Example:
        >>> law = gx.Miyazaki(2.5e9, 0.34, density=1420.0, thickness=25e-6)
        >>> film = gx.Membrane(mesh, law, order=1, displacement=lambda X: 1e-3 * X, name="sail")
        >>> film.name, film.block.size
        ('sail', 3)
    """

    def __init__(
        self,
        mesh: Mesh | DolfinxMesh,
        law: FilmLaw,
        *,
        order: Annotated[int, Range(1, 2)] = 1,
        properties: Mapping[str, Property] | None = None,
        thermal: ThermalExpansion | None = None,
        initial_stress: Tensors = None,
        initial_strain: Tensors = None,
        initial_tension: Tensors = None,
        displacement: PointFunction | Mapping[str, PointFunction] | None = None,
        velocity: PointFunction | None = None,
        name: str = "film",
    ) -> None:
        self._take_mesh(name, mesh, order, size=3, dim=2)
        domain = self.mesh.domain
        mesh_order = geometry_element(domain).degree
        check(
            order >= mesh_order,
            f"Membrane '{name}': a film of order {order} cannot take the curved shape of a mesh of "
            f"order {mesh_order} without stress; use order=2, or mesh with plane triangles.",
        )
        self.law = law
        self.constants = law.constants(domain)
        self._properties = properties  # a restart compares them, see `outputs.output`
        if properties:
            from gossamer_fx.mechanics.bodies.properties import vary

            vary(self.constants, law, self.mesh, properties, name)
        self._frame = cell_axes(domain)
        self._orient()
        self._take_expansion(thermal)
        # A restart compares these arguments, see `outputs.output`.
        self._initial_stress = initial_stress
        self._initial_strain = initial_strain
        self._initial_tension = initial_tension
        self._prestress()
        what = f"Membrane '{name}': its displacement"
        self._displacement: PointFunction | Mapping[str, PointFunction] | None
        if isinstance(displacement, Mapping):
            self._displacement = {
                group: checked_function(function, f"{what} of '{group}'", mesh.comm)
                for group, function in displacement.items()
            }
        else:
            self._displacement = checked(displacement, what, mesh.comm)
        self._velocity = checked(velocity, f"Membrane '{name}': its velocity", mesh.comm)

    def _orient(self) -> None:
        """Add the axes of an orthotropic law to the constants of the film.  Collective."""
        direction = getattr(self.law, "direction", None)
        if direction is not None:
            # Imported here: isotropic film has no axes.
            from gossamer_fx.mechanics.bodies.properties import direction_field, set_axes

            field = direction_field(self.mesh, direction, self.name)
            set_axes(self.constants, field, self._frame)

    def _free_strain(self, alphas: tuple[Expr, ...], ΔT: Expr) -> Expr:
        from gossamer_fx.mechanics.bodies.thermal_expansion import film_strain

        return film_strain(alphas, ΔT, self.constants)

    def _prestress(self) -> None:
        """Add the initial stress [Pa] or strain to the constants of the film, as a tensor (3, 3) in
        each cell.  Collective."""
        if self._initial_strain is not None:
            what = f"'{self.name}': its initial_strain"
            strains = film_tensors(self.mesh, self._initial_strain, what)
            check_strain(self.mesh, strains, what)
            self.constants.initial_strain = strains
        tension = self._initial_tension
        if self._initial_stress is not None or tension is not None:
            what = f"'{self.name}': its initial_stress"
            given = self._initial_stress
            if tension is not None:
                what = f"'{self.name}': its initial_tension"
                given = tension
            stresses = film_tensors(self.mesh, given, what)
            if tension is not None:
                thickness = self.constants.thickness
                # One number, or one of each cell.
                values = np.atleast_1d(getattr(thickness, "value", 0.0))
                if isinstance(thickness, fem.Function):
                    values = thickness.x.array
                stresses.x.array.reshape(-1, 9)[:] /= values[:, None]
            check_stress(self.mesh, stresses, self.law, what)
            self.constants.initial_stress = stresses

    @property
    def initial_strain(self) -> Expr | None:
        """E0 (E11, E22, 2 E12) in the frame of the film; None without prestress."""
        strains = getattr(self.constants, "initial_strain", None)
        if strains is not None:
            return strain_in_frame(strains, self._frame)
        stresses = getattr(self.constants, "initial_stress", None)
        if stresses is not None:
            return strain_of_stress(stresses, self._frame, self.law, self.constants)
        return None

    def measure(self, x: Expr) -> Expr:
        """Strain (E11, E22, 2 E12) at the positions x (3,) [m]: the Green-Lagrange strain from the
        mesh in the local frame of the triangles, and the initial one.

        The thermal strain is not subtracted from it, since that depends on the time of a scene; the
        fields `elastic_strain1` and `elastic_strain2` of a run have it subtracted.
        """
        strain = self.strain_from_mesh(x)
        initial = self.initial_strain
        if initial is not None:
            strain = strain + initial
        return strain

    def strain_from_mesh(self, x: Expr) -> Expr:
        """Green-Lagrange strain (E11, E22, 2 E12) from the mesh to the positions x."""
        return green_lagrange(self.deformation(x))

    def deformation(self, x: Expr) -> Expr:
        """Deformation gradient F (3, 2) of the positions x (3,), by the axes of the triangles."""
        return surface_gradient(x, self._frame)

    def density(self, e: Expr) -> Expr:
        """Stored energy per unit reference area [J/m²] of the strain e (3,)."""
        return self.law.energy(e, self.constants)

    def pieces(self, e0: Expr, e1: Expr) -> list[Piece]:
        """The pieces of the path from e0 to e1 on which the density is smooth; empty if the law
        does not know them."""
        return self.law.pieces(e0, e1, self.constants)

    @property
    def area_density(self) -> Expr:
        """Mass per unit reference area [kg/m²]."""
        return self.constants.density * self.constants.thickness

    def terms(self, start: State) -> Iterable[Term]:
        numbers = parameters(self.law, self.constants)
        yield KineticEnergy(
            self,
            lambda v, w: self.area_density * ufl.inner(v, w) * self.mass_dx,
            parameters=numbers,
        )
        # A law that wrinkles has tensile stresses only.  Of another law the compressive part makes
        # the geometric stiffness indefinite; the iteration may leave it out.
        pulling = tension if self.law.quadratic else None
        yield stored_energy(
            self,
            numbers,
            self.law.quadratic,
            pieces=self.pieces,
            pulling=pulling,
            c_law=self.law.c_law(self.constants, self.comm),
            area_vector=self._area_vector if self.law.resists_loss_of_area else None,
        )

    def _area_vector(self, x: Expr) -> Expr:
        """Normal (3,) of the film at the positions x, times its area per unit reference area."""
        return area_vector(self.deformation(x))

    @cached_property
    def _start(self) -> tuple[Array, Array]:
        """Positions and velocities at the start.  At nodes of several groups of the displacement
        the last one counts."""
        if not isinstance(self._displacement, Mapping):
            return positions(self.space, self._displacement, self._velocity)
        # Positions x and velocities v of this rank's own nodes, (3 n,).
        x, v = positions(self.space, None, self._velocity)
        points = x.reshape(-1, 3)
        moved = points.copy()
        for group, function in self._displacement.items():
            nodes = self.nodes(group)
            # Ghosts belong to another rank, which moves them.
            owned = nodes[nodes < len(points)]
            moved[owned] = points[owned] + function(points[owned].T).T
        return moved.ravel(), v


def edge_measure(film: Membrane, kind: str, edges: Indices, degree: int) -> ufl.Measure:
    """The measure "ds" of local edges (n,) on the rim of a film, or "dS" of edges between its
    triangles, for integrands of a degree."""
    domain = film.mesh.domain
    # Integrals over edges need the triangles next to them.
    domain.topology.create_connectivity(1, 2)
    tags = meshtags(domain, 1, edges, np.ones(len(edges), dtype=np.int32))
    metadata = {"quadrature_degree": degree}
    return ufl.Measure(kind, domain, subdomain_data=tags, metadata=metadata)(1)


FullFilm = Annotated[Membrane, Mark(lambda film: film.full is film, "the film that was reduced")]
