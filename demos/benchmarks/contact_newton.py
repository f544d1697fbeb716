"""The two films of `contact_scene.py` in Newton's cloth solver (vertex block descent, implicit
Euler, 32 bits)."""

from __future__ import annotations

import json
import time

import newton
import numpy as np
import warp as wp
from contact_scene import (
    DISTANCE,
    LAME,
    SIGMA,
    elastic_energy,
    figures_of_upper,
    films,
    penetrations,
)
from contestants import words

case = words({"n": 10, "dt": 1e-4, "until": 0.01, "iterations": 20, "stiffness": 0.0})
wp.config.quiet = True
wp.init()
wp.set_device("cpu")
X, x, v, triangles = films(case["n"])
builder = newton.ModelBuilder(gravity=(0.0, 0.0, 0.0))
μ, λ = LAME
builder.add_cloth_mesh(
    pos=wp.vec3(0.0, 0.0, 0.0), rot=wp.quat_identity(), scale=1.0, vel=wp.vec3(0.0, 0.0, 0.0),
    vertices=[wp.vec3(*map(float, p)) for p in x], indices=triangles.ravel().tolist(),
    density=SIGMA,
    tri_ke=μ, tri_ka=λ, tri_kd=0.0, edge_ke=0.0, edge_kd=0.0, particle_radius=DISTANCE / 2,
)  # fmt: skip
builder.color()
model = builder.finalize()
mass = model.particle_mass.numpy().astype(float)
# as stiff as this program chooses it: 4 σ v² A of a node, over the square of the distance
area = float(np.median(mass)) / SIGMA
model.soft_contact_ke = case["stiffness"] or 4 * SIGMA * 5.0**2 * area / DISTANCE**2
model.soft_contact_kd = 0.0
model.soft_contact_mu = 0.0
solver = newton.solvers.SolverVBD(
    model,
    iterations=case["iterations"],
    particle_enable_self_contact=True,
    particle_self_contact_margin=DISTANCE,
    particle_self_contact_gap=DISTANCE / 2,
    particle_vertex_contact_buffer_size=128,
    particle_edge_contact_buffer_size=256,
    particle_topological_contact_filter_threshold=1,
)
one = model.state()
two = model.state()
one.particle_qd.assign(v.astype(np.float32))
control = model.control()
steps = round(case["until"] / case["dt"])


def totals(state) -> tuple[float, np.ndarray, np.ndarray]:
    """Energy, momentum, angular momentum."""
    q = state.particle_q.numpy().astype(float)
    u = state.particle_qd.numpy().astype(float)
    p = mass[:, None] * u
    return (
        float((p * u).sum() / 2) + elastic_energy(X, q, triangles),
        p.sum(axis=0),
        np.cross(q, p).sum(axis=0),
    )


def advance(a, b) -> None:
    a.clear_forces()
    solver.step(a, b, control, None, case["dt"])


saved = one.particle_q.numpy(), one.particle_qd.numpy()
advance(one, two)  # compiles
one.particle_q.assign(saved[0])
one.particle_qd.assign(saved[1])
first = totals(one)
cpu = time.process_time()
wall = time.perf_counter()
most = 0
for k in range(steps):
    if k % 10 == 0:
        solver.rebuild_bvh(one)
    advance(one, two)
    one, two = two, one
cpu = time.process_time() - cpu
wall = time.perf_counter() - wall
last = totals(one)
q = one.particle_q.numpy()
u = one.particle_qd.numpy()
spin = max(float(np.linalg.norm(first[2])), 0.05 * float(np.linalg.norm(first[1])))
print(
    json.dumps(
        {
            "cpu": cpu,
            "wall": wall,
            "dofs": q.size,
            "steps": steps,
            "ΔE/E": abs(last[0] / first[0] - 1),
            "ΔP/P": float(np.linalg.norm(last[1] - first[1]) / np.linalg.norm(first[1])),
            "ΔL/L": float(np.linalg.norm(last[2] - first[2])) / spin,
            "penetrations": penetrations(q.astype(float), triangles),
            **figures_of_upper(q.astype(float), u.astype(float), triangles),
        }
    )
)
