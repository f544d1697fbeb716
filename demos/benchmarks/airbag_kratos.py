"""Quarter of one sheet of the square airbag in Kratos: wrinkling law, central differences, damped
to rest.

The wrinkling law takes the direction of the wrinkles from the principal stresses of the taut film.
For an isotropic film this is the relaxed energy; for a fabric (`law=fabric`) it is an
approximation.
"""

from __future__ import annotations

import json
import math

import kratos_model
import KratosMultiphysics as K
import KratosMultiphysics.StructuralMechanicsApplication as Structures
import numpy as np
from contestants import Clock, words
from shared_problems import BLOWN_UNTIL, MASS_DAMPING, MODULI, RISE, instants_of, volume_below

# The airbag of the literature [Pa, 1, kg/m³, m, Pa, m].
E = 588e6
NU = 0.4
DENSITY = 1000.0
THICKNESS = 6e-4
PRESSURE = 5000.0
EDGE = 0.6 / math.sqrt(2)
case = words(
    {
        "n": 16,
        "until": 0.3,
        "damping": 60.0,
        "courant": 0.4,
        "still": 1e-5,
        "law": "isotropic",
        "angle": 0.0,
        # 1: the pressure rises and the damping is that of the blown airbag, see shared_problems.py.
        "blown": 0,
    }
)

n = case["n"]
X, cells = kratos_model.grid(n, EDGE)
# diagonals alternate so that no triangle has all its corners on the seam, where it could not open
# Cells of odd sum of row and column.
odd = (np.arange(n * n) // n + np.arange(n * n)) % 2 == 1
falling = cells[odd][:, [[0, 1, 3], [1, 2, 3]]].reshape(-1, 3)
triangles = np.concatenate([cells[~odd][:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3), falling])
# Variables that the explicit scheme stores at the nodes.
explicit = (
    *(
        Structures.MIDDLE_VELOCITY,
        Structures.FRACTIONAL_ACCELERATION,
        Structures.FRACTIONAL_ANGULAR_ACCELERATION,
    ),
    *(
        K.NODAL_MASS,
        K.FORCE_RESIDUAL,
        K.RESIDUAL_VECTOR,
        K.MOMENT_RESIDUAL,
        Structures.MIDDLE_ANGULAR_VELOCITY,
    ),
    *(
        Structures.NODAL_INERTIA,
        Structures.NODAL_DISPLACEMENT_DAMPING,
        Structures.NODAL_ROTATION_DAMPING,
    ),
)
model = K.Model()
part = kratos_model.model_part(model, X, explicit)
if case["law"] == "fabric":
    film = kratos_model.add_fabric(
        part, triangles, MODULI, DENSITY, THICKNESS, angle=math.radians(case["angle"])
    )
else:
    film = kratos_model.add_film(part, triangles, E, NU, DENSITY, THICKNESS, wrinkling=True)
# Mass-proportional damping [1/s], chosen so that the airbag comes to rest fast.
film.SetValue(Structures.RAYLEIGH_ALPHA, MASS_DAMPING if case["blown"] else case["damping"])
for number, corners in enumerate(triangles.tolist(), start=1):
    part.CreateNewCondition("SurfaceLoadCondition3D3N", number, [c + 1 for c in corners], film)
# m: nodes on the planes of symmetry and on the seam.
near = 1e-9
for node in part.Nodes:
    for held, axis in (
        (near > node.X, "X"),
        (near > node.Y, "Y"),
        (max(node.X, node.Y) > EDGE - near, "Z"),
    ):
        if held:
            node.Fix(getattr(K, f"DISPLACEMENT_{axis}"))
    # Both instants have the whole pressure from the begin.
    for step in (0, 1):
        node.SetSolutionStepValue(
            K.NEGATIVE_FACE_PRESSURE, step, 0.0 if case["blown"] else PRESSURE
        )

# Speed of waves in the film; the step is a part of its passage of the shortest edge.
speed = math.sqrt(E / DENSITY / (1 - NU**2))
dt = case["courant"] * EDGE / n / math.sqrt(2) / speed
scheme = Structures.ExplicitCentralDifferencesScheme(
    K.Parameters(
        f'{{"time_step_prediction_level": 0, "max_delta_time": {dt}, "fraction_delta_time": 0.9}}'
    )
)
strategy = Structures.MechanicalExplicitStrategy(part, scheme, False, False, True)
strategy.SetEchoLevel(0)
strategy.Initialize()
instants = [*instants_of(BLOWN_UNTIL), math.inf]
clock = Clock()
steps = 0
heights = [0.0]
volumes = []
# Look every 2 ms.
every = max(1, round(2e-3 / dt))
until = BLOWN_UNTIL if case["blown"] else case["until"]
while steps * dt < until:
    steps += 1
    part.CloneTimeStep(steps * dt)
    if case["blown"]:
        # The load of a step is that of its start.
        pressure = PRESSURE * min((steps - 1) * dt / RISE, 1.0)
        K.VariableUtils().SetVariable(K.NEGATIVE_FACE_PRESSURE, pressure, part.Nodes)
    part.ProcessInfo[K.STEP] = steps
    part.ProcessInfo[K.DELTA_TIME] = dt
    strategy.Solve()
    if case["blown"]:
        if steps * dt >= instants[len(volumes)] - dt / 2:
            volumes.append(volume_below(kratos_model.positions(part), triangles))
    elif steps % every == 0:
        heights.append(part.Nodes[1].Z)
        # At rest when ten heights in a row differ by less than `still`.
        recent = heights[-10:]
        if not math.isfinite(heights[-1]) or (
            len(recent) == 10 and np.ptp(recent) < case["still"] * abs(recent[-1])
        ):
            break
volume = volume_below(kratos_model.positions(part), triangles)
result = {
    **clock.figures(),
    "dofs": X.size,
    "steps": steps,
    "w_M": part.Nodes[1].Z,
    "V": volume,
    "until": steps * dt,
    "volumes": volumes,
}
print(json.dumps(result))
