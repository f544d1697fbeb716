"""The smooth maximum of a stress: its value and its derivatives."""

from __future__ import annotations

import numpy as np
import pytest

import gossamer_fx as gx
from gossamer_fx.meshes.sheet import crossed_sheet
from tests.small_scenes import WRINKLING, at_rest
from tests.statics.test_gradients import CHANGES, check_against_differences


def pulled(comm, order=1, law=WRINKLING):
    """A film that is pulled and sheared along one edge, with a pressure on it."""

    def motion(X):
        return np.vstack([1e-3 * X[0], 5e-4 * X[0] + 4e-4 * X[1], 0 * X[0]])

    film = gx.Membrane(
        crossed_sheet(comm, 4, 4), law, order=order, displacement=motion, name="film"
    )
    edges = [gx.Fixed(film, edge) for edge in ("left", "right", "bottom", "top")]
    load = gx.Pressure(film, 200.0, name="load")
    search = gx.analysis.Continuation(tolerance=1e-12)
    return film, at_rest(*edges, load, search=search)


def test_it_is_below_the_largest_stress_and_near_it(comm):
    film, equilibrium = pulled(comm)
    largest = gx.analysis.largest_stress(equilibrium, film).stress
    before = 0.0
    for exponent in (2.0, 8.0, 20.0, 60.0):
        smooth = gx.analysis.SmoothStress(film, exponent=exponent)(equilibrium)
        assert before < smooth < largest
        before = smooth
    assert before == pytest.approx(largest, rel=0.05)
    ratio = gx.analysis.SmoothStress(film, limit=69e6)
    assert ratio(equilibrium) == pytest.approx(gx.analysis.SmoothStress(film)(equilibrium) / 69e6)


@pytest.mark.mpi(2)
@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("measure", ["principal", "von Mises"])
def test_derivatives_agree_with_differences(comm, measure, order):
    film, equilibrium = pulled(comm, order)
    smooth = gx.analysis.SmoothStress(film, measure=measure, limit=1e6)
    names = ["film.E", "film.thickness", "load.pressure", "film.shape"]
    check_against_differences(equilibrium, names, [smooth], CHANGES, agreement=1e-5)


def test_slack_film_has_no_maximum(comm):
    film = gx.Membrane(crossed_sheet(comm, 2, 2), WRINKLING, displacement=lambda X: -1e-3 * X)
    still = gx.Equilibrium(gx.Scene(film))
    with pytest.raises(gx.InputError, match="has no tension, so that there is no maximum"):
        gx.analysis.SmoothStress(film)(still)
