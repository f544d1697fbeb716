"""The plates in Kratos: thin corotational triangles with discrete Kirchhoff bending; the load in
increments."""

from __future__ import annotations

import json

import kratos_model
import KratosMultiphysics as K
import KratosMultiphysics.StructuralMechanicsApplication as Structures
import numpy as np
from contestants import Clock, words
from shared_problems import CASES, grid

# Words of the command line, and what they are without.
case = words(
    {
        "shape": "strip",
        "n": 16,
        "increments": 10,
        "power": 1.0,
        "element": "ShellThinElementCorotational3D3N",
    }
)
shape = CASES[case["shape"]]
points, ids = grid(case["shape"], case["n"])
X = points.reshape(-1, 3)
# Corners of the cells, counterclockwise.
a, b, c, d = (corner.ravel() for corner in (ids[:-1, :-1], ids[1:, :-1], ids[1:, 1:], ids[:-1, 1:]))
triangles = np.concatenate([np.column_stack([a, b, c]), np.column_stack([a, c, d])])

model = K.Model()
# Rotations and moments are the additional unknowns of shells.
part = kratos_model.model_part(model, X, (K.ROTATION, K.REACTION_MOMENT, Structures.POINT_MOMENT))
plate = part.CreateNewProperties(1)
for name, value in {
    K.YOUNG_MODULUS: shape.E,
    K.POISSON_RATIO: 0.0,
    K.DENSITY: 1.0,
    K.THICKNESS: shape.thickness,
}.items():
    plate.SetValue(name, value)
plate.SetValue(K.CONSTITUTIVE_LAW, Structures.LinearElasticPlaneStress2DLaw())
for axis in "XYZ":
    for motion, force in (("DISPLACEMENT", "REACTION"), ("ROTATION", "REACTION_MOMENT")):
        K.VariableUtils().AddDof(
            getattr(K, f"{motion}_{axis}"), getattr(K, f"{force}_{axis}"), part
        )
# Other elements than the triangle of three nodes have four.
cells = triangles if case["element"].endswith("3N") else np.column_stack([a, b, c, d])
for number, corners in enumerate(cells.tolist(), start=1):
    part.CreateNewElement(case["element"], number, [k + 1 for k in corners], plate)
# The first row of nodes is clamped.
for k in ids[0].tolist():
    for axis in "XYZ":
        part.Nodes[k + 1].Fix(getattr(K, f"DISPLACEMENT_{axis}"))
        part.Nodes[k + 1].Fix(getattr(K, f"ROTATION_{axis}"))
end = points[-1]
lengths = np.linalg.norm(np.diff(end, axis=0), axis=1)
# Each node of the last row bears half of its two edges.
shares = (np.append(lengths, 0) + np.append(0, lengths)) / 2
for number, k in enumerate(ids[-1].tolist(), start=1):
    part.CreateNewCondition("PointLoadCondition3D1N", number, [k + 1], plate)

scheme = K.ResidualBasedIncrementalUpdateStaticScheme()
strategy = kratos_model.newton_strategy(
    part, scheme, absolute=1e-9, solver="sparse_lu", iterations=40
)
clock = Clock()
iterations = 0
for increment in range(1, case["increments"] + 1):
    part.CloneTimeStep(float(increment))
    part.ProcessInfo[K.STEP] = increment
    # Load of the increment, by the share of each node.
    for k, share in zip(ids[-1].tolist(), shares, strict=True):
        load = shape.load * share * (increment / case["increments"]) ** case["power"]
        part.Nodes[k + 1].SetSolutionStepValue(Structures.POINT_LOAD, [0.0, 0.0, float(load)])
    strategy.InitializeSolutionStep()
    strategy.Predict()
    if not strategy.SolveSolutionStep():
        raise SystemExit(
            f"Newton's iteration failed in increment {increment} of {case['increments']}"
        )
    strategy.FinalizeSolutionStep()
    iterations += part.ProcessInfo[K.NL_ITERATION_NUMBER]
measured = clock.figures()
heights = kratos_model.nodal(part, K.DISPLACEMENT)[ids[-1], 2]
result = {
    **measured,
    # Six unknowns a node.
    "dofs": 6 * len(X),
    "steps": iterations,
    "W": float(heights.max()),
}
print(json.dumps(result | {"error [%]": 100 * abs(result["W"] / shape.deflection - 1)}))
