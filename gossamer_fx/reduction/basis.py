"""Scalar modes of a film: x(X, t) = Σ_i φ_i(X) c_i(t) with vectors c_i.

Every strain is quadratic in x, so it is in c; the set of c is closed under rotation, and 1 is among the modes.  So the
time rule keeps energy, momentum and angular momentum of the reduced film as it does those of the full one.  Modes with
vector values, as ordinary proper orthogonal decomposition takes them, have fixed directions in space: they keep
energy, but no angular momentum.

The modes are the left singular vectors, in the norm of the mass, of snapshots (nodes, 3 · times) without what
1, X, Y (and Z, if the film is not plane) make of them, which are always in the basis (Sirovich, Q. Appl. Math. 45
(1987) 561).  They follow from the eigenvectors of the snapshots' Gram matrix, so that no field is gathered on one rank.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import ufl
from dolfinx import fem, la

from gossamer_fx.bodies.membrane import Membrane
from gossamer_fx.checks.errors import check
from gossamer_fx.forms.compilation import compile_form
from gossamer_fx.model.body import Array

EXAMPLES = 8  # snapshots whose coefficients are kept
SMALLEST = 1e-7  # singular values of the Gram matrix below this, over the largest, are round-off


@dataclass(frozen=True, eq=False)
class Basis:
    """Modes φ (n, r) at the owned and ghost nodes of a film; φ_0 = 1, and ∫ρt φ_i φ_j dA = m δ_ij.

    mass             m [kg] of the film
    singular_values  (k,) of the snapshots without the `fixed` modes, in the norm of the mass
    fixed            how many modes are made of 1, X, Y, Z
    examples         coefficients (k, r, 3) of some of the snapshots
    """

    film: Membrane
    values: Array
    mass: float
    singular_values: Array
    fixed: int
    examples: Array

    @property
    def size(self) -> int:
        return self.values.shape[1]

    def project(self, x: Array) -> tuple[Array, float]:
        """Coefficients (r, 3) of owned values x (n, 3), and the share of ∫ρt |x|² dA that is outside of the basis."""
        product = mass_times(self.film, x[:, :, None])[:, :, 0]
        own = self.values[: len(x)]
        total = self.film.comm.allreduce(
            np.concatenate([own.T @ product, [[np.sum(x * product), 0, 0]]])
        )
        c = total[:-1] / self.mass
        whole = float(total[-1, 0])
        return c, max(whole - self.mass * float(np.sum(c * c)), 0.0) / whole if whole else 0.0


def mass_times(film: Membrane, x: Array) -> Array:
    """M x of owned values x (n, 3, k), k fields."""
    f, w = fem.Function(film.space), ufl.TestFunction(film.space)
    form = compile_form(film.area_density * ufl.inner(f, w) * film.mass_dx)
    b = la.vector(film.space.dofmap.index_map, 3)
    result = np.empty_like(x)
    for k in range(x.shape[2]):
        f.x.array[: 3 * len(x)] = x[:, :, k].ravel()
        f.x.scatter_forward()
        b.array[:] = 0
        fem.assemble_vector(b.array, form)
        b.scatter_reverse(la.InsertMode.add)
        result[:, :, k] = b.array[: 3 * len(x)].reshape(-1, 3)
    return result


def scalar_mass_times(film: Membrane, φ: Array) -> Array:
    """M φ of owned scalars (n, k)."""
    n, k = φ.shape
    padded = np.zeros((n, 3 * -(-k // 3)))
    padded[:, :k] = φ
    threes = padded.reshape(n, padded.shape[1] // 3, 3).transpose(0, 2, 1)
    return mass_times(film, threes).transpose(0, 2, 1).reshape(padded.shape)[:, :k]


def make_basis(film: Membrane, snapshots: Sequence[Array], count: int) -> Basis:
    """The `count` strongest modes of snapshots, beside 1, X, Y and Z.

    Args:
        snapshots: owned positions (n, 3) of the film's nodes.

    Raises:
        InputError: no snapshots, of another mesh, or not that many modes in them.
    """
    comm, n = film.comm, film.space.dofmap.index_map.size_local
    check(count >= 1, f"reduce: modes is {count!r}; ask for one or more.")
    check(
        bool(snapshots),
        "reduce: there are no snapshots; record the film with `Snapshots` or `Recording` first.",
    )
    alike = comm.allreduce(int(any(s.shape != (n, 3) for s in snapshots)))
    check(not alike, f"reduce: a snapshot is of another mesh than '{film.name}'; record this film.")
    X = film.space.tabulate_dof_coordinates()[:n]
    fixed = _orthonormal(film, np.column_stack([np.ones(n), X]), 1e-10)
    mass = float(comm.allreduce(scalar_mass_times(film, np.ones((n, 1))).sum()))
    fixed *= mass**0.5
    fixed[:, 0] = 1.0
    A = _scaled(film, snapshots, fixed, mass)
    gram = comm.allreduce(A.T @ scalar_mass_times(film, A))
    λ, v = np.linalg.eigh((gram + gram.T) / 2)
    σ = np.sqrt(np.maximum(λ[::-1], 0.0))
    found = int((σ > SMALLEST * max(σ[0], 1e-300)).sum()) if σ[0] > 0 else 0
    check(
        count <= found,
        f"reduce: the snapshots of '{film.name}' hold {found} modes, not {count}; ask for fewer, or record more.",
    )
    modes = A @ (v[:, ::-1][:, :count] / σ[:count])
    for _ in range(2):  # what round-off left of the fixed modes and of each other
        modes = modes - fixed @ comm.allreduce(scalar_mass_times(film, fixed).T @ modes) / mass
        products = comm.allreduce(modes.T @ scalar_mass_times(film, modes))
        modes = np.linalg.solve(np.linalg.cholesky((products + products.T) / 2), modes.T).T
    φ = np.column_stack([fixed, mass**0.5 * modes])
    some = np.stack(
        [snapshots[i] for i in np.unique(np.linspace(0, len(snapshots) - 1, EXAMPLES).astype(int))]
    )
    examples = comm.allreduce(np.einsum("ni,tnx->tix", scalar_mass_times(film, φ), some)) / mass
    return Basis(film, _with_ghosts(film, φ), mass, σ[:found], fixed.shape[1], examples)


def _scaled(film: Membrane, snapshots: Sequence[Array], fixed: Array, mass: float) -> Array:
    """Parts (n, 3 · times) of the snapshots across the film's mean plane and in it, brought to one size.

    The way in the plane is smaller than that across it by the ratio of a wave's height to its length, but resisted by
    the whole stiffness of the film: a basis without it locks.  Of the sail of `demos/reduced_sail.py`, 40 modes at the
    sizes that they have predict another flight five times less well, and switch at random between taut and wrinkled.
    """
    times, product = len(snapshots), scalar_mass_times(film, fixed)
    A = np.stack(snapshots, axis=1)  # (n, times, 3)
    c = film.comm.allreduce(np.einsum("ni,ntx->tix", product, A)) / mass
    A = A - np.einsum("ni,tix->ntx", fixed, c)
    a, b = c[:, 1], c[:, 2] if c.shape[1] > 2 else np.zeros((times, 3))
    normal = np.cross(a, b)
    first = a / np.maximum(np.linalg.norm(a, axis=1, keepdims=True), 1e-300)
    normal = normal / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300)
    axes = np.stack([normal, first, np.cross(normal, first)], axis=1)  # (times, 3 axes, 3)
    parts = np.einsum("ntx,tax->nat", A, axes)
    for kind in (slice(0, 1), slice(1, 3)):
        each = parts[:, kind].reshape(len(A), -1)
        size = float(film.comm.allreduce(np.sum(each * scalar_mass_times(film, each)))) ** 0.5
        if size > 0:
            parts[:, kind] /= size
    return parts.reshape(len(A), -1)


def _orthonormal(film: Membrane, φ: Array, smallest: float) -> Array:
    """Columns one after the other, orthonormal in the mass, without those that depend on earlier ones."""
    kept: list[Array] = []
    for column in φ.T:
        size = _inner(film, column, column)
        for _ in range(2):
            for other in kept:
                column = column - _inner(film, other, column) * other
        rest = _inner(film, column, column)
        if rest > smallest * size:
            kept.append(column / rest**0.5)
    return np.column_stack(kept)


def _inner(film: Membrane, a: Array, b: Array) -> float:
    return float(film.comm.allreduce(a @ scalar_mass_times(film, b[:, None])[:, 0]))


def _with_ghosts(film: Membrane, φ: Array) -> Array:
    index_map = film.space.dofmap.index_map
    vector = la.vector(index_map, φ.shape[1])
    vector.array[: φ.size] = φ.ravel()
    vector.scatter_forward()
    result: Array = vector.array.reshape(-1, φ.shape[1]).copy()
    return result
