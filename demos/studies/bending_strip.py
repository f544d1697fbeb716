"""In-plane bending of a tensioned film that wrinkles on its compression side (Stein & Hedgepeth,
NASA TN D-813, 1961).

A film of height H under the axial force P and the transverse dead load σ0 = P/(Ht) on its long
edges; its ends stay straight and are turned by ±κL/2.  With K = E t H² κ/(2P),

    K ≤ 1    2M/(PH) = K/3              b = 0
    K ≥ 1    2M/(PH) = 1 - ⅔ K^(-½)     b/H = 1 - K^(-½)      wrinkled below y = b

The ends get the displacement of that solution, ε = κ (y - b) - ν σ0/E; P and M, about
the centre of the end as it has moved, are reactions; m = 2M/(PH) is compared with the solution for
the K of that P: turned by 1e-3, dead loads have couples that are not negligible compared with the
moment of a strain of 1e-4.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from mpi4py import MPI

import gossamer_fx as gx
from demos.studies.airbag import displacement
from demos.studies.engine.study import Measure, Study, search_figures
from gossamer_fx.extend import AreaFractions, FilmLaw
from gossamer_fx.meshes.sheet import sheet

# Height, length and thickness [m]; modulus [Pa]; tension σ0 [Pa], a strain of 1e-4.
H = 1.0
L = 1.5
THICKNESS = 2e-5
E = 2.3e9
NU = 0.3
TENSION = 0.23e6
# Axial force [N].
P = TENSION * H * THICKNESS
FILM = {"E": E, "nu": NU, "density": 1400.0, "thickness": THICKNESS}
LAWS: dict[str, FilmLaw] = {
    "Miyazaki 1e-6": gx.Miyazaki(**FILM, residual_stiffness=1e-6),
    "Miyazaki 1e-4": gx.Miyazaki(**FILM, residual_stiffness=1e-4),
    "Elastica 0.05 m": gx.Elastica(**FILM, half_wavelength=0.05),
    "TensionField": gx.TensionField(**FILM),
}


def exact(K: float) -> tuple[float, float]:
    """(2M/(PH), b/H)."""
    if K <= 1:
        return K / 3, 0.0
    return 1 - 2 / 3 / K**0.5, 1 - K**-0.5


def supported(
    film: gx.Membrane,
    motion: Callable[[np.ndarray, float], np.ndarray],
    tension: float,
    is_plane: bool = True,
) -> tuple[gx.Fixed, gx.Scene]:
    """What moves the right end of a strip, and the strip with its supports and loads.

    Args:
        film: with the groups of `sheet`.
        motion: displacement (3, n) [m] of both ends, which stay straight.
        tension: σ0 [Pa] on the long edges.
        is_plane: whether the strip is held in its plane, everywhere; else at its ends only.
    """
    # A film that is held in its plane has its heights from there.
    held = (0,) if is_plane else (0, 2)
    moved = gx.Fixed(film, "right", motion=motion, components=held)
    pull = tension * film.law.thickness
    items: list[object] = [
        film,
        moved,
        gx.Fixed(film, "left", motion=motion, components=held),
        gx.Fixed(film, "bottom left", components=(1,)),
        gx.loads.EdgeLoad(film, "top", force=(0.0, pull, 0.0)),
        gx.loads.EdgeLoad(film, "bottom", force=(0.0, -pull, 0.0)),
    ]
    if is_plane:
        items.append(gx.Fixed(film, "film", components=(2,)))
    return moved, gx.Scene(*items)  # type: ignore[arg-type]


def bent_strip(
    comm: MPI.Comm, law: FilmLaw, order: int, K: float, cells: int
) -> tuple[gx.Fixed, gx.Equilibrium]:
    """The film with `cells` edges over its height, and what moves its right end."""
    κ = 2 * P * K / (E * THICKNESS * H**2)
    _, wrinkled_share = exact(K)
    b = wrinkled_share * H

    def turn(X: np.ndarray, t: float) -> np.ndarray:
        """Displacement (3, n) of an end; the ends are moved to both sides of the middle."""
        uniaxial = TENSION / E + κ * (X[1] - H / 2)
        # With wrinkles the film below y = b carries no stress along x.
        if K > 1:
            uniaxial = κ * (X[1] - b)
        ε = uniaxial - NU * TENSION / E
        return np.vstack([ε * (X[0] - L / 2), 0 * ε, 0 * ε])

    # Square cells.
    mesh = sheet(comm, round(L / H * cells), cells, L, H, crossed=True)
    moved, scene = supported(gx.Membrane(mesh, law, order=order), turn, TENSION)
    return moved, gx.Equilibrium(scene)


def problem(comm: MPI.Comm, law: str, element: str, K: float, nodes: int) -> dict[str, float]:
    """`nodes` over the height."""
    order = {"P1": 1, "P2": 2}[element]
    moved, search = bent_strip(comm, LAWS[law], order, K, nodes // order)
    found = search.find()
    lower = displacement(moved.body, search, "bottom right")
    upper = displacement(moved.body, search, "top right")
    # The centre of the end as it has moved; dead loads have a moment about the old one.
    height = H / 2 + float((lower + upper)[1]) / 2
    force, moment = search.reaction(moved, about=(L, height, 0.0))
    m_exact, _ = exact(K * P / force[0])
    _, b_exact = exact(K)
    slack, wrinkled, _ = AreaFractions([moved.body])(search.system)
    m = -2 * moment[2] / (force[0] * H)
    return {
        "m": m,
        "m/exact": m / m_exact,
        "P/P0": force[0] / P,
        "b/H": slack + wrinkled,
        "b/H error": abs(slack + wrinkled - b_exact),
        **search_figures(found),
        "compile_seconds": search.compile_seconds,
    }


STUDY = Study(
    "bending_strip",
    "Bending of a tensioned film",
    problem,
    {"law": list(LAWS), "element": ["P1", "P2"], "K": [0.5, 1.5, 2.0, 6.0], "nodes": [12, 24, 48]},
    lambda case: H / case["nodes"],
    (
        Measure(
            "m/exact",
            1.0,
            1e-2,
            lambda case: 1.0 if case["element"] == "P1" else math.inf,
            quick_tolerance=2e-2,
        ),
    ),
    quick={"law": ["Miyazaki 1e-6"], "K": [2.0], "nodes": [6, 12]},
    columns="m, P/P0, b/H, b/H error, iterations, seconds",
)
