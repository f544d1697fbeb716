"""Rigid motions that nothing resists: of every part of a scene that moves by itself, about any centre.

Parts are the connected components of the tangent K without inertia: what no stiffness or constraint ties moves apart.
Of a part with the six rigid motions R about its centre, free are the R c with K R c = 0 to round-off: the singular
vectors of D K R, 1/D the round-off of each row.  Motions that would move held coordinates are resisted, as the columns
of these are taken out of K.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import numpy.typing as npt
from mpi4py import MPI
from petsc4py import PETSc
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components

from gossamer_fx.model.body import Array
from gossamer_fx.system.system import System

TOLD = 64  # parts whose motions are looked at
ROUND_OFF = 16 * np.finfo(float).eps  # of a row of K, over the sum of its entries
NONE = 1e-8  # of what a motion moves, over the size of its part: the rotation of a straight line about itself
Labels = npt.NDArray[np.int64]


def free_motions(system: System, K: PETSc.Mat, unbalanced: float) -> tuple[str, ...]:
    """Rigid motions that nothing resists, in words; `unbalanced` [N] is what is left of the residual.

    K: the tangent without inertia, held coordinates taken out.
    """
    part, count = parts(system, K)
    found: list[str] = []
    for bodies, centre, motions in _motions(system, K, part, count, unbalanced):
        whose = "" if count == 1 else f" of {' and '.join(bodies)}"
        if motions.size:
            found += [words + whose for words in _named(motions, centre)]
    return tuple(found)


def parts(system: System, K: PETSc.Mat) -> tuple[Labels, int]:
    """The part of every owned unknown, -1 where it is held, and the number of parts on all ranks."""
    start, n = system.numbering.start, system.numbering.size_local
    rows, columns, _ = _entries(K)
    held = np.zeros(n, dtype=bool)
    held[system.supports.held] = True
    ends, ghosts = [rows], columns.copy()
    own = (columns >= start) & (columns < start + n)
    others, place = np.unique(columns[~own], return_inverse=True)
    ghosts[own] -= start
    ghosts[~own] = n + place
    targets = [ghosts]
    for body in system.bodies:  # the numbers of a node move together
        owned, size = system.block(body).owned, body.block.size
        nodes = np.arange(owned.start, owned.stop).reshape(-1, size)
        for i in range(1, size):
            both = ~held[nodes[:, i - 1]] & ~held[nodes[:, i]]
            ends.append(nodes[both, i - 1])
            targets.append(nodes[both, i])
    a, b = np.concatenate(ends), np.concatenate(targets)
    size = n + len(others)
    links = csr_matrix((np.ones(len(a), dtype=np.int8), (a, b)), shape=(size, size))
    kinds, local = connected_components(links, directed=False)
    label = _agree(system, local, kinds, others)
    names = system.comm.allgather(np.unique(label[~held]))
    known = np.unique(np.concatenate(names))
    part = np.full(n, -1, dtype=np.int64)
    part[~held] = np.searchsorted(known, label[~held])
    return part, len(known)


def _agree(system: System, local: Labels, kinds: int, others: Labels) -> Labels:
    """One label for a part on all ranks: the least position of an unknown in it."""
    n, start = system.numbering.size_local, system.numbering.start
    least = np.full(kinds, np.iinfo(np.int64).max)
    np.minimum.at(least, local[:n], start + np.arange(n))
    vector = system.numbering.vector()
    values = PETSc.Vec().createSeq(len(others))
    source = PETSc.IS().createGeneral(others.astype(PETSc.IntType), comm=MPI.COMM_SELF)
    scatter = PETSc.Scatter().create(vector, source, values, None)
    changed = True
    while changed:
        vector.array[:] = least[local[:n]]
        scatter.scatter(vector, values)
        before = least.copy()
        np.minimum.at(least, local[n:], values.array_r.astype(np.int64))
        changed = system.comm.allreduce(bool((before != least).any()), op=MPI.LOR)
    return least[local[:n]]


def _entries(K: PETSc.Mat) -> tuple[Labels, Labels, Array]:
    """Local rows, global columns and values of the entries that are more than round-off of their row."""
    pointers, columns, values = K.convert("aij", PETSc.Mat()).getValuesCSR()
    rows = np.repeat(np.arange(len(pointers) - 1), np.diff(pointers))
    largest = np.zeros(len(pointers) - 1)
    np.maximum.at(largest, rows, np.abs(values))
    kept = np.abs(values) > 1e-14 * largest[rows]
    return rows[kept].astype(np.int64), columns[kept].astype(np.int64), values[kept]


def _motions(
    system: System, K: PETSc.Mat, part: Labels, count: int, unbalanced: float
) -> Iterator[tuple[list[str], Array, Array]]:
    """Bodies, centre (3,) and free motions (6, k), velocities and rates of rotation, of every part."""
    comm, numbering = system.comm, system.numbering
    free = part >= 0
    sums, first = np.zeros((count, 4)), np.zeros((len(system.bodies), count), dtype=bool)
    places = []  # of each body: its unknowns (n, s, 3), their values, and the part of each node
    for k, body in enumerate(system.bodies):
        owned, vectors = system.block(body).owned, body.block.size // 3
        at = np.arange(owned.start, owned.stop).reshape(-1, vectors, 3)
        q = system.q0.array_r[owned].reshape(-1, vectors, 3).copy()
        of = part[at].max(axis=(1, 2), initial=-1)
        places.append((at, q, of))
        moving = of >= 0
        np.add.at(sums, of[moving], np.column_stack([q[moving, 0], np.ones(moving.sum())]))
        first[k, of[moving]] = True
    comm.Allreduce(MPI.IN_PLACE, sums)
    comm.Allreduce(MPI.IN_PLACE, first, op=MPI.LOR)
    centre = sums[:, :3] / np.maximum(sums[:, 3:], 1)
    radius = np.zeros(count)
    for _, q, of in places:
        moving = of >= 0
        away = q[moving].copy()
        away[:, 0] -= centre[of[moving]]
        np.maximum.at(radius, of[moving], np.linalg.norm(away, axis=2).max(axis=1, initial=0.0))
    comm.Allreduce(MPI.IN_PLACE, radius, op=MPI.MAX)
    arm = np.where(radius > 0, radius, 1.0)

    rows, _, values = _entries(K)
    size = np.zeros(numbering.size_local)
    np.add.at(size, rows, np.abs(values))
    scale = ROUND_OFF * size
    if system.constraints is not None:
        scale[system.constraints.owned] += 1e-10  # of directions and metres, which hold to 1e-12
    scale[: system.block(system.bodies[-1]).owned.stop] += 2 * unbalanced / arm.min(initial=1.0)
    scale = np.where(scale > 0, scale, 1.0)

    R = np.zeros((6, numbering.size_local))
    Y = np.zeros_like(R)
    φ, out = numbering.vector(), numbering.vector()
    for i in range(6):
        axis = np.eye(3)[i % 3]
        for at, q, of in places:
            moving, whose = of >= 0, np.maximum(of, 0)
            if i < 3:
                v = np.zeros_like(q)
                v[:, 0] = axis
            else:
                away = q.copy()
                away[:, 0] -= centre[whose]
                v = np.cross(axis, away) / arm[whose][:, None, None]
            R[i, at[moving]] = v[moving]
        # a held coordinate that would move resists: its rows are those of what it is tied to
        R[i, ~free] = 0
        φ.array[:] = R[i]
        K.mult(φ, out)
        Y[i] = np.where(free, out.array_r / scale, 0.0)
    for c in range(min(count, TOLD)):
        mine = part == c
        forces, moved = _triangle(comm, Y[:, mine].T), _triangle(comm, R[:, mine].T)
        motions = _null(forces, moved, comm.allreduce(int(mine.sum())))
        motions[3:] /= arm[c]
        yield (
            [f"'{body.name}'" for k, body in enumerate(system.bodies) if first[k, c]],
            centre[c],
            motions,
        )


def _triangle(comm: MPI.Intracomm, columns: Array) -> Array:
    """The factor R (6, 6) of a matrix (n, 6) whose rows are distributed; unlike its square, it loses no digits."""
    own = np.asarray(np.linalg.qr(np.vstack([columns, np.zeros((6, 6))]), mode="r"))
    return np.asarray(np.linalg.qr(np.vstack(comm.allgather(own)), mode="r"))


def _null(forces: Array, moved: Array, n: int) -> Array:
    """Motions c (6, k) with |forces c|² < n among those that move something: |moved c|² = n."""
    _, σ, Vt = np.linalg.svd(moved)
    kept = σ > NONE * max(float(σ.max()), 1e-300)
    U = Vt[kept].T / σ[kept] * n**0.5
    _, τ, Wt = np.linalg.svd(forces @ U)
    found: Array = U @ Wt[τ**2 < n].T
    return found


def _named(motions: Array, centre: Array) -> list[str]:
    """Translations and rotations that span some motions (6, k), along axes where these do."""
    v, ω = motions[:3], motions[3:]
    weight = np.abs(ω).max(initial=0.0) * np.abs(centre).max(initial=1.0) + np.abs(v).max(
        initial=0.0
    )
    scale = np.abs(ω).max(initial=0.0) or 1.0
    _, σ, Vt = np.linalg.svd(ω, full_matrices=True)
    rank = int((σ > 1e-6 * scale).sum()) if σ.max(initial=0.0) * weight > 1e-8 * weight else 0
    still, turning = motions @ Vt[rank:].T, motions @ Vt[:rank].T
    along = _reduced(still[:3])
    words = [f"translation {_direction(t)}" for t in along]
    span = np.array(along).T if along else np.zeros((3, 0))
    turning = _aligned(turning)
    for v, ω in zip(turning[:3].T, turning[3:].T, strict=True):
        v = v - span @ np.linalg.lstsq(span, v, rcond=None)[0] if span.size else v
        ω2 = ω @ ω
        about = centre + np.cross(ω, v) / ω2
        about -= (about @ ω) / ω2 * ω
        size = max(float(np.abs(centre).max()), 1.0)
        everywhere = (
            span.shape[1] >= 2 and np.linalg.matrix_rank(np.column_stack([span, ω]), tol=1e-6) == 3
        )
        where = (
            "" if everywhere or np.abs(about).max() < 1e-6 * size else f" about ({_numbers(about)})"
        )
        words.append(f"rotation {_direction(ω)}{where}")
    return words


def _aligned(motions: Array) -> Array:
    """Combinations of the motions (6, k) whose rotations are along axes, if they can be."""
    pivots: list[int] = []
    M = motions.T.copy()
    for i in range(len(M)):
        remaining = [j for j in range(3) if j not in pivots]
        j = max(remaining, key=lambda j: float(np.abs(M[i:, 3 + j]).max()))
        row = i + int(np.abs(M[i:, 3 + j]).argmax())
        M[[i, row]] = M[[row, i]]
        M[i] /= M[i, 3 + j]
        for other in range(len(M)):
            if other != i:
                M[other] -= M[other, 3 + j] * M[i]
        pivots.append(j)
    order = np.argsort(pivots)
    aligned: Array = M[order].T
    return aligned


def _reduced(vectors: Array) -> list[Array]:
    """A basis of the span of vectors (3, k) with as many zeros as can be."""
    if not vectors.size:
        return []
    Q = np.linalg.svd(vectors, full_matrices=False)
    kept = Q[0][:, Q[1] > 1e-8 * max(Q[1].max(), 1e-300)]
    padded = np.vstack([np.zeros_like(kept), kept])
    return list(_aligned(padded)[3:].T)


def _direction(d: Array) -> str:
    d = d / np.linalg.norm(d)
    k = int(np.abs(d).argmax())
    return "xyz"[k] if abs(d[k]) > 1 - 1e-9 else f"({_numbers(d * np.sign(d[k]))})"


def _numbers(values: Array) -> str:
    return ", ".join(
        f"{x + 0.0:.3g}"
        for x in np.where(np.abs(values) < 1e-6 * np.abs(values).max(), 0.0, values)
    )
