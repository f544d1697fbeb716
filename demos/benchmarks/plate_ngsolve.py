"""The plates in NGSolve: a nonlinear Koiter shell by the Hellan-Herrmann-Johnson method and Regge
interpolation.

Neunteufel & Schöberl, Comput. Struct. 225 (2019) 106109 and Comput. Methods Appl. Mech. Eng. 373
(2021) 113524: positions of order k, moments σ of order k - 1, rotations α of the edges as
multipliers; the energy is stationary.
"""

from __future__ import annotations

import json
import math

import ngsolve as ng
from contestants import Clock, words
from ngsolve.meshes import MakeStructuredSurfaceMesh
from shared_problems import CASES, mapped

# Words of the command line, and what they are without.
case = words({"shape": "strip", "n": 16, "order": 2, "increments": 4, "power": 1.0, "damping": 1.0})
shape = CASES[case["shape"]]
n = case["n"]
k = case["order"]
along, across = (n, max(n // 8, 1)) if case["shape"] == "strip" else (4 * n, n // 2)
ng.ngsglobals.msg_level = 0
# CPU times are compared on one thread.
ng.SetNumThreads(1)


def place(x, y, z):
    return tuple(float(c) for c in mapped(case["shape"], x, y))


mesh = MakeStructuredSurfaceMesh(
    quads=False,
    nx=along,
    ny=across,
    mapping=place,
)
# Positions, moments, and rotations of the edges.
U = ng.VectorH1(mesh, order=k, dirichlet_bbnd="left")
M = ng.HDivDivSurface(mesh, order=k - 1, discontinuous=True)
A = ng.NormalFacetSurface(
    mesh,
    order=k - 1,
    dirichlet_bbnd="left",
)
space = U * M * A
u, σ, α = space.TrialFunction()
σ = σ.Trace()
α = α.Trace()
n0 = ng.specialcf.normal(3)
τ = ng.specialcf.tangential(3)
# ν0 is normal to the edge in the surface; P projects to the surface.
ν0 = ng.Cross(n0, τ)
P = ng.Id(3) - ng.OuterProduct(n0, n0)
F = ng.Grad(u).Trace() + P
# Regge interpolation of the membrane strain prevents locking.
strain = ng.Interpolate(0.5 * (F.trans * F - P), ng.HCurlCurl(mesh, order=k - 1))
# Cof F n0 is the deformed normal, not yet a unit vector.
normal = (
    ng.Normalize(ng.Cof(F) * n0)
    if hasattr(ng, "Normalize")
    else 1 / ng.Norm(ng.Cof(F) * n0) * (ng.Cof(F) * n0)
)
Fτ = F * τ
tangent = 1 / ng.Norm(Fτ) * Fτ
conormal = ng.Cross(normal, tangent)

# normals of the edges, means of both sides at the last increment; the normal of the mesh at the
# clamp
solution = ng.GridFunction(space)
edge_space = ng.VectorFacetSurface(mesh, order=k)
edge_normal = ng.GridFunction(edge_space)
clamped = ng.GridFunction(ng.FacetSurface(mesh, order=0))
clamped.Set(1, definedon=mesh.BBoundaries("left"))
before = ng.Grad(solution.components[0]) + P
now = 1 / ng.Norm(ng.Cof(before) * n0) * (ng.Cof(before) * n0)
b, db = edge_space.TnT()
b = b.Trace()
db = db.Trace()
projection = ng.BilinearForm(edge_space)
sides = ng.LinearForm(edge_space)
projection += b * db * ng.ds(element_boundary=True)
sides += ((1 - clamped) * now + clamped * n0) * db * ng.ds(element_boundary=True)
projection.Assemble()
inverse = projection.mat.Inverse(edge_space.FreeDofs(), inverse="sparsecholesky")


def take_edge_normals() -> None:
    sides.Assemble()
    edge_normal.vec.data = inverse * sides.vec


edge = edge_normal - (tangent * edge_normal) * tangent
edge = 1 / ng.Norm(edge) * edge
share = ng.Parameter(0.0)
t = shape.thickness
form = ng.BilinearForm(space, symmetric=True, condense=True)
# Second derivatives of the displacement, along the deformed normal.
bent = (u.Operator("hesseboundary").trans * normal).Reshape((3, 3))
form += ng.Variation((0.5 * t * shape.E * ng.InnerProduct(strain, strain)).Compile() * ng.ds)
# Complementary energy of the moments: 12/(2 t³ E) for ν = 0.
form += ng.Variation(
    (ng.InnerProduct(σ, bent) - 6 / t**3 / shape.E * ng.InnerProduct(σ, σ)).Compile() * ng.ds
)
# The change of the angle between the normals on both sides of an edge.
form += ng.Variation(
    ((ng.acos(conormal * edge) - math.pi / 2 + α * ν0) * (σ * ν0) * ν0).Compile()
    * ng.ds(element_boundary=True)
)
# A dead load along the last edge.
form += ng.Variation(-share * shape.load * u[2] * ng.ds(definedon=mesh.BBoundaries("right")))

take_edge_normals()
clock = Clock()
iterations = 0
for increment in range(1, case["increments"] + 1):
    # The power makes the first increments small.
    share.Set((increment / case["increments"]) ** case["power"])
    take_edge_normals()
    failed, used = ng.solvers.Newton(
        form,
        solution,
        inverse="sparsecholesky",
        printing=False,
        maxerr=1e-8,
        maxit=40,
        dampfactor=case["damping"],
    )
    iterations += used
    if failed:
        raise SystemExit(
            f"Newton's iteration failed in increment {increment} of {case['increments']}"
        )
measured = clock.figures()
# Just inside of the mesh, where a point lies in an element.
corner = mesh(*place(1 - 1e-9, 1 - 1e-9, 0), ng.BND)
result = {
    **measured,
    "dofs": space.ndof,
    "steps": iterations,
    "W": float(solution.components[0](corner)[2]),
}
print(json.dumps(result | {"error [%]": 100 * abs(result["W"] / shape.deflection - 1)}))
