"""The antenna pendulum in Exudyn: thin plates and cables of absolute nodal coordinates,
generalised-alpha method."""

from __future__ import annotations

import json
from itertools import pairwise
from pathlib import Path

import exudyn as exu
import exudyn.shells
import numpy as np
from contestants import Clock, words
from exudyn.itemInterface import (
    LoadMassProportional,
    MarkerBodyMass,
    MarkerNodeCoordinates,
    NodePointSlope1,
    ObjectANCFCable,
    ObjectConnectorCoordinateVector,
    SensorBody,
    SensorNode,
)
from shared_problems import instants_of

# The antenna of the paper: sizes [m] and gravity [m/s²].
SIDE = 2.1
THICKNESS = 2e-5
RADIUS = 0.02
WALL = 5e-4
G = 1.0
case = words(
    {"n": 6, "elements": 12, "dt": 1e-2, "until": 2.0, "radius": 0.9, "every": 0.01, "output": ""}
)
n = case["n"]
elements = case["elements"]

container = exu.SystemContainer()
mbs = container.AddSystem()
film = exudyn.shells.ShellMesh(
    vertices=[[0, 0, 0], [SIDE, 0, 0], [SIDE, SIDE, 0], [0, SIDE, 0]],
    numberOfElementsX=n,
    numberOfElementsY=n,
    youngsModulus=2.3e9,
    poissonsRatio=0.3,
    density=1400.0,
    thickness=THICKNESS,
)
# Reduced integration, without which thin plates lock.
film.CreateANCFThinPlateElements(mbs, useReducedOrderIntegration=1)
# Section of the tubes.
area = np.pi * (RADIUS**2 - (RADIUS - WALL) ** 2)
second_moment = np.pi / 4 * (RADIUS**4 - (RADIUS - WALL) ** 4)
bodies = list(film.elementNumbers)
booms = []
# Both booms, from corner to corner.
for start, end in (((0, 0, 0), (SIDE, SIDE, 0)), ((SIDE, 0, 0), (0, SIDE, 0))):
    a = np.array(start)
    along = np.subtract(end, start)
    length = float(np.linalg.norm(along))
    points = [a + along * k / elements for k in range(elements + 1)]
    # A node has a position and the slope of the axis.
    nodes = [
        mbs.AddNode(NodePointSlope1(referenceCoordinates=[*p, *(along / length)])) for p in points
    ]
    for pair in pairwise(nodes):
        cable = ObjectANCFCable(
            length=length / elements,
            massPerLength=1560.0 * area,
            bendingStiffness=100e9 * second_moment,
            axialStiffness=100e9 * area,
            nodeNumbers=list(pair),
        )
        bodies.append(mbs.AddObject(cable))
    booms.append(nodes)
for body in bodies:
    # Gravity acts on the mass of plates and cables.
    marker = mbs.AddMarker(MarkerBodyMass(bodyNumber=body))
    mbs.AddLoad(LoadMassProportional(markerNumber=marker, loadVector=[0, 0, -G]))
for k in (0, 1, 2, 3):  # tied at the corners and at the thirds of the diagonals
    i = k * n // 3
    on_boom = k * elements // 3
    for node, boom in (
        (film.nodeNumbers[i * (n + 1) + i], 0),
        (film.nodeNumbers[i * (n + 1) + n - i], 1),
    ):
        markers = [
            mbs.AddMarker(MarkerNodeCoordinates(nodeNumber=m)) for m in (node, booms[boom][on_boom])
        ]
        mbs.AddObject(
            ObjectConnectorCoordinateVector(
                markerNumbers=markers,
                # The position is the first three of the nine coordinates of a plate's node, and of
                # the six of a cable's.
                scalingMarker0=np.eye(3, 9),
                scalingMarker1=np.eye(3, 6),
            )
        )
exudyn.shells.AddSphericalJointToGround(mbs, film.nodeNumbers[0])

position = {"outputVariableType": exu.OutputVariableType.Position, "storeInternal": True}
corners = [film.nodeNumbers[k] for k in (0, n, n * (n + 1) + n, n * (n + 1))]
of_corners = [mbs.AddSensor(SensorNode(nodeNumber=node, **position)) for node in corners]
# Gauss points of each element, so that the mean square has the weights of the mass.
gauss = np.array([-1, 1]) / 3**0.5
of_film = []
places = []
for e, body in enumerate(film.elementNumbers):
    for r in gauss:
        for s in gauss:
            of_film.append(
                mbs.AddSensor(SensorBody(bodyNumber=body, localPosition=[r, s, 0], **position))
            )
            # Place of the point in the square, 0 to 1.
            places.append(((e % n + (1 + r) / 2) / n, (e // n + (1 + s) / 2) / n))
mbs.Assemble()

settings = exu.SimulationSettings()
stepping = settings.timeIntegration
stepping.numberOfSteps = round(case["until"] / case["dt"])
stepping.endTime = case["until"]
stepping.generalizedAlpha.spectralRadius = case["radius"]
# The tangent of the first iteration is used again, as Exudyn recommends.
stepping.newton.useModifiedNewton = True
stepping.newton.relativeTolerance = 1e-6
stepping.newton.absoluteTolerance = 1e-8
stepping.verboseMode = 0
settings.solutionSettings.writeSolutionToFile = False
# Instants at which sensors are read.
settings.solutionSettings.sensorsWritePeriod = case["every"]
settings.linearSolverType = exu.LinearSolverType.EigenSparse
settings.parallel.numberOfThreads = 1
clock = Clock()
mbs.SolveDynamic(settings)
measured = clock.figures()

q = np.array([mbs.GetSensorStoredData(s)[:, 1:4] for s in of_corners])  # 4 corners, instants, 3
x = np.array([mbs.GetSensorStoredData(s)[:, 1:4] for s in of_film])
u, v = np.array(places).T
# Bilinear surface of the four corners.
surface = np.einsum("cp,ctk->ptk", [(1 - u) * (1 - v), u * (1 - v), u * v, (1 - u) * v], q)
normal = np.cross(q[1] - q[0], q[3] - q[0])
normal /= np.linalg.norm(normal, axis=1)[:, None]
deflection = np.sqrt(np.mean(np.einsum("ptk,tk->pt", x - surface, normal) ** 2, axis=0))
instants = mbs.GetSensorStoredData(of_corners[2])[:, 0].tolist()
result = {
    **measured,
    "dofs": len(mbs.systemData.GetODE2Coordinates()),
    "steps": round(case["until"] / case["dt"]),
    "tip [mm]": 1e3 * q[2, -1, 2],
    "tips [mm]": (1e3 * np.interp(instants_of(case["until"]), instants, q[2, :, 2])).tolist(),
    "film, end [mm]": 1e3 * deflection[-1],
    "film, rms [mm]": 1e3 * float(np.sqrt(np.mean(deflection**2))),
    "film, largest [mm]": 1e3 * deflection.max(),
}
if case["output"]:
    heights = {"time": instants, "tip": q[2, :, 2].tolist()}
    Path(case["output"]).write_text(json.dumps(result | heights), encoding="utf-8")
print(json.dumps(result))
