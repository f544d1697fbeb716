"""The antenna pendulum in NGSolve: the film as a thin plate without wrinkling, stiff booms.

Film: St. Venant-Kirchhoff energy of positions of order 2 or 3.  With tied=1 the strain is
interpolated in the Regge element (Neunteufel & Schöberl, Comput. Methods Appl. Mech. Eng. 373
(2021) 113524); with tied=0 it is sampled at three points of a triangle of order 2, which is another
discretisation of the same film, and cheaper.  Bending: interior penalty of the jumps of the slope.

Booms: bars with axial stiffness and consistent mass from corner to corner, which remain straight.
Film and booms share the corners; the film's nodes at the thirds of the diagonals lie on the bars.

Step: the mean of the force along the straight path of a step, by two points of Gauss.  That is
exact for this energy, which is of fourth degree in the positions, so that energy is conserved.
"""

from __future__ import annotations

import json
from itertools import pairwise
from pathlib import Path

import ngsolve as ng
import numpy as np
import scipy.sparse as sp
from contestants import Clock, words
from netgen.meshing import Element1D, Element2D, FaceDescriptor, Mesh, MeshPoint, Pnt
from scipy.sparse.linalg import splu

# The antenna of the paper: sizes [m], elasticity [Pa], densities [kg/m³] and gravity [m/s²].
SIDE = 2.1
E = 2.3e9
NU = 0.3
DENSITY = 1400.0
THICKNESS = 2e-5
BOOM_AREA = np.pi * (0.02**2 - 0.0195**2)  # m²
BOOM_STIFFNESS = 100e9 * BOOM_AREA  # N
BOOM_MASS = 1560.0 * BOOM_AREA  # kg/m
G = 1.0
# A step has converged when Newton's correction is below this length [m].
LENGTH_TOLERANCE = 1e-8
MAX_ITERATIONS = 15
MAX_HALVINGS = 6
# Penalty of the jumps of the slope, over the bending stiffness and the square of the order.
PENALTY = 2.5
GAUSS_POINTS = (0.5 - 0.5 / 3**0.5, 0.5 + 0.5 / 3**0.5)

# Words of the command line, and what they are without; `output` is a file for the heights.
case = words(
    {"n": 6, "order": 2, "tied": 1, "bending": 1.0, "dt": 1e-2, "until": 2.0, "output": ""}
)
n = case["n"]
order = case["order"]
if n % 3:
    raise SystemExit(f"n is {n}; give a multiple of 3: film and booms are tied at the thirds.")
ng.ngsglobals.msg_level = 0
# CPU times are compared on one thread.
ng.SetNumThreads(1)

# ---- mesh: squares of four triangles around a centre, as of the film here ------------------------

grid = np.arange((n + 1) ** 2).reshape(n + 1, n + 1)
raw_mesh = Mesh(dim=2)
raw_mesh.Add(FaceDescriptor(surfnr=1, domin=1, domout=0, bc=1))
raw_mesh.SetMaterial(1, "film")
ticks = SIDE * (np.arange(n + 1) / n - 0.5)
centres = (ticks[1:] + ticks[:-1]) / 2
nodes = [raw_mesh.Add(MeshPoint(Pnt(x, y, 0))) for x in ticks for y in ticks]
inner_nodes = [raw_mesh.Add(MeshPoint(Pnt(x, y, 0))) for x in centres for y in centres]
for i in range(n):
    for j in range(n):
        square = [grid[i, j], grid[i + 1, j], grid[i + 1, j + 1], grid[i, j + 1]]
        for a, b in zip(square, square[1:] + square[:1], strict=True):
            triangle = [nodes[a], nodes[b], inner_nodes[i * n + j]]
            raw_mesh.Add(Element2D(1, triangle))
for side in (grid[:, 0], grid[-1], grid[::-1, -1], grid[0, ::-1]):
    for a, b in pairwise(side):
        raw_mesh.Add(Element1D([nodes[a], nodes[b]], index=1))
mesh = ng.Mesh(raw_mesh)

# ---- film: constant matrices of one component, and the energy of the strain ----------------------

H = ng.H1(mesh, order=order, dgjumps=True)
size = H.ndof
w, dw = H.TnT()
normal = ng.specialcf.normal(2)
D = case["bending"] * E * THICKNESS**3 / (12 * (1 - NU**2))


def moment(w):
    hessian = w.Operator("hesse")
    return D * ((1 - NU) * hessian + NU * ng.Trace(hessian) * ng.Id(2))


def slope_jump(w):
    return (ng.grad(w) - ng.grad(w.Other())) * normal


def mean_moment(w):
    return 0.5 * normal * ((moment(w) + moment(w.Other())) * normal)


bending = ng.BilinearForm(H)
bending += ng.InnerProduct(moment(w), dw.Operator("hesse")) * ng.dx
bending += (
    PENALTY * order**2 * D / ng.specialcf.mesh_size * slope_jump(w) * slope_jump(dw)
    - mean_moment(w) * slope_jump(dw)
    - mean_moment(dw) * slope_jump(w)
) * ng.dx(skeleton=True)
bending.Assemble()
mass = ng.BilinearForm(H)
mass += DENSITY * THICKNESS * w * dw * ng.dx
mass.Assemble()

space = ng.FESpace([ng.H1(mesh, order=order)] * 3)
# Displacements at the end and at the start of a step.
end = ng.GridFunction(space)
start = ng.GridFunction(space)
residual = end.vec.CreateVector()
strains = ng.HCurlCurl(mesh, order=order - 1)
end_gradients = [ng.grad(component) for component in space.TrialFunction()]
start_gradients = [ng.grad(component) for component in start.components]


def energy_density(gradients):
    """Energy per area [J/m²] of the strain of three gradients of displacements."""
    unit = ((1, 0), (0, 1), (0, 0))
    F = [[gradients[c][a] + unit[c][a] for a in range(2)] for c in range(3)]
    strain = [
        0.5 * (sum(F[c][a] * F[c][b] for c in range(3)) - unit[a][b])
        for a in range(2)
        for b in range(2)
    ]
    tensor = ng.CF(tuple(strain), dims=(2, 2))
    if case["tied"]:
        tensor = ng.Interpolate(tensor, strains)
    squares = (1 - NU) * ng.InnerProduct(tensor, tensor) + NU * ng.Trace(tensor) ** 2
    return 0.5 * THICKNESS * E / (1 - NU**2) * squares


film = ng.BilinearForm(space, symmetric=True)
points = {ng.TRIG: ng.IntegrationRule(ng.TRIG, 2 * order - 2)}
for s in GAUSS_POINTS:
    on_path = [a + s * (b - a) for a, b in zip(start_gradients, end_gradients, strict=True)]
    # The derivative of W(start + s (end - start))/s is the force at this point of the path.
    part = 0.5 / s * energy_density(on_path)
    # Compiled code is faster, but not with an interpolation in it.
    film += ng.Variation((part if case["tied"] else part.Compile()) * ng.dx(intrules=points))


def scipy_matrix(matrix):
    rows, columns, entries = matrix.COO()
    shape = (matrix.height, matrix.width)
    return sp.csr_matrix((np.array(entries), (np.array(rows), np.array(columns))), shape=shape)


# ---- booms, ties, gravity ------------------------------------------------------------------------

LENGTH = SIDE * 2**0.5
A, B, C, D_ = grid[-1, -1], grid[0, -1], grid[0, 0], grid[-1, 0]
BARS = ((A, C), (B, D_))
PLACES = np.array([[x, y, 0.0] for x in ticks for y in ticks])


def dofs(node):
    """Numbers of the three components of a vertex."""
    return node + size * np.arange(3)


def bar(x, p, q):
    """Energy [J], force (3,) on the first end [N] and stiffness (3, 3) [N/m] of a bar."""
    r = x[dofs(p)] + PLACES[p] - x[dofs(q)] - PLACES[q]
    strain = (r @ r / LENGTH**2 - 1) / 2
    along = r / LENGTH**2
    force = BOOM_STIFFNESS * LENGTH * strain * along
    tangent = np.outer(along, along) + strain * np.eye(3) / LENGTH**2
    return BOOM_STIFFNESS * LENGTH * strain**2 / 2, force, BOOM_STIFFNESS * LENGTH * tangent


total = 3 * size
M = sp.block_diag([scipy_matrix(mass.mat)] * 3).tolil()
K_bending = sp.block_diag([scipy_matrix(bending.mat)] * 3).tocsr()
# The functions of the vertices sum to one.
vertical = np.zeros(total)
vertical[2 * size : 2 * size + mesh.nv] = 1
weight = -G * (M @ vertical)
for p, q in BARS:
    for a, b in ((p, p), (p, q), (q, p), (q, q)):
        share = 2 if a == b else 1
        for row, column in zip(dofs(a), dofs(b), strict=True):
            M[row, column] += BOOM_MASS * LENGTH / 6 * share
    for a in (p, q):
        weight[dofs(a)[2]] -= G * BOOM_MASS * LENGTH / 2
M = M.tocsr()
# C is held; the nodes at the thirds follow the corners.
T = sp.identity(total, format="lil")
third = n // 3
dependent = list(dofs(C))
for node, near, far in (
    (grid[-1 - third, -1 - third], A, C),
    (grid[third, third], C, A),
    (grid[third, -1 - third], B, D_),
    (grid[-1 - third, third], D_, B),
):
    T[dofs(node), dofs(node)] = 0
    T[dofs(node), dofs(near)] = 2 / 3
    T[dofs(node), dofs(far)] = 1 / 3
    dependent += list(dofs(node))
T = T.tocsr()[:, np.setdiff1d(np.arange(total), dependent)]

# ---- time steps ----------------------------------------------------------------------------------


def forces(x, x0):
    """Mean force and its derivative by the end x of a step from x0."""
    end.vec.FV().NumPy()[:] = x
    film.Apply(end.vec, residual)
    film.AssembleLinearization(end.vec)
    f = residual.FV().NumPy() + K_bending @ (x + x0) / 2
    of_bars = sp.lil_matrix((total, total))
    for p, q in BARS:
        for s in GAUSS_POINTS:
            _, force, tangent = bar(x0 + s * (x - x0), p, q)
            for a, sign in ((p, 1), (q, -1)):
                f[dofs(a)] += sign * force / 2
                for b, other in ((p, 1), (q, -1)):
                    of_bars[np.ix_(dofs(a), dofs(b))] += sign * other * s / 2 * tangent
    return f, scipy_matrix(film.mat) + K_bending / 2 + of_bars.tocsr()


def step(x0, v0, h):
    """Displacements and velocities after a step of h [s], and the number of iterations; None if
    Newton's iteration does not converge."""
    start.vec.FV().NumPy()[:] = x0
    x = x0 + h * v0
    for iteration in range(1, MAX_ITERATIONS + 1):
        f, K = forces(x, x0)
        r = f - weight + 2 / h**2 * (M @ (x - x0 - h * v0))
        matrix = (T.T @ (K + 2 / h**2 * M) @ T).tocsc()
        # An order for symmetric matrices; pivots from the diagonal unless they are small.
        factors = splu(
            matrix,
            permc_spec="MMD_AT_PLUS_A",
            diag_pivot_thresh=1e-3,
            options={"SymmetricMode": True},
        )
        correction = T @ factors.solve(T.T @ r)
        x = x - correction
        if np.abs(correction).max() < LENGTH_TOLERANCE:
            return x, 2 * (x - x0) / h - v0, iteration
        if not np.isfinite(correction).all():
            break
    return None


def advance(x0, v0, h):
    """A step as `step`, or two of its halves instead where it does not converge."""
    done = step(x0, v0, h)
    if done is not None:
        return done
    if h < case["dt"] / 2**MAX_HALVINGS:
        raise SystemExit(f"no convergence in {MAX_ITERATIONS} iterations; give a smaller dt.")
    middle, v, before = advance(x0, v0, h / 2)
    x, v, after = advance(middle, v, h / 2)
    return x, v, MAX_ITERATIONS + before + after


x = np.zeros(total)
v = np.zeros(total)
stored = energy_density([ng.grad(component) for component in end.components])
steps = round(case["until"] / case["dt"])
heights = [0.0]
iterations = 0
clock = Clock()
for _ in range(steps):
    x, v, used = advance(x, v, case["dt"])
    iterations += used
    heights.append(float(x[dofs(A)[2]]))
measured = clock.figures()

end.vec.FV().NumPy()[:] = x
kinetic = v @ (M @ v) / 2
energy = kinetic + ng.Integrate(stored, mesh, order=2 * order - 2) + x @ (K_bending @ x) / 2
energy += sum(bar(x, p, q)[0] for p, q in BARS) - weight @ x
result = {
    **measured,
    "dofs": total,
    "steps": steps,
    "Newton/step": iterations / steps,
    # At rest all is zero.
    "ΔE/E": energy / kinetic,
    "tip [mm]": 1e3 * heights[-1],
}
if case["output"]:
    instants = [case["dt"] * k for k in range(steps + 1)]
    Path(case["output"]).write_text(
        json.dumps(result | {"time": instants, "tip": heights}), encoding="utf-8"
    )
print(json.dumps(result))
