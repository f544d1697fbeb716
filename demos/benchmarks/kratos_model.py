"""A membrane of triangles in Kratos Multiphysics: model part, film, solver."""

from __future__ import annotations

import math

import KratosMultiphysics as K
import KratosMultiphysics.ConstitutiveLawsApplication as Laws
import KratosMultiphysics.StructuralMechanicsApplication as Structures
import numpy as np
from KratosMultiphysics import python_linear_solver_factory

# Neither output nor threads may disturb the measurement.
K.Logger.GetDefaultOutput().SetSeverity(K.Logger.Severity.WARNING)
K.ParallelUtilities.SetNumThreads(1)

# What the elements, loads and time schemes of these scripts read or write.
VARIABLES = (
    *(K.DISPLACEMENT, K.REACTION, K.VELOCITY, K.ACCELERATION, K.VOLUME_ACCELERATION),
    *(
        K.POSITIVE_FACE_PRESSURE,
        K.NEGATIVE_FACE_PRESSURE,
        Structures.SURFACE_LOAD,
        Structures.POINT_LOAD,
    ),
)


def model_part(model, nodes: np.ndarray, more: tuple = ()):
    """A model part with the nodes (n, 3), whose unknowns are displacements."""
    part = model.CreateModelPart("film")
    # Two instants: the present and the previous one.
    part.SetBufferSize(2)
    part.ProcessInfo[K.DOMAIN_SIZE] = 3
    for variable in (*VARIABLES, *more):
        part.AddNodalSolutionStepVariable(variable)
    # Kratos counts from 1.
    for number, position in enumerate(nodes, start=1):
        part.CreateNewNode(number, *position)
    return part


def add_film(
    part,
    triangles: np.ndarray,
    E: float,
    nu: float,
    density: float,
    thickness: float,
    wrinkling: bool,
):
    """Membrane elements of an isotropic film; returns their properties."""
    constants = {
        K.YOUNG_MODULUS: E,
        K.POISSON_RATIO: nu,
        K.DENSITY: density,
        K.THICKNESS: thickness,
    }
    elastic = Structures.LinearElasticPlaneStress2DLaw()
    return _add_membranes(part, triangles, constants, elastic, wrinkling)


def add_fabric(
    part,
    triangles: np.ndarray,
    moduli: dict[str, float],
    density: float,
    thickness: float,
    angle: float,
):
    """Membrane elements of a wrinkling fabric; returns their properties.

    Args:
        moduli: E1, E2, nu12 and G12.
        angle: of the first axis from x [rad].
    """
    # Moduli and Poisson's ratios of three axes; the law of plane stress reads the first two and
    # nu12.
    nu = moduli["nu12"]
    elastic_constants = K.Vector(6, nu)
    for i, name in enumerate(("E1", "E2", "E2")):
        elastic_constants[i] = moduli[name]
    constants = {
        Laws.ORTHOTROPIC_ELASTIC_CONSTANTS: elastic_constants,
        K.YOUNG_MODULUS_X: moduli["E1"],
        K.YOUNG_MODULUS_Y: moduli["E2"],
        K.POISSON_RATIO_XY: nu,
        K.SHEAR_MODULUS_XY: moduli["G12"],
        K.DENSITY: density,
        K.THICKNESS: thickness,
    }
    law = Laws.LinearElasticOrthotropic2DLaw()
    film = _add_membranes(part, triangles, constants, law, wrinkling=True)
    axis = K.Vector(3, 0.0)
    axis[0] = math.cos(angle)
    axis[1] = math.sin(angle)
    for element in part.Elements:
        element.SetValue(Structures.LOCAL_MATERIAL_AXIS_1, axis)
    return film


def _add_membranes(part, triangles: np.ndarray, constants: dict, elastic, wrinkling: bool):
    """Membrane elements of an elastic law; returns their properties."""
    film = part.CreateNewProperties(1)
    for name, value in constants.items():
        film.SetValue(name, value)
    # Without prestress the element needs a vector of zeros.
    film.SetValue(Structures.PRESTRESS_VECTOR, K.Vector(3, 0.0))
    # The wrinkling law changes the stress of the elastic law that lies below it.
    if wrinkling:
        below = part.CreateNewProperties(2)
        for name, value in constants.items():
            below.SetValue(name, value)
        below.SetValue(K.CONSTITUTIVE_LAW, elastic)
        film.SetValue(K.CONSTITUTIVE_LAW, Laws.WrinklingLinear2DLaw())
        film.AddSubProperties(below)
    else:
        film.SetValue(K.CONSTITUTIVE_LAW, elastic)
    for number, corners in enumerate(triangles.tolist(), start=1):
        part.CreateNewElement("MembraneElement3D3N", number, [c + 1 for c in corners], film)
    # Unknown and reaction of each component.
    for axis in "XYZ":
        names = (getattr(K, f"{what}_{axis}") for what in ("DISPLACEMENT", "REACTION"))
        K.VariableUtils().AddDof(*names, part)
    return film


def linear_solver(name: str):
    """`sparse_lu`, or `amgcl`: conjugate gradients with smoothed aggregation."""
    # Algebraic multigrid with GMRES, since contact of states makes the matrix ill-conditioned.
    settings = {
        "sparse_lu": '{"solver_type": "LinearSolversApplication.sparse_lu"}',
        "amgcl": """{"solver_type": "amgcl", "krylov_type": "gmres", "smoother_type": "ilu0",
                     "tolerance": 1e-6, "coarsening_type": "smoothed_aggregation",
                     "max_iteration": 500, "verbosity": 0,
                     "use_block_matrices_if_possible": true}""",
    }
    return python_linear_solver_factory.ConstructSolver(K.Parameters(settings[name]))


def newton_strategy(part, scheme, absolute: float, solver: str, iterations: int):
    """Full Newton iterations of a time or load step, to 1e-6 of its first residual or to an
    absolute one, with at most so many iterations and a solver of `linear_solver`."""
    criterion = K.ResidualCriteria(1e-6, absolute)
    criterion.SetEchoLevel(0)
    builder = K.ResidualBasedBlockBuilderAndSolver(linear_solver(solver))
    # Neither reactions nor a new set of unknowns in each step; the mesh moves.
    strategy = K.ResidualBasedNewtonRaphsonStrategy(
        part, scheme, criterion, builder, iterations, False, False, True
    )
    strategy.SetEchoLevel(0)
    strategy.Initialize()
    strategy.Check()
    return strategy


def nodal(part, variable) -> np.ndarray:
    """Values (n, 3) of a nodal vector."""
    return np.array(
        K.VariableUtils().GetSolutionStepValuesVector(part.Nodes, variable, 0, 3)
    ).reshape(-1, 3)


def positions(part) -> np.ndarray:
    """Present positions (n, 3) of the nodes [m]."""
    rest = np.array(K.VariableUtils().GetInitialPositionsVector(part.Nodes, 3)).reshape(-1, 3)
    return rest + nodal(part, K.DISPLACEMENT)


def grid(n: int, edge: float) -> tuple[np.ndarray, np.ndarray]:
    """Nodes (m, 3) and cells' corners (n², 4), counter-clockwise, of a square from the origin."""
    s = np.linspace(0, edge, n + 1)
    x, y = np.meshgrid(s, s)
    # Number of the first corner of each cell.
    first = (np.arange(n)[:, None] * (n + 1) + np.arange(n)).ravel()
    return np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)]), first[:, None] + [
        0,
        1,
        n + 2,
        n + 1,
    ]
