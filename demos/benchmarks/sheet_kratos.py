"""The free sheet of the demo `spinning_sheet` in Kratos: membrane triangles, Bossak's scheme, full
Newton."""

from __future__ import annotations

import json

import kratos_model
import KratosMultiphysics as K
import KratosMultiphysics.StructuralMechanicsApplication as Structures
import numpy as np
from contestants import Clock, words

# The sheet of the demo: mass, thickness and spin [kg/m³, m, rad/s].
DENSITY = 1400.0
THICKNESS = 1e-4
SPIN = 10.0
case = words({"n": 40, "steps": 5, "dt": 1e-3, "wrinkling": 1, "solver": "sparse_lu"})

X, cells = kratos_model.grid(case["n"], 1.0)
triangles = np.concatenate([cells[:, [0, 1, 2]], cells[:, [0, 2, 3]]])
model = K.Model()
part = kratos_model.model_part(model, X)
kratos_model.add_film(part, triangles, 1e9, 0.3, DENSITY, THICKNESS, bool(case["wrinkling"]))
x, y, _ = X.T
for node, velocity in zip(
    part.Nodes,
    np.column_stack(
        [-SPIN * (y - 0.5), SPIN * (x - 0.5), np.sin(np.pi * x) * np.sin(np.pi * y)]
    ).tolist(),
    strict=True,
):
    # Both instants that the scheme reads.
    for step in (0, 1):
        node.SetSolutionStepValue(K.VELOCITY, step, velocity)


def angular_momentum() -> np.ndarray:
    """With the consistent mass of the triangles."""
    q = X + kratos_model.nodal(part, K.DISPLACEMENT)
    v = kratos_model.nodal(part, K.VELOCITY)
    edges = X[triangles[:, 1:]] - X[triangles[:, :1]]
    areas = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1) / 2
    # Consistent mass of a triangle: 1/12 of it for pairs of corners, 1/6 for a corner itself.
    weights = DENSITY * THICKNESS * areas[:, None, None] / 12 * (1 + np.eye(3))
    return np.einsum(
        "eab,eabk->k", weights, np.cross(q[triangles][:, :, None], v[triangles][:, None])
    )


# Bossak's parameter of Kratos' usual settings, with its numerical damping.
scheme = Structures.StructuralMechanicsBossakScheme(
    K.Parameters('{"damp_factor_m": -0.3, "newmark_beta": 0.25, "projection_variables_list": []}')
)
strategy = kratos_model.newton_strategy(
    part, scheme, absolute=1e-10, solver=case["solver"], iterations=30
)
first = angular_momentum()
clock = Clock()
iterations = 0
unconverged = 0
for step in range(1, case["steps"] + 1):
    part.CloneTimeStep(step * case["dt"])
    part.ProcessInfo[K.STEP] = step
    strategy.InitializeSolutionStep()
    strategy.Predict()
    # A step that has not converged counts, and the run continues.
    unconverged += not strategy.SolveSolutionStep()
    strategy.FinalizeSolutionStep()
    iterations += part.ProcessInfo[K.NL_ITERATION_NUMBER]
result = {
    **clock.figures(),
    "dofs": X.size,
    "steps": case["steps"],
    "Newton/step": iterations / case["steps"],
    "unconverged": unconverged,
    "ΔL/L": float(np.linalg.norm(angular_momentum() - first) / np.linalg.norm(first)),
}
print(json.dumps(result))
