"""A film is thrown at another one: the scene that all programs compute, and its measures at the
end.

Two square films of the same mesh.  The lower one rests in z = 0; the upper one is turned about z,
spins, and moves towards the lower one.  This module uses numpy only, as it also runs in
environments without dolfinx.
"""

from __future__ import annotations

import numpy as np

SIZE = 0.2  # edge of the films [m]
DISTANCE = 1e-3  # gap at which contact begins [m]
SPEED = 2.0  # of the upper film towards the lower one [m/s]
SLIP = (0.2, 0.1)  # its velocity along the lower film [m/s]
SPIN = 5.0  # of the upper film about z [rad/s]
TURN = 0.4  # of the upper film about z at the start [rad], so that no edges are parallel
OFFSET = (0.02, 0.01, 2e-3)  # of the upper film at the start [m]

# A soft film [Pa, 1, kg/m³, m]: explicit programs can afford its waves.
E = 1e7
NU = 0.3
DENSITY = 1400.0
THICKNESS = 1e-4
SIGMA = DENSITY * THICKNESS  # mass per area [kg/m²]
# Lamé's constants μ and λ of plane stress, times the thickness [N/m].
LAME = (
    E * THICKNESS / (2 * (1 + NU)),
    E * THICKNESS * NU / (1 - NU**2),
)

# Below this determinant [m³] an edge is parallel to a triangle: they have no single common point.
PARALLEL = 1e-30


def grid(n: int) -> tuple[np.ndarray, np.ndarray]:
    """Points (p, 3) [m] and triangles (t, 3) of a square film about the origin, n × n × 2
    triangles."""
    ticks = np.linspace(-SIZE / 2, SIZE / 2, n + 1)
    x, y = np.meshgrid(ticks, ticks, indexing="ij")
    points = np.stack([x, y, np.zeros_like(x)], axis=2).reshape(-1, 3)

    # Corners of each square cell, counterclockwise.
    number = np.arange(x.size).reshape(x.shape)
    left = number[:-1]
    right = number[1:]
    p = left[:, :-1].ravel()
    q = right[:, :-1].ravel()
    r = right[:, 1:].ravel()
    s = left[:, 1:].ravel()
    lower_triangles = np.stack([p, q, r], axis=1)
    upper_triangles = np.stack([p, r, s], axis=1)
    triangles = np.vstack([lower_triangles, upper_triangles])
    return points, triangles


def thrown(X: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Initial positions [m] and velocities [m/s] of the upper film, from its stress-free positions
    X (p, 3)."""
    c = np.cos(TURN)
    s = np.sin(TURN)
    # Transposed, as points are rows.
    rotation = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
    positions = X @ rotation + np.array(OFFSET)
    spin = np.array([0, 0, SPIN])
    drift = np.array([*SLIP, -SPEED])
    velocities = np.cross(spin, X) + drift
    return positions, velocities


def films(n: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Both films: stress-free positions, positions, velocities (p, 3), and triangles (t, 3)."""
    X, triangles = grid(n)
    x, v = thrown(X)
    stress_free = np.vstack([X, X])
    positions = np.vstack([X, x])
    velocities = np.vstack([np.zeros_like(X), v])
    return stress_free, positions, velocities, np.vstack([triangles, triangles + len(X)])


def elastic_energy(
    X: np.ndarray,
    x: np.ndarray,
    triangles: np.ndarray,
) -> float:
    """Elastic energy [J] of films at positions x with the stress-free positions X (p, 3).

    The neo-Hookean membrane of Newton, with F the deformation gradient, J the ratio of areas, and
    zero energy and stress at rest:

        ψ = ½ μ (tr FᵀF - 2) + ½ (λ + μ) (J - α)² - ½ (λ + μ) (1 - α)²,    α = 1 + μ/(λ + μ)
    """
    # All films rest in planes of constant z: two components of the stress-free edges are enough.
    rest_edges = edge_vectors(X, triangles)[:, :2]
    edges = edge_vectors(x, triangles)
    F = edges @ np.linalg.inv(rest_edges)
    C = np.einsum("nci,ncj->nij", F, F)
    J = np.sqrt(np.linalg.det(C))
    trace = np.trace(C, axis1=1, axis2=2)

    μ = LAME[0]
    bulk = LAME[0] + LAME[1]
    α = 1 + μ / bulk
    shear = μ / 2 * (trace - 2)
    # The last summand makes the energy zero at rest.
    area_change = bulk / 2 * ((J - α) ** 2 - (1 - α) ** 2)
    areas = np.abs(np.linalg.det(rest_edges)) / 2
    return float(((shear + area_change) * areas).sum())


def mean_of_upper(values: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Mean (3,) over the area of the upper film of values (p, 3) at the nodes of both films, whose
    triangles (t, 3) have equal areas at rest."""
    upper = triangles[len(triangles) // 2 :]
    return values[upper].mean(axis=(0, 1))


def figures_of_upper(x: np.ndarray, v: np.ndarray, triangles: np.ndarray) -> dict[str, float]:
    """What is compared: height [mm] and speed along z [m/s] of the centre of mass of the upper
    film, from positions and velocities (p, 3) of the nodes of both films."""
    return {
        "height [mm]": 1e3 * float(mean_of_upper(x, triangles)[2]),
        "speed [m/s]": float(mean_of_upper(v, triangles)[2]),
    }


def edge_vectors(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """The two edges [m] of each triangle from its first corner, as columns (t, 3, 2)."""
    first, second, third = points[triangles.T]
    return np.stack([second - first, third - first], axis=2)


def penetrations(x: np.ndarray, triangles: np.ndarray) -> int:
    """Number of edges that intersect triangles without a common node, among all pairs; x (p, 3)
    [m]."""
    sides = triangles[:, [[0, 1], [1, 2], [0, 2]]].reshape(-1, 2)
    edges = np.unique(np.sort(sides, axis=1), axis=0)
    a, b, c = x[triangles.T]
    count = 0
    for p, q in edges:
        # The edge meets the plane of a triangle (a, b, c) where
        # x_p + s (x_q - x_p) = a + u (b - a) + v (c - a).
        direction = np.broadcast_to(x[q] - x[p], a.shape)
        matrix = np.stack([direction, a - b, a - c], axis=2)
        determinant = np.linalg.det(matrix)
        # A triangle at a node of the edge meets it there at any time.
        has_p = (triangles == p).any(axis=1)
        has_q = (triangles == q).any(axis=1)
        is_separate = ~(has_p | has_q)
        is_oblique = np.abs(determinant) > PARALLEL
        is_tested = is_separate & is_oblique
        right_side = (a - x[p])[is_tested, :, None]
        solution = np.linalg.solve(matrix[is_tested], right_side)
        s, u, v = solution[..., 0].T
        on_edge = (s > 0) & (s < 1)
        in_triangle = (u > 0) & (v > 0) & (u + v < 1)
        count += int((on_edge & in_triangle).sum())
    return count
