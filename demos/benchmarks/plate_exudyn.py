"""The strip in Exudyn: thin plates of absolute nodal coordinates, static solution with load
steps."""

from __future__ import annotations

import json

import exudyn as exu
import exudyn.shells
import numpy as np
from contestants import Clock, words
from exudyn.itemInterface import Force, MarkerNodePosition
from shared_problems import CASES, grid

case = words({"shape": "strip", "n": 16, "increments": 10})
if case["shape"] != "strip":
    raise SystemExit(
        "rectangular elements only: their reference slopes are those of a plane rectangle"
    )
shape = CASES["strip"]
points, _ = grid("strip", case["n"])
nx = points.shape[0] - 1
ny = points.shape[1] - 1
container = exu.SystemContainer()
mbs = container.AddSystem()
plate = exudyn.shells.ShellMesh(
    vertices=[[0, 0, 0], [10, 0, 0], [10, 1, 0], [0, 1, 0]],
    numberOfElementsX=nx,
    numberOfElementsY=ny,
    youngsModulus=shape.E,
    poissonsRatio=0.0,
    density=1.0,
    thickness=shape.thickness,
)
plate.CreateANCFThinPlateElements(mbs, useReducedOrderIntegration=1)
nodes = np.array(plate.nodeNumbers).reshape(ny + 1, nx + 1)
for node in nodes[:, 0].tolist():
    # position held, and of both slopes what is across them: the plate may stretch
    exudyn.shells.AddClampToGround(mbs, node, [1, 1, 1, 0, 1, 1, 1, 0, 1])
shares = np.full(ny + 1, 1.0 / ny)
shares[[0, -1]] /= 2
for node, share in zip(nodes[:, -1].tolist(), shares, strict=True):
    marker = mbs.AddMarker(MarkerNodePosition(nodeNumber=node))
    mbs.AddLoad(Force(markerNumber=marker, loadVector=[0, 0, shape.load * share]))
mbs.Assemble()
settings = exu.SimulationSettings()
settings.staticSolver.numberOfLoadSteps = case["increments"]
settings.staticSolver.newton.relativeTolerance = 1e-6
settings.staticSolver.newton.absoluteTolerance = 1e-8
settings.staticSolver.verboseMode = 0
settings.solutionSettings.writeSolutionToFile = False
settings.linearSolverType = exu.LinearSolverType.EigenSparse
settings.parallel.numberOfThreads = 1
clock = Clock()
mbs.SolveStatic(settings)
measured = clock.figures()
W = max(
    mbs.GetNodeOutput(node, exu.OutputVariableType.Displacement)[2]
    for node in nodes[:, -1].tolist()
)
result = {
    **measured,
    "dofs": len(mbs.systemData.GetODE2Coordinates()),
    "steps": case["increments"],
    "W": float(W),
}
print(json.dumps(result | {"error [%]": 100 * abs(result["W"] / shape.deflection - 1)}))
