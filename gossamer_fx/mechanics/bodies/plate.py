"""Thin plates: films of order 2 that resist bending."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import ufl
from dolfinx import fem, la
from dolfinx.mesh import Mesh as DolfinxMesh

from gossamer_fx.core.checks.arguments import check_arguments
from gossamer_fx.core.checks.errors import check, check_on_all, real_numbers
from gossamer_fx.core.forms.backend import (
    cell_nodes,
    facets_of,
    geometry_element,
    geometry_nodes,
)
from gossamer_fx.core.forms.bending import (
    DEGREE,
    EDGE_DEGREE,
    PENALTY,
    Bending,
    OrthotropicBending,
    curvature,
)
from gossamer_fx.core.forms.cell_loops import tabulation
from gossamer_fx.core.forms.compilation import constant
from gossamer_fx.core.forms.kinematics import Expr
from gossamer_fx.core.forms.tied_strain import tied_strain
from gossamer_fx.core.mesh.edges import EdgeTable
from gossamer_fx.core.mesh.mesh import Mesh
from gossamer_fx.core.mesh.quality import area_vectors, turned_inside
from gossamer_fx.core.model.body import Array, Indices
from gossamer_fx.core.model.state import State
from gossamer_fx.core.model.terms import Term
from gossamer_fx.mechanics.bodies.initial_strain import Tensors
from gossamer_fx.mechanics.bodies.membrane import Membrane, edge_measure
from gossamer_fx.mechanics.bodies.meshed import PointFunction
from gossamer_fx.mechanics.bodies.properties import Property, cell_normals, cellwise, owned_values
from gossamer_fx.mechanics.bodies.triple_products import TripleProductEnergy
from gossamer_fx.mechanics.materials.film import FilmLaw
from gossamer_fx.mechanics.terms.energies_in_time import Varying
from gossamer_fx.mechanics.terms.quadratic_energies import QuadraticEnergy

if TYPE_CHECKING:
    from gossamer_fx.mechanics.materials.thermal import ThermalExpansion

# Sine of the angle between neighbouring cells below which they count as lying in one plane.
FLAT = 1e-6

# The same sine, below which the plane triangles of a curved plate are close to it: 45 degrees.
CLOSE = 0.7

# Distance of the middle node of a curved edge from the middle of its chord, over the length of the
# chord, from which on the edge turns back at a corner, or rises there by 45 degrees.
FARTHEST_MIDDLE = 0.24

# Share of a given curvature below which its antisymmetric and its normal part count as zero.
CURVATURE_TOLERANCE = 1e-6

# [m²] Lower bound of lengths of normals, so that a cell without area has no division by zero.
SMALLEST_NORMAL = 1e-300

Tensor = Sequence[Sequence[float]]  # 3x3


@check_arguments
class Plate(Membrane):
    """A film with bending stiffness D = E t³/(12 (1-ν²)) [N m]; strains are small, motions of any
    size.

    To the energies of `Membrane` comes ½ a(x, x) of `forms.bending`, or with a rest curvature H0
    ½∫ (κ - H0):D:(κ - H0) dA, κ = n·D²x.  Its membrane strain is `forms.tied_strain`, which does
    not lock however thin the plate is.  The rim is free, simply held by `Fixed`, or clamped by
    `Fixed(..., rotation=True)`.

    In its own plane a strip of the width b is too stiff against bending by 1 + 3 (t/b)², as the
    energy ½ D|D²x|² counts the curvature of its lines in the plane, too: 3 % at t/b = 0.1, where a
    warning says so; take a `Beam` for narrower ones.

    Bending matters for wrinkles of a few cells or longer: cells of size h carry compressive strains
    of up to (π t/h)²/(48 (1-ν²)), and for t/h < 1e-4 that is nothing: take a `Membrane`, which
    costs less.

    Args:
        mesh: plane triangles with straight edges, of which neighbours lie in one plane unless a
            hinge is between them; or curved triangles of order 2, whose middle nodes may lie
            anywhere on their edges up to a quarter of the length from the middle.
        law: energy per unit area, e.g. `Linear` or `LinearOrthotropic`; its moduli and thickness
            give the bending stiffness, D_ij = A_ij t²/12 of an orthotropic one.
        order: 2.  (Order 1 is refused: D²x is zero in its cells, and the jumps of the slope alone
            converge to a stiffness that depends on the pattern of the mesh.)
        hinges: names of groups of interior edges that transmit no bending moment.
        bending: D11, D12, D22, D66 [N m] in the axes of an orthotropic law, for laminates and
            sandwiches; there is no coupling of bending with membrane strain (B = 0, a symmetric
            laminate).
        rest_curvature: H0 [1/m], a symmetric tensor (3, 3) in the plane of the mesh; or {group:
            tensor} of surfaces of the mesh; or a function of points (3, n) that returns (3, 3, n).
            H0 is positive where the plate without moments bends towards the normal of the mesh.
            It is added to the curvature of a curved mesh.
        thermal: thermal expansion; its `gradient` across the thickness changes the curvature
            without moments.
        properties, initial_stress, initial_strain, initial_tension, displacement, velocity: as of
            `Membrane`.
        name: name in messages and output.

    Raises:
        InputError: a mesh of order 1 that is curved, a group that is not a line of interior edges,
            a rest curvature out of the plane, a law without bending stiffness such as `NeoHooke`.

    Example:
        >>> law = gx.Linear(70e9, 0.3, density=2700.0, thickness=1e-3)
        >>> plate = gx.Plate(mesh, law, rest_curvature=np.diag((0.5, 0.0, 0.0)))
        >>> plate.order
        2
    """

    bends = True

    def __init__(
        self,
        mesh: Mesh | DolfinxMesh,
        law: FilmLaw,
        *,
        order: int = 2,
        hinges: Sequence[str] = (),
        bending: tuple[float, float, float, float] | None = None,
        rest_curvature: Tensor | Mapping[str, Tensor] | Callable[[Array], Array] | None = None,
        properties: Mapping[str, Property] | None = None,
        thermal: ThermalExpansion | None = None,
        initial_stress: Tensors = None,
        initial_strain: Tensors = None,
        initial_tension: Tensors = None,
        displacement: PointFunction | Mapping[str, PointFunction] | None = None,
        velocity: PointFunction | None = None,
        name: str = "plate",
    ) -> None:
        check(
            order == 2,
            f"Plate '{name}': order is {order!r}; "
            "use 2 (of order 1 the curvature is zero in every cell, and the angles "
            "between cells alone give a stiffness that depends on the pattern of the mesh).",
        )
        check(
            type(law).bending_stiffness is not FilmLaw.bending_stiffness,
            f"Plate '{name}': {type(law).__name__} has no bending stiffness; give a law of small "
            "strain such as Linear, or make it a Membrane.",
        )
        given = mesh if isinstance(mesh, Mesh) else Mesh(mesh)
        domain = given.domain
        degree = geometry_element(domain).degree
        check(
            degree <= 2,
            f"Plate '{name}': its mesh is of order {degree}; use a mesh of order 1 or 2.",
        )
        # The forms are written for plane triangles.
        if degree == 2:
            turned = turned_inside(domain)
            check(
                turned == 0,
                f"Plate '{name}': its mesh has {turned} curved triangles that turn inside out near "
                "a corner; mesh it finer there, or with plane triangles.",
            )
            given = Mesh(facets_of(given.domain), given.groups)
        super().__init__(
            given,
            law,
            order=2,
            properties=properties,
            thermal=thermal,
            initial_stress=initial_stress,
            initial_strain=initial_strain,
            initial_tension=initial_tension,
            displacement=displacement,
            velocity=velocity,
            name=name,
        )
        self.shape: fem.Function | None = None
        if degree == 2:
            self._take_shape(domain)
        self.hinges = tuple(hinges)
        repeated = sorted({group for group in self.hinges if self.hinges.count(group) > 1})
        check(
            not repeated,
            f"Plate '{name}': the hinge group '{repeated[0] if repeated else ''}' is given twice; "
            "give it once.",
        )
        # A restart compares this argument, see `outputs.output`.
        self._rest_curvature = rest_curvature
        table = self.mesh.edges
        folds = [interior_edges(self, table, group, "hinge") for group in self.hinges]
        self._hinged = np.unique(np.concatenate([np.zeros(0, dtype=np.int32), *folds]))
        self._check_angles(table)
        # A restart compares this argument, too.
        self._bending = bending
        self.bending_stiffness = self.law.bending_stiffness(self.constants)
        if bending is not None:
            self.bending_stiffness = self._given_bending(bending)
        rest = None
        if self.shape is not None:
            rest = self.curvature(self.shape)
        if rest_curvature is not None:
            given_rest = self._rest(rest_curvature)
            rest = given_rest if rest is None else rest + given_rest
        # The bending energy; `_bending` is the argument, `bending_stiffness` the tensor.
        self.bending = self._bending_about(rest)

    def _take_shape(self, domain: DolfinxMesh) -> None:
        """Take the nodes of a mesh of order 2 as the stress-free shape, `shape`.  Collective.

        Its tied strain from the plane triangles goes to `_strain_of_shape`, which
        `strain_from_mesh` subtracts, so that the shape has no strain.
        """
        self.shape = fem.Function(self.space, name="shape")
        # Nodes of a cell have the same order in both.
        nodes = self._centred(domain.geometry.x[geometry_nodes(domain)])
        self.shape.x.array.reshape(-1, 3)[cell_nodes(self.space)] = nodes
        # The strain of the shape from the plane triangles, which is linear in each of them.
        strain = tied_strain(self.mesh.domain, self.shape, self._frame)
        linear = fem.functionspace(self.mesh.domain, ("Discontinuous Lagrange", 1, (3,)))
        self._strain_of_shape = fem.Function(linear)
        tabulation(strain, self._strain_of_shape)()

    def _centred(self, nodes: Array) -> Array:
        """Nodes (n, 6, 3) [m] of curved triangles, whose middle nodes are moved along the surface
        to above the middles of the chords, those of the rim along the rim.

        The forms derive by the coordinates of the plane triangles, in which a straight line is to
        be straight and passed evenly: a middle node elsewhere on the surface would count as strain
        and curvature. `InputError`: a node is too far from its chord.  Collective.
        """
        centred = nodes.copy()
        normals = self._normals_between(nodes)
        for i, (a, b) in enumerate(((1, 2), (2, 0), (0, 1))):
            # Node 3 + i lies on the edge opposite vertex i.
            middle = nodes[:, 3 + i]
            chord = nodes[:, b] - nodes[:, a]
            square = np.maximum((chord**2).sum(axis=1), SMALLEST_NORMAL)
            offset = middle - (nodes[:, a] + nodes[:, b]) / 2
            # Parts of the offset along and across the chord, over its length.
            along = (offset * chord).sum(axis=1) / square
            across = np.linalg.norm(offset - along[:, None] * chord, axis=1) / np.sqrt(square)
            share = np.maximum(np.abs(along), across)
            # Written so that NaN is refused.
            is_far = ~(share <= FARTHEST_MIDDLE)
            worst = int(np.argmax(np.where(np.isfinite(share), share, np.inf))) if len(share) else 0
            words = ""
            if is_far.any():
                at = ", ".join(f"{x:.6g}" for x in nodes[worst, :3].mean(axis=0))
                distance = float(np.linalg.norm(offset[worst]))
                words = (
                    f"Plate '{self.name}': the middle node of an edge of the triangle at ({at}) is "
                    f"{distance:.3g} m from the middle of the edge, which is "
                    f"{math.sqrt(square[worst]):.3g} m long; put it nearer than "
                    f"{FARTHEST_MIDDLE:g} of the length, or mesh it finer."
                )
            check_on_all(self.comm, not words, words)
            # The edge is the parabola c(s) through its nodes; where is it above the middle?
            # s + 4 along s (1 - s) = ½, of which this root has no cancellation.
            root = np.sqrt((1 + 4 * along) ** 2 - 8 * along)
            s = (1 / (1 + 4 * along + root))[:, None]
            centred[:, 3 + i] = (
                (1 - s) * (1 - 2 * s) * nodes[:, a]
                + 4 * s * (1 - s) * middle
                + s * (2 * s - 1) * nodes[:, b]
            )
            # Between two triangles the height above the chord is kept, along the normal of both.
            between = normals[:, i].any(axis=1)
            chord_middle = (nodes[between, a] + nodes[between, b]) / 2
            normal = normals[between, i]
            height = (normal * (centred[between, 3 + i] - chord_middle)).sum(axis=1)
            centred[between, 3 + i] = chord_middle + height[:, None] * normal
        return centred

    def _normals_between(self, nodes: Array) -> Array:
        """Unit normals (n, 3, 3) at the middle nodes of triangles with nodes (n, 6, 3) [m]: the
        mean of those of both triangles at the edge, zero at the rim.  Collective."""
        space = self.space
        owned = self.mesh.domain.topology.index_map(2).size_local
        middles = cell_nodes(space)[:, 3:]
        vectors = np.repeat(area_vectors(nodes[:, :3])[:, None], 3, axis=1)
        # The sum of the normals, and the number of triangles.
        sums = la.vector(space.dofmap.index_map, 4)
        array = sums.array.reshape(-1, 4)
        lengths = np.linalg.norm(vectors, axis=2, keepdims=True)
        units = vectors / np.maximum(lengths, SMALLEST_NORMAL)
        counted = np.concatenate([units, np.ones_like(lengths)], axis=2)
        np.add.at(array, middles[:owned].ravel(), counted[:owned].reshape(-1, 4))
        sums.scatter_reverse(la.InsertMode.add)
        sums.scatter_forward()
        found = array[middles]
        mean = found[..., :3] / np.maximum(
            np.linalg.norm(found[..., :3], axis=2, keepdims=True), SMALLEST_NORMAL
        )
        return np.where(found[..., 3:] == 2, mean, 0.0)

    @cached_property
    def _start(self) -> tuple[Array, Array]:
        """Positions and velocities of `Membrane`, moved from the plane triangles to the curved
        shape if there is one."""
        x, v = super()._start
        if self.shape is not None:
            x = x + self.shape.x.array[: len(x)]
            x -= self.space.tabulate_dof_coordinates().ravel()[: len(x)]
        return x, v

    def _given_bending(self, bending: tuple[float, float, float, float]) -> OrthotropicBending:
        """The bending stiffness D11, D12, D22, D66 [N m] that a user gave, in the axes of the
        orthotropic law."""
        # Constants of the law; with axes cosine and sine of their angle in the frame of the mesh.
        c = self.constants
        check(
            hasattr(c, "cosine"),
            f"Plate '{self.name}': bending is given, but {type(self.law).__name__} has no axes; "
            "use LinearOrthotropic.",
        )
        D11, D12, D22, D66 = bending
        check(
            D11 > 0 and D22 > 0 and D66 > 0 and D12**2 < D11 * D22,
            f"Plate '{self.name}': "
            f"its bending stiffnesses {bending!r} N m are not positive definite; "
            "give D11, D22, D66 > 0 and D12² < D11 D22.",
        )
        domain = self.mesh.domain
        return OrthotropicBending(
            D11=constant(domain, D11),
            D12=constant(domain, D12),
            D22=constant(domain, D22),
            D66=constant(domain, D66),
            cosine=c.cosine,
            sine=c.sine,
        )

    def strain_from_mesh(self, x: Expr) -> Expr:
        """Tied Green-Lagrange strain (E11, E22, 2 E12) from the mesh to the positions x."""
        strain = tied_strain(self.mesh.domain, x, self._frame)
        if self.shape is not None:
            strain -= self._strain_of_shape
        return strain

    def curvature(self, x: Expr) -> Expr:
        """κ (2, 2) [1/m] of the positions x, in the frame of the mesh."""
        return curvature(x, self._frame)

    def moment(self, x: Expr) -> Expr:
        """Bending moment per length (2, 2) [N m/m] of the positions x: D:(κ - H0)."""
        κ = self.curvature(x)
        if self.bending.rest is not None:
            κ -= self.bending.rest
        return self.bending_stiffness.moment(κ)

    def terms(self, start: State) -> Iterable[Term]:
        # dx and dS are measures of the cells and of the interior edges without hinges; w is the
        # test function.
        yield from super().terms(start)
        bending = self.bending
        name = f"{self.name} bending"
        dx = ufl.Measure("dx", self.mesh.domain, metadata={"quadrature_degree": DEGREE})
        dS = self._transmitting()
        yield QuadraticEnergy(
            name, self, lambda x, w: bending.cells(x, w, dx) + bending.edges(x, w, dS)
        )
        if bending.rest is None and not self.has_thermal_curvature:
            return
        yield self._rest_energy(name, dx, dS)

    @property
    def has_thermal_curvature(self) -> bool:
        """Whether a difference of temperature across the thickness bends the free plate."""
        return self.thermal is not None and self.thermal.gradient is not None

    def _rest_energy(self, name: str, dx: ufl.Measure, dS: ufl.Measure) -> TripleProductEnergy:
        """The part of the bending energy that a rest curvature and a thermal curvature add.

        With the curvature H0 without moments, its moment M0 and the curvature κ = n·D²x of the
        moved surface it is ½∫ M0:H0 dA - ∫ M0:κ dA and a sum over interior edges.  These are
        integrals of triple products of three vectors that are linear in the positions.
        """
        domain = self.mesh.domain
        bending = self.bending
        varying = None
        if self.has_thermal_curvature:
            from gossamer_fx.mechanics.bodies.thermal_expansion import thermal_curvature

            thermal = thermal_curvature(self)
            varying = Varying(thermal.difference, thermal.set)
            rest = thermal.curvature
            if bending.rest is not None:
                rest += bending.rest
            bending = self._bending_about(rest)

        def scaled(
            vectors: Callable[[Expr], Any], scale: Expr
        ) -> Callable[[Expr], tuple[Expr, Expr, Expr]]:
            """Divide the third of the three vectors by a scale, so that all three are
            dimensionless."""

            def dimensionless(x: Expr) -> tuple[Expr, Expr, Expr]:
                # The three factors of a triple product (u×v)·s.
                u, v, s = vectors(x)
                return u, v, s / scale

            return dimensionless

        area = ufl.CellVolume(domain)
        length = ufl.FacetArea(domain)("+")
        # A bending stiffness [N m] of each cell, by which the products are scaled.
        D = self.bending_stiffness.reference
        mean = (D("+") + D("-")) / 2
        # In a plane plate the products are of degree 2.  In a curved one they cancel the bending
        # energy at each of its points.
        inside = dx
        if self.shape is None:
            inside = ufl.Measure("dx", domain, metadata={"quadrature_degree": 2})
        products = [
            (D / area, scaled(bending.rest_in_cells, D / area), inside),
            (mean / length, scaled(bending.rest_at_edges, mean / length), dS),
        ]
        constant_energy = bending.rest_energy(dx)
        if self.shape is not None:
            constant_energy += bending.shape_energy(dx, dS)
        return TripleProductEnergy(name, self, products, constant_energy, varying)

    def _bending_about(self, rest: Expr | None) -> Bending:
        """The bending energy with a rest curvature (2, 2) [1/m]; None stands for zero."""
        domain = self.mesh.domain
        # A constant, so that another penalty needs no new kernel.
        penalty = constant(domain, PENALTY)
        return Bending(domain, self._frame, self.bending_stiffness, penalty, rest, self.shape)

    def _transmitting(self) -> ufl.Measure:
        """The measure "dS" of the interior edges that transmit bending moments: all but the hinges.
        Collective."""
        domain = self.mesh.domain
        if not self.hinges:
            return ufl.Measure("dS", domain, metadata={"quadrature_degree": EDGE_DEGREE})
        edges = domain.topology.index_map(1)
        # A hinge transmits no moment: its edges have no bending form.
        others = np.setdiff1d(
            np.arange(edges.size_local + edges.num_ghosts, dtype=np.int32), self._hinged
        )
        return edge_measure(self, "dS", others, EDGE_DEGREE)

    def _check_angles(self, table: EdgeTable) -> None:
        """Check that neighbouring triangles lie in one plane unless a hinge is between them, those
        of a curved mesh nearly so.  Collective."""
        edges = np.setdiff1d(np.flatnonzero(table.is_inside & table.is_known), self._hinged)
        domain = self.mesh.domain
        corners = domain.geometry.x[geometry_nodes(domain)[:, :3]]
        normals = area_vectors(corners)
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), SMALLEST_NORMAL)
        left, right = normals[table.cells[edges]].transpose(1, 0, 2)
        sines = np.linalg.norm(np.cross(left, right), axis=1)
        advice = (
            "its mesh is curved, or folded elsewhere than at its hinges; give curved triangles "
            "(a mesh of order 2), or hinges."
        )
        limit = FLAT
        if self.shape is not None:
            limit = CLOSE
            # Beyond a right angle the sine falls again.
            sines[np.einsum("ni,ni->n", left, right) < 0] = 1.0
            advice = "neighbours in its curved mesh are at more than 45 degrees; use smaller cells."
        check_on_all(self.comm, bool((sines < limit).all()), f"Plate '{self.name}': {advice}")

    def _rest(self, given: Any) -> Expr:
        """The curvature H0 (2, 2) [1/m] without moments in the frame of the mesh, from a given
        tensor (3, 3), {group: tensor} or function of midpoints.  Collective."""
        what = f"Plate '{self.name}': its rest_curvature"
        base: Array = np.zeros((3, 3))
        if not callable(given) and not isinstance(given, Mapping):
            tensor = real_numbers(given)
            if tensor is None:
                tensor = np.zeros(0)
            check(
                tensor.shape == (3, 3),
                f"{what} is not an array (3, 3) of real numbers; "
                "give a tensor in 1/m, a function of the points, or those of groups.",
            )
            base = tensor
            given = {}
        # H: the given tensor (3, 3) [1/m] of each cell, in the axes of space.
        H = cellwise(self.mesh, given, base, (3, 3), what)
        values = owned_values(H)
        normals = cell_normals(self.mesh)
        size = CURVATURE_TOLERANCE * np.abs(values).max(initial=0.0)
        asymmetry = np.abs(values - values.transpose(0, 2, 1)).max(initial=0.0)
        out_of_plane = np.abs(np.einsum("nij,nj->ni", values, normals)).max(initial=0.0)
        check_on_all(
            self.comm,
            bool(asymmetry <= size and out_of_plane <= size),
            f"{what} is not a symmetric tensor in the plane of the mesh; "
            "give κ e⊗e with e in that plane.",
        )
        return ufl.dot(self._frame.T, ufl.dot(H, self._frame))


def interior_edges(plate: Membrane, table: EdgeTable, group: str, what: str) -> Indices:
    """Local edges (n,) of a named group of curves, each between two triangles, for a use such as
    "hinge".  Collective."""
    edges = plate.mesh.curve(group, f"'{plate.name}', {what}")
    check_on_all(
        plate.comm,
        bool(table.is_inside[edges].all()),
        f"'{plate.name}': the {what} '{group}' has edges on the rim; name a line between cells.",
    )
    return edges
