"""The rotation-closed basis of a reduced film, scalar modes times vectors, and the `Snapshots` of
the film from which it is made.

Problem.  A sail has 1e4 to 1e6 unknowns, and a design study needs hundreds of its flights.
Recorded motions lie near a subspace of low dimension, in which the equations of motion can be
solved.  Proper orthogonal decomposition gives such a subspace, but its modes are vector fields with
fixed directions in space: if the sail turns, the turned shape is not in the subspace.  The reduced
sail then has no angular momentum that is conserved, and a spinning sail needs modes for every
angle.

Idea.  Take modes that are scalars, with vectors as unknowns:

    x(X, t) = Σ_i φ_i(X) c_i(t),      i = 0 ... r-1,   c_i ∈ R³                              (1)

For every rotation R the shape R x has the coefficients R c_i: the set of shapes (1) is closed under
rotation.  With φ_0 = 1 it is closed under translation too.  Positions are linear in c, so strains
are quadratic in c as they are in the nodal positions, and the time stepping rule applies to c
without change: it conserves energy, momentum and angular momentum of the reduced film as of the
full one.

Algorithm.  For snapshots x_k of the film at n nodes, with the mass matrix M (scalar, n × n) and the
mass m:

1. Fixed modes: 1, X, Y, and Z if the film is not plane, made orthogonal.  All homogeneous motions,
   which include the rigid ones, are exact.

       φ_iᵀ M φ_j = m δ_ij                                                                 (2)

2. Subtract the fixed modes from the snapshots.  Split the remainder into its part across the mean
   plane of the film and its part in that plane, and scale both to the same size, see `_scaled`.
   Columns of A (n, 3 · snapshots) are the components.
3. Method of snapshots (Sirovich, Q. Appl. Math. 45 (1987) 561, doi:10.1090/qam/910462): the Gram
   matrix has the squares of the singular values σ of A in the norm of the mass,

       AᵀMA v = σ² v,      φ = A v/σ                                                        (3)

   It is a small matrix, the same on every rank; no field is gathered on one rank.
4. Take the modes of the largest singular values and make them orthogonal again by (2), as (3) loses
   half of the digits.

Cost: products with M, one for each three columns of A, and one eigenvalue problem of the size of
the number of columns.

Limits: motions that are not among the snapshots may be far from the basis.  `OutsideBasis`
estimates by how much.  A mode costs three unknowns, whichever direction it moves in.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import ufl
from dolfinx import fem, la

from gossamer_fx.core.checks.arguments import check_arguments
from gossamer_fx.core.checks.errors import check
from gossamer_fx.core.checks.lookups import check_in_scene
from gossamer_fx.core.forms.compilation import compile_form
from gossamer_fx.core.model.body import Array
from gossamer_fx.mechanics.bodies.membrane import Membrane
from gossamer_fx.records.outputs.output import Every, Output, Schedule, Times
from gossamer_fx.solve.view import StateView


class Shapes:
    """Shapes of a film, from which a reduced model of it is made.

    Attributes:
        positions: arrays (n, 3) [m] of this rank's nodes, one for each shape.
    """

    positions: Sequence[Array]


@check_arguments
class Snapshots(Output, Shapes):
    """Output that keeps positions of a film's nodes in memory; each rank keeps those of the nodes
    that it owns.

    Args:
        body: the film.
        every: number of steps between two shapes, 1 by default.
        times: times [s] of the shapes instead; not together with `every`.

    Attributes:
        positions: list of arrays (n, 3) [m], one for each shape.

    Raises:
        InputError: when the run starts, the film is not in its scene.

    Example:
        >>> shapes = gx.reduction.Snapshots(film, every=10)
        >>> scene = gx.Scene(film, gx.Fixed(film, "left"), gx.Gravity(film))
        >>> gx.Simulation(scene, gx.Midpoint(dt=1e-3), outputs=[shapes]).run(until=2e-2)
        >>> len(shapes.positions)
        3
    """

    def __init__(self, body: Membrane, every: Every | None = None, *, times: Times = ()) -> None:
        self.body = body
        self.schedule = Schedule.of("Snapshots", every, times)
        self.positions: list[Array] = []

    @property
    def times(self) -> Sequence[float]:
        """Times [s] at which the run has to end a step; empty if shapes follow steps."""
        return self.schedule.times

    def open(self, run: StateView) -> None:
        bodies = run.system.unknowns.bodies
        check_in_scene(f"Snapshots: '{self.body.name}'", self.body in bodies)
        self.positions.clear()

    def record(self, run: StateView, last: bool) -> None:
        # Shapes follow steps or given times, and no interval.
        if self.schedule.due(run.step, run.time, last, since=None):
            # a copy: the state changes in place
            self.positions.append(run.system.unknowns.state[self.body].positions().copy())

    def close(self, run: StateView) -> None:
        """Do nothing: the shapes stay in memory."""


# Snapshots of which the basis keeps the coefficients.  Cells are sampled for them (`sampling`);
# more of them cost time there in proportion.
MAX_EXAMPLES = 8

# Singular values below this share of the largest are round-off: eigenvalues of the Gram matrix are
# their squares, and have a relative round-off of 1e-14.
MIN_SINGULAR_VALUE_RATIO = 1e-7

# Share of the squared norm of a fixed mode that has to be independent of the others: Z of a film
# that is plane but for round-off is not a mode.
MIN_INDEPENDENT_SHARE = 1e-10

# One pass of Gram-Schmidt leaves round-off times the condition number; a second one removes it.
ORTHOGONALISATION_PASSES = 2

# Smallest divisor in place of zero
TINY = 1e-300


@dataclass(frozen=True, eq=False)
class Basis:
    """The modes φ (nodes, r) of a reduced film of mass m [kg], at its owned and ghost nodes, see
    (1) and (2) of the module; φ_0 = 1.

    The first `fixed_count` of them, 3 or for a film that is not plane 4, represent homogeneous
    motions.  `singular_values` are those of the scaled snapshots without the fixed modes, in the
    norm of the mass, in falling order; `examples` coefficients (k, r, 3) [m] of some snapshots.
    """

    film: Membrane
    values: Array
    mass: float
    singular_values: Array
    fixed_count: int
    examples: Array

    @property
    def size(self) -> int:
        """Number of modes r."""
        return self.values.shape[1]

    def project(self, x: Array) -> tuple[Array, float]:
        """Nearest coefficients (r, 3) of a vector field x (n, 3) at owned nodes, in its unit, and
        the share of ∫ρt |x|² dA outside of the basis, from 0 to 1.  Collective."""
        product = mass_times(self.film, x[:, :, None])[:, :, 0]
        own_modes = self.values[: len(x)]
        # One message for both sums: the square stands in an additional row.
        own_square = [[np.sum(x * product), 0, 0]]
        own_sums = np.concatenate([own_modes.T @ product, own_square])
        sums = self.film.comm.allreduce(own_sums)
        coefficients = sums[:-1] / self.mass
        square = float(sums[-1, 0])
        if square == 0:
            return coefficients, 0.0
        inside = self.mass * float(np.sum(coefficients * coefficients))
        return coefficients, max(square - inside, 0.0) / square


# ---- products with the mass matrix ---------------------------------------------------------------


def mass_times(film: Membrane, x: Array) -> Array:
    """The product M x (n, 3, k) of the mass matrix with k vector fields at the owned nodes: for x
    in m in kg m.  Collective."""
    field = fem.Function(film.space)
    test = ufl.TestFunction(film.space)
    form = compile_form(film.area_density * ufl.inner(field, test) * film.mass_dx)
    product = la.vector(film.space.dofmap.index_map, 3)
    owned = 3 * len(x)
    result = np.empty_like(x)
    for k in range(x.shape[2]):
        field.x.array[:owned] = x[:, :, k].ravel()
        field.x.scatter_forward()
        product.array[:] = 0
        fem.assemble_vector(product.array, form)
        product.scatter_reverse(la.InsertMode.add)
        result[:, :, k] = product.array[:owned].reshape(-1, 3)
    return result


def scalar_mass_times(film: Membrane, fields: Array) -> Array:
    """The product M f (n, k) [kg] of the mass matrix with k dimensionless scalar fields at the
    owned nodes.  Collective."""
    n, k = fields.shape
    # Three scalars at once, as the components of one vector field
    triples = -(-k // 3)
    padded = np.zeros((n, 3 * triples))
    padded[:, :k] = fields
    vectors = padded.reshape(n, triples, 3).transpose(0, 2, 1)
    products = mass_times(film, vectors).transpose(0, 2, 1)
    return products.reshape(padded.shape)[:, :k]


# ---- modes ---------------------------------------------------------------------------------------


def make_basis(film: Membrane, snapshots: Sequence[Array], count: int) -> Basis:
    """Compute the fixed modes, 1 and the coordinates of the stress-free mesh, and the `count`
    strongest modes of snapshots, positions (n, 3) [m] of owned nodes.  Collective."""
    _check_snapshots(film, snapshots, count)
    comm = film.comm
    n = film.space.dofmap.index_map.size_local
    mass = float(comm.allreduce(scalar_mass_times(film, np.ones((n, 1))).sum()))
    # Step 1 of the module
    X = film.space.tabulate_dof_coordinates()[:n]
    candidates = np.column_stack([np.ones(n), X])
    fixed_modes = mass**0.5 * _gram_schmidt(film, candidates)
    # Without round-off: linear momentum is that of c_0.
    fixed_modes[:, 0] = 1.0
    # Step 2
    A = _scaled(film, snapshots, fixed_modes, mass)
    # Step 3
    gram = comm.allreduce(A.T @ scalar_mass_times(film, A))
    squares, vectors = np.linalg.eigh((gram + gram.T) / 2)
    # eigh sorts in rising order
    singular_values = np.sqrt(np.maximum(squares[::-1], 0.0))
    found = _count_modes(singular_values)
    check(
        count <= found,
        f"reduce: the snapshots of '{film.name}' hold {found} modes, not {count}; ask for fewer, "
        "or record more.",
    )
    strongest = vectors[:, ::-1][:, :count]
    modes = A @ (strongest / singular_values[:count])
    # Step 4
    modes = _orthogonal_to_fixed(film, modes, fixed_modes, mass)
    values = np.column_stack([fixed_modes, mass**0.5 * modes])
    return Basis(
        film=film,
        values=_with_ghosts(film, values),
        mass=mass,
        singular_values=singular_values[:found],
        fixed_count=fixed_modes.shape[1],
        examples=_examples(film, snapshots, values, mass),
    )


def _check_snapshots(film: Membrane, snapshots: Sequence[Array], count: int) -> None:
    """Refuse no snapshots, and snapshots of another mesh.  Collective."""
    check(
        bool(snapshots),
        "reduce: there are no snapshots; record the film with `Snapshots` first.",
    )
    shape = (film.space.dofmap.index_map.size_local, 3)
    differ = any(snapshot.shape != shape for snapshot in snapshots)
    # A mesh may have the same number of nodes on some ranks.
    ranks_that_differ = film.comm.allreduce(int(differ))
    check(
        not ranks_that_differ,
        f"reduce: a snapshot is of another mesh than '{film.name}'; record this film.",
    )


def _count_modes(singular_values: Array) -> int:
    """How many singular values, in falling order, are more than round-off: more than
    `MIN_SINGULAR_VALUE_RATIO` of the largest."""
    largest = singular_values[0]
    if largest <= 0:
        return 0
    return int((singular_values > MIN_SINGULAR_VALUE_RATIO * largest).sum())


def _scaled(film: Membrane, snapshots: Sequence[Array], fixed_modes: Array, mass: float) -> Array:
    """Components (n, 3 · snapshots) [1/√kg] of the snapshots without the fixed modes, scaled: each
    snapshot's across the mean plane, and along two axes in it.  Collective.

    Displacements in the mean plane of the film are smaller than those across it, by the ratio of
    the height of a wave to its length, but the whole stiffness of the film resists them: a basis
    without them locks.  Therefore both parts are brought to the norm 1 with respect to the mass.
    Measured on the sail of the demo `reduced_sail`: 40 modes without scaling predict another flight
    five times less accurately, and switch at random between taut and wrinkled.
    """
    times = len(snapshots)
    product = scalar_mass_times(film, fixed_modes)
    shapes = np.stack(snapshots, axis=1)  # (n, times, 3)
    own_coefficients = np.einsum("ni,ntx->tix", product, shapes)
    coefficients = film.comm.allreduce(own_coefficients) / mass
    remainder = shapes - np.einsum("ni,tix->ntx", fixed_modes, coefficients)
    parts = np.einsum("ntx,tax->nat", remainder, _mean_plane_axes(coefficients))
    across = slice(0, 1)
    in_plane = slice(1, 3)
    for kind in (across, in_plane):
        columns = parts[:, kind].reshape(len(shapes), -1)
        own_square = np.sum(columns * scalar_mass_times(film, columns))
        size = float(film.comm.allreduce(own_square)) ** 0.5
        if size > 0:
            parts[:, kind] /= size
    return parts.reshape(len(shapes), 3 * times)


def _mean_plane_axes(coefficients: Array) -> Array:
    """Axes (times, 3 axes, 3) of the mean plane of shapes, its normal and two directions in it,
    from coefficients (times, k, 3) [m] of the fixed modes 1, X, Y (and Z); zero where a shape is
    shrunk to a line or a point."""
    along_X = coefficients[:, 1]
    along_Y = np.zeros_like(along_X)
    # A film that is a line in X has no mode of Y.
    if coefficients.shape[1] > 2:
        along_Y = coefficients[:, 2]
    first = _unit(along_X)
    normal = _unit(np.cross(along_X, along_Y))
    return np.stack([normal, first, np.cross(normal, first)], axis=1)


def _unit(vectors: Array) -> Array:
    """Vectors (n, 3) brought to unit length; zero vectors stay."""
    lengths = np.linalg.norm(vectors, axis=1, keepdims=True)
    return vectors / np.maximum(lengths, TINY)


def _gram_schmidt(film: Membrane, columns: Array) -> Array:
    """Columns φ (n, j ≤ k) with φ_iᵀMφ_j = δ_ij, by Gram-Schmidt from columns (n, k) at the owned
    nodes; those that depend on earlier ones, up to `MIN_INDEPENDENT_SHARE`, are left out.
    Collective."""
    kept: list[Array] = []
    for column in columns.T:
        square = _inner(film, column, column)
        for _ in range(ORTHOGONALISATION_PASSES):
            for other in kept:
                column = column - _inner(film, other, column) * other
        independent = _inner(film, column, column)
        if independent > MIN_INDEPENDENT_SHARE * square:
            kept.append(column / independent**0.5)
    return np.column_stack(kept)


def _orthogonal_to_fixed(film: Membrane, modes: Array, fixed_modes: Array, mass: float) -> Array:
    """Modes (n, k) made orthonormal to each other, φ_iᵀMφ_j = δ_ij, and orthogonal to the fixed
    ones (n, j), for which φ_iᵀMφ_j = m δ_ij.  Collective."""
    for _ in range(ORTHOGONALISATION_PASSES):
        of_fixed = film.comm.allreduce(scalar_mass_times(film, fixed_modes).T @ modes) / mass
        modes = modes - fixed_modes @ of_fixed
        products = film.comm.allreduce(modes.T @ scalar_mass_times(film, modes))
        # φ L⁻ᵀ with LLᵀ = φᵀMφ
        L = np.linalg.cholesky((products + products.T) / 2)
        modes = np.linalg.solve(L, modes.T).T
    return modes


def _examples(film: Membrane, snapshots: Sequence[Array], values: Array, mass: float) -> Array:
    """Coefficients (k, r, 3) [m] of at most `MAX_EXAMPLES` snapshots, evenly spread over all, in
    the modes φ (n, r), `values`.  Collective."""
    positions = np.linspace(0, len(snapshots) - 1, MAX_EXAMPLES)
    chosen = np.unique(positions.astype(int))
    shapes = np.stack([snapshots[i] for i in chosen])
    own = np.einsum("ni,tnx->tix", scalar_mass_times(film, values), shapes)
    return film.comm.allreduce(own) / mass


def _inner(film: Membrane, a: Array, b: Array) -> float:
    """Inner product aᵀMb of two scalar fields (n,) at the owned nodes.  Collective."""
    product = scalar_mass_times(film, b[:, None])[:, 0]
    return float(film.comm.allreduce(a @ product))


def _with_ghosts(film: Membrane, fields: Array) -> Array:
    """Scalar fields (n, k) at the owned nodes, extended to the ghost nodes.  Collective."""
    count = fields.shape[1]
    vector = la.vector(film.space.dofmap.index_map, count)
    vector.array[: fields.size] = fields.ravel()
    vector.scatter_forward()
    return vector.array.reshape(-1, count).copy()
