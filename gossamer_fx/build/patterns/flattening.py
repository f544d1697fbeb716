"""Flat panels whose tensioned state is nearest to given curved strips.

Problem.  A doubly curved strip has no flat panel without strain.  The panel to be cut is the one
that, pulled into the form, has a tension as near as possible to the wanted one.

Idea.  Let X be the plane points of a panel, x those of the form, F = ∂x/∂X, E = ½(FᵀF - I) the
Green-Lagrange strain in the axes of the panel, and E0 the strain that the film's law has under the
wanted tension.  Minimise over X

    Σ A ½ (E - E0):C:(E - E0)                                                                    (1)

with the area A of each triangle of the form and the stiffness C of the film, in the axes of the
panel, in which the yarns of a woven film are straight.  A strip that can be developed has E = E0
exactly.  The panel is thus smaller than the strip by the strain under the tension: it is
compensated.

Constraints.  Each panel lies with its seams along x and has its middle at the origin.  If both
sides of seams shall have the same length, the edges of a seam are as long on the one side as on the
other, each by itself, so that marks along it agree.

Algorithm.

1. First guess: a conformal map of each strip, which has least squares of the Cauchy-Riemann
   equations (Lévy et al., ACM Trans. Graph. 21 (2002) 362, doi:10.1145/566654.566590), of the area
   of the strip.  Of a strip that can be developed it is the solution.
2. Gauss-Newton iterations for (1) with the constraints by multipliers.  As E - E0 is small, a step
   has an error of the order of it times the step.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.sparse import block_array, coo_array, csc_array
from scipy.sparse.linalg import splu, spsolve

from gossamer_fx.build.patterns.closest import Numbers
from gossamer_fx.build.patterns.cutting import CutMesh, SeamEdges
from gossamer_fx.build.patterns.triangulation import sides_of
from gossamer_fx.core.checks.errors import InputError, check
from gossamer_fx.core.model.body import Array
from gossamer_fx.mechanics.materials.film import FilmLaw
from gossamer_fx.mechanics.materials.orthotropic import LinearOrthotropic

# Iterations, each of which gains two digits or more, and the change of a point over the size of all
# panels at which the last one has come.
MAX_ITERATIONS = 100
LAST_CHANGE = 1e-13

# A change below this one that does not fall any more is round-off.
ROUND_OFF_CHANGE = 1e-9

# After this number of iterations a change of a point over the size of all panels is small enough:
# a micrometre in a metre.  Narrow triangles that a seam leaves next to corners of the form are
# strained so much that a step has an error as large as itself.
PATIENCE = 30
SMALL_CHANGE = 1e-6

# Largest strain under the wanted tension
LARGEST_STRAIN = 0.3

# Change of strain by which stiffness is found by differences
DIFFERENCE = 1e-5

# Halvings of a step that turns a triangle over or raises energy and constraints.
MAX_HALVINGS = 30

# Weight of the constraints in the measure of a step, over the largest multiplier.
MULTIPLIER_FACTOR = 2.0

# Cosine of the angle to the longest seam of a strip, above which a seam is along the strip.
ALONG = 0.7


@dataclass(frozen=True, eq=False)
class TensionedFilm:
    """A film under the wanted tension, in the axes of a panel.

    Attributes:
        stiffness: C (3, 3) [N/m] of strains (E11, E22, 2 E12).
        strain: E0 (3,).
    """

    stiffness: Array
    strain: Array

    @property
    def shrinkage(self) -> float:
        """Length of unstrained film over that of tensioned film, as the mean of all directions."""
        return float(1 / np.sqrt(1 + self.strain[0] + self.strain[1]))


def tensioned(law: FilmLaw, tension: tuple[float, float]) -> TensionedFilm:
    """A film under Cauchy tensions [N/m] along and across a panel."""
    strain_of = _strain_function(law)
    strain: Array = np.zeros(3)
    stress: Array = np.zeros(3)
    # The law has the second Piola-Kirchhoff stress S of the Cauchy tension n:
    # S1 = n1 λ2/λ1, S2 = n2 λ1/λ2.  The strain is small, and so each iteration gains digits.
    for _ in range(MAX_ITERATIONS):
        ratio = float(np.sqrt((1 + 2 * strain[1]) / (1 + 2 * strain[0])))
        stress = np.array([tension[0] * ratio, tension[1] / ratio, 0.0])
        found = strain_of(stress)
        change = float(np.abs(found - strain).max())
        strain = found
        is_small = bool((np.abs(strain) < LARGEST_STRAIN).all())
        check(
            is_small,
            f"Strips.flatten: the tension ({tension[0]:g}, {tension[1]:g}) N/m strains the film "
            f"by more than {100 * LARGEST_STRAIN:.0f} %; give a stiffer film or less tension.",
        )
        if change <= 1e-16:
            break
    return TensionedFilm(np.linalg.inv(_compliance(strain_of, stress)), strain)


def _strain_function(law: FilmLaw) -> Callable[[Array], Array]:
    """The strain (E11, E22, 2 E12) of taut film as a function of its second Piola-Kirchhoff stress
    (S11, S22, S12) [N/m], in the axes of a panel."""
    check(
        type(law).taut_strain is not FilmLaw.taut_strain,
        f"Strips.flatten: the law {type(law).__name__} has no strain of a given tension; "
        "give the law of the film that is cut, e.g. Linear, Miyazaki or Orthotropic.",
    )
    if isinstance(law, LinearOrthotropic):
        compliance = _orthotropic_compliance(law)
        return lambda stress: compliance @ stress

    def strain(stress: Array) -> Array:
        # The law writes expressions of UFL, also of numbers; it has its own numbers.
        found: Any = law.taut_strain(stress.tolist(), law)
        return np.array([float(found[k]) for k in range(3)])

    return strain


def _compliance(strain_of: Callable[[Array], Array], stress: Array) -> Array:
    """Derivative (3, 3) [m/N] of the strain of a film by its stress [N/m], by differences."""
    # Stress of a strain of about 1e-5, and differences with an error of 1e-10 of it
    step = DIFFERENCE / float(strain_of(np.array([1.0, 0.0, 0.0]))[0])
    columns = []
    for k in range(3):
        change = np.zeros(3)
        change[k] = step
        columns.append((strain_of(stress + change) - strain_of(stress - change)) / (2 * step))
    compliance = np.array(columns).T
    return (compliance + compliance.T) / 2


def _orthotropic_compliance(law: LinearOrthotropic) -> Array:
    """The compliance of orthotropic film whose first axis is a direction in the flat panel."""
    check(
        not callable(law.direction) and not hasattr(law.direction, "keys"),
        "Strips.flatten: the direction of the law is not one vector; give it in the axes of the "
        "flat panels, x along the strip, e.g. direction=(1, 0, 0).",
    )
    x, y = np.asarray(law.direction, dtype=float)[:2]
    length = float(np.hypot(x, y))
    check(
        length > 0,
        "Strips.flatten: the direction of the law is normal to the flat panels; give it in their "
        "axes, x along the strip, e.g. direction=(1, 0, 0).",
    )
    cosine = x / length
    sine = y / length
    t = law.thickness
    axes = np.array(
        [
            [1 / (law.E1 * t), -law.nu12 / (law.E1 * t), 0.0],
            [-law.nu12 / (law.E1 * t), 1 / (law.E2 * t), 0.0],
            [0.0, 0.0, 1 / (law.G12 * t)],
        ]
    )
    # Stress in the axes of the film from that in the axes of the panel
    turned = np.array(
        [
            [cosine**2, sine**2, 2 * sine * cosine],
            [sine**2, cosine**2, -2 * sine * cosine],
            [-sine * cosine, sine * cosine, cosine**2 - sine**2],
        ]
    )
    return turned.T @ axes @ turned


@dataclass(frozen=True, eq=False)
class FlatMesh:
    """The plane points of all panels, each around the origin with its seams along x.

    Attributes:
        points: X (n, 2) [m].
        strain: E (m, 3) of each triangle from the panel to the form, as (E11, E22, 2 E12).
        tension: second Piola-Kirchhoff stress C E (m, 3) [N/m] that goes with it.
        iterations: number of steps.
    """

    points: Array
    strain: Array
    tension: Array
    iterations: int


def flattened(mesh: CutMesh, film: TensionedFilm, equal_seams: bool) -> FlatMesh:
    """Minimise (1) of the module over the plane points of all strips of a mesh.

    `InputError`: a strip is not a disc, or the iterations do not converge."""
    _check_discs(mesh)
    axes = [_axis(mesh, k) for k in range(int(mesh.strip.max()) + 1)]
    X: Array = _first_guess(mesh, axes) * film.shrinkage
    problem = _Problem(mesh, film, axes, mesh.seams if equal_seams else ())
    size = float(np.ptp(X, axis=0).max())
    last = np.inf
    for iteration in range(1, MAX_ITERATIONS + 1):
        residual, jacobian = problem.residual(X)
        values, gradient = problem.constraints(X)
        step, multipliers = _step(residual, jacobian, values, gradient)
        weight = MULTIPLIER_FACTOR * float(np.abs(multipliers).max(initial=0.0))
        X, change = problem.improved(X, step.reshape(-1, 2), weight, size)
        stands = change <= ROUND_OFF_CHANGE * size and change > 0.5 * last
        is_patient = iteration < PATIENCE or change > SMALL_CHANGE * size
        if change <= LAST_CHANGE * size or stands or not is_patient:
            strain = problem.strain(X)
            return FlatMesh(X, strain, strain @ film.stiffness, iteration)
        last = change
    raise InputError(
        "Strips.flatten: the panels do not converge, as some strip is curved too much; "
        "cut it into more strips."
    )


def _step(
    residual: Array, jacobian: csc_array, values: Array, gradient: csc_array
) -> tuple[Array, Array]:
    """A Gauss-Newton step, and the multipliers of the constraints."""
    normal = (jacobian.T @ jacobian).tocsc()
    matrix = block_array([[normal, gradient.T], [gradient, None]], format="csc")
    right = np.concatenate([-(jacobian.T @ residual), -values])
    solution = splu(matrix).solve(right)
    unknowns = normal.shape[0]
    return solution[:unknowns], solution[unknowns:]


class _Problem:
    """Residuals of (1) of the module and constraints, as functions of the plane points."""

    def __init__(
        self,
        mesh: CutMesh,
        film: TensionedFilm,
        axes: Sequence[list[tuple[int, int, float]]],
        seams: Sequence[SeamEdges],
    ) -> None:
        self.triangles = mesh.triangles
        self.count = len(mesh.points)
        corners = mesh.points[mesh.triangles]
        sides = np.stack([corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]], axis=2)
        # Products (m, 2, 2) of the sides of the form, from which FᵀF follows
        self.products = np.einsum("mca,mcb->mab", sides, sides)
        self.areas = np.sqrt(np.linalg.det(self.products)) / 2
        self.e0 = film.strain
        # C = L Lᵀ in a unit in which it is about one; areas over their sum.
        root = np.linalg.cholesky(film.stiffness / np.abs(film.stiffness).max()).T
        weights = np.sqrt(self.areas / self.areas.sum())
        self.roots = weights[:, None, None] * root
        self.fixed = self._gauges(mesh, axes)
        left = [np.stack([seam.left[:-1], seam.left[1:]], axis=1) for seam in seams]
        right = [np.stack([seam.right[:-1], seam.right[1:]], axis=1) for seam in seams]
        none = np.zeros((0, 2), dtype=np.int64)
        self.left = np.concatenate([none, *left])
        self.right = np.concatenate([none, *right])
        edges = mesh.points[self.left[:, 1]] - mesh.points[self.left[:, 0]]
        self.lengths = np.linalg.norm(edges, axis=1)

    def _gauges(self, mesh: CutMesh, axes: Sequence[list[tuple[int, int, float]]]) -> csc_array:
        """Three linear constraints of each panel: its middle and its direction."""
        rows: list[int] = []
        columns: list[int] = []
        entries: list[float] = []
        for strip, axis in enumerate(axes):
            points = np.unique(mesh.triangles[mesh.strip == strip])
            for component in range(2):
                rows += [3 * strip + component] * len(points)
                columns += (2 * points + component).tolist()
                entries += [1 / len(points)] * len(points)
            for start, end, sign in axis:
                rows += [3 * strip + 2] * 2
                columns += [2 * start + 1, 2 * end + 1]
                entries += [-sign, sign]
        shape = (3 * len(axes), 2 * self.count)
        return coo_array((entries, (rows, columns)), shape=shape).tocsc()

    def _gradients(self, X: Array) -> tuple[Array, Array, Array]:
        """Gradients (m, 3, 2) of the shape functions of the corners in the plane, FᵀF (m, 2, 2),
        and the determinants (m,) of the sides."""
        corners = X[self.triangles]
        sides = np.stack([corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]], axis=2)
        inverse = np.linalg.inv(sides)
        metric = np.einsum("mia,mij,mjb->mab", inverse, self.products, inverse)
        gradients = np.concatenate([-inverse.sum(axis=1, keepdims=True), inverse], axis=1)
        return gradients, metric, np.linalg.det(sides)

    def strain(self, X: Array) -> Array:
        """E (m, 3) from the panel to the form, as (E11, E22, 2 E12)."""
        _, metric, _ = self._gradients(X)
        return np.stack(
            [(metric[:, 0, 0] - 1) / 2, (metric[:, 1, 1] - 1) / 2, metric[:, 0, 1]], axis=1
        )

    def residual(self, X: Array) -> tuple[Array, csc_array]:
        """The residuals (3 m,), whose squares have the sum (1) of the module, and their
        Jacobian."""
        gradients, metric, _ = self._gradients(X)
        difference = self.strain(X) - self.e0
        residual = np.einsum("mij,mj->mi", self.roots, difference)
        # δE = -sym(FᵀF δX ⊗ ∇N): columns by corner v and component a
        derivative = np.zeros((len(self.triangles), 3, 3, 2))
        for a in range(2):
            first = metric[:, 0, a, None] * gradients[:, :, 0]
            second = metric[:, 1, a, None] * gradients[:, :, 1]
            shear = metric[:, 0, a, None] * gradients[:, :, 1]
            shear = shear + metric[:, 1, a, None] * gradients[:, :, 0]
            derivative[:, 0, :, a] = -first
            derivative[:, 1, :, a] = -second
            derivative[:, 2, :, a] = -shear
        entries = np.einsum("mij,mjva->miva", self.roots, derivative)
        rows = np.arange(3 * len(self.triangles)).reshape(-1, 3, 1, 1)
        columns = 2 * self.triangles[:, None, :, None] + np.arange(2)
        all_rows = np.broadcast_to(rows, entries.shape).ravel()
        all_columns = np.broadcast_to(columns, entries.shape).ravel()
        shape = (3 * len(self.triangles), 2 * self.count)
        jacobian = coo_array((entries.ravel(), (all_rows, all_columns)), shape=shape)
        return residual.ravel(), jacobian.tocsc()

    def constraints(self, X: Array) -> tuple[Array, csc_array]:
        """Values of the constraints, and their gradients: the positions of panels, and the
        differences of the lengths of the edges of seams, over those on the form."""
        flat = self.fixed @ X.ravel()
        count = len(self.left)
        if not count:
            return flat, self.fixed
        values = np.zeros(count)
        rows = []
        columns = []
        entries = []
        for edges, sign in ((self.left, 1.0), (self.right, -1.0)):
            vectors = X[edges[:, 1]] - X[edges[:, 0]]
            length = np.linalg.norm(vectors, axis=1)
            values += sign * length / self.lengths
            unit = sign * vectors / (length * self.lengths)[:, None]
            for end, factor in ((0, -1.0), (1, 1.0)):
                for component in range(2):
                    rows.append(np.arange(count))
                    columns.append(2 * edges[:, end] + component)
                    entries.append(factor * unit[:, component])
        gradient = coo_array(
            (np.concatenate(entries), (np.concatenate(rows), np.concatenate(columns))),
            shape=(count, 2 * self.count),
        )
        together = block_array([[self.fixed], [gradient]], format="csc")
        return np.concatenate([flat, values]), together

    def improved(self, X: Array, step: Array, weight: float, size: float) -> tuple[Array, float]:
        """The points after a step, which is halved until no triangle turns over and energy and
        constraints fall, and the largest change of a coordinate [m]."""
        before = self._measure(X, weight)
        factor = 1.0
        for _ in range(MAX_HALVINGS):
            moved = X + factor * step
            change = factor * float(np.abs(step).max())
            _, _, determinants = self._gradients(moved)
            if (determinants > 0).all():
                is_small = change <= ROUND_OFF_CHANGE * size
                if is_small or self._measure(moved, weight) < before:
                    return moved, change
            factor /= 2
        raise InputError(
            "Strips.flatten: no step improves the panels, as some strip is curved too much; "
            "cut it into more strips."
        )

    def _measure(self, X: Array, weight: float) -> float:
        """Energy and weighted constraints, by which steps are compared."""
        difference = self.strain(X) - self.e0
        residual = np.einsum("mij,mj->mi", self.roots, difference)
        values, _ = self.constraints(X)
        return float((residual**2).sum() / 2 + weight * np.abs(values).sum())


def _check_discs(mesh: CutMesh) -> None:
    """Raise `InputError` unless every strip is a disc."""
    for strip in range(int(mesh.strip.max()) + 1):
        triangles = mesh.triangles[mesh.strip == strip]
        sides = np.sort(sides_of(triangles), axis=1)
        edges = len(np.unique(sides, axis=0))
        euler = len(np.unique(triangles)) - edges + len(triangles)
        check(
            euler == 1,
            f"Strips.flatten: strip {strip} is closed in itself or has a hole, and cannot be laid "
            "flat; add a line that cuts it open.",
        )


def _axis(mesh: CutMesh, strip: int) -> list[tuple[int, int, float]]:
    """The direction of a strip: pairs of points at both ends of its seams, each with the sign of
    its direction along the longest one; of a strip without open seams two points far apart."""
    pairs = []
    for seam in mesh.seams:
        for side, points in zip(seam.strips, (seam.left, seam.right), strict=True):
            if side == strip:
                pairs.append((int(points[0]), int(points[-1])))
    chords = np.array([mesh.points[end] - mesh.points[start] for start, end in pairs])
    lengths = np.linalg.norm(chords.reshape(-1, 3), axis=1)
    used = np.unique(mesh.triangles[mesh.strip == strip])
    extent = float(np.linalg.norm(np.ptp(mesh.points[used], axis=0)))
    if lengths.max(initial=0.0) > 1e-3 * extent:
        longest = int(lengths.argmax())
        unit = chords[longest] / lengths[longest]
        found = []
        for pair, chord, length in zip(pairs, chords, lengths, strict=True):
            cosine = float(chord @ unit) / max(float(length), 1e-300)
            if abs(cosine) >= ALONG:
                found.append((*pair, float(np.sign(cosine))))
        return found
    x = mesh.points[used]
    first = int(used[np.linalg.norm(x - x.mean(axis=0), axis=1).argmax()])
    second = int(used[np.linalg.norm(x - mesh.points[first], axis=1).argmax()])
    return [(first, second, 1.0)]


def _first_guess(mesh: CutMesh, axes: Sequence[list[tuple[int, int, float]]]) -> Array:
    """Conformal maps (n, 2) [m] of all strips with their areas, along their axes and around the
    origin."""
    X = np.zeros((len(mesh.points), 2))
    for strip, axis in enumerate(axes):
        triangles = mesh.triangles[mesh.strip == strip]
        used, numbers = np.unique(triangles, return_inverse=True)
        local = numbers.reshape(-1, 3)
        start, end, _ = axis[0]
        pins = (int(np.searchsorted(used, start)), int(np.searchsorted(used, end)))
        flat = _conformal(mesh.points[used], local, pins)
        corners = mesh.points[triangles]
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        flat_corners = flat[local]
        u = flat_corners[:, 1] - flat_corners[:, 0]
        v = flat_corners[:, 2] - flat_corners[:, 0]
        areas = u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]
        check(
            bool((areas > 0).all()),
            f"Strips.flatten: strip {strip} covers the plane twice when it is laid flat; "
            "cut it into more strips.",
        )
        flat *= np.sqrt(np.linalg.norm(normals, axis=1).sum() / areas.sum())
        direction = np.zeros(2)
        for first, last, sign in axis:
            ends = np.searchsorted(used, [first, last])
            direction += sign * (flat[ends[1]] - flat[ends[0]])
        cosine, sine = direction / np.linalg.norm(direction)
        flat = flat @ np.array([[cosine, -sine], [sine, cosine]])
        X[used] = flat - flat.mean(axis=0)
    return X


def _conformal(points: Array, triangles: Numbers, pins: tuple[int, int]) -> Array:
    """The least squares conformal map (n, 2) of a surface, with two points on the x axis."""
    corners = points[triangles]
    along = corners[:, 1] - corners[:, 0]
    length = np.linalg.norm(along, axis=1)
    other = corners[:, 2] - corners[:, 0]
    normal = np.cross(along, other)
    double_area = np.linalg.norm(normal, axis=1)
    # Corners of each triangle in its own plane, as complex numbers
    third_x = np.einsum("mc,mc->m", along, other) / length
    third_y = double_area / length
    first = np.zeros(len(triangles), dtype=complex)
    second = length.astype(complex)
    third = third_x + 1j * third_y
    weights = np.stack([third - second, first - third, second - first], axis=1)
    weights /= np.sqrt(double_area)[:, None]
    rows = np.repeat(np.arange(len(triangles)), 3)
    shape = (len(triangles), len(points))
    matrix = coo_array((weights.ravel(), (rows, triangles.ravel())), shape=shape).tocsc()
    free = np.setdiff1d(np.arange(len(points)), pins)
    distance = float(np.linalg.norm(points[pins[1]] - points[pins[0]]))
    w = np.zeros(len(points), dtype=complex)
    w[pins[1]] = distance
    right = -(matrix[:, list(pins)] @ w[list(pins)])
    part = matrix[:, free]
    w[free] = spsolve((part.conj().T @ part).tocsc(), part.conj().T @ right)
    return np.stack([w.real, w.imag], axis=1)
