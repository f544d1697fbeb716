"""Messages about an unknown name list what may be given, and nothing that is refused next."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
import ufl
from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.meshes.sheet import EDGES, sheet
from gossamer_fx.records.fields.fields import check_fields
from tests.small_scenes import LINEAR, MATERIAL

COMM = MPI.COMM_SELF


@dataclass(frozen=True, kw_only=True)
class OwnLaw(gx.extend.FilmLaw):
    """A law that defines its energy, and nothing of which maps of wrinkles are made."""

    quadratic = True

    def energy(self, e: Any, c: Any) -> Any:
        return c.thickness * ufl.dot(e, e)


def test_fields_that_a_law_does_not_have_are_not_listed() -> None:
    own = gx.Membrane(sheet(COMM, 1, 1), OwnLaw(density=1.0e3, thickness=1e-4), name="own")
    usual = gx.Membrane(sheet(COMM, 1, 1), LINEAR)
    for film, has_maps in ((own, False), (usual, True)):
        with pytest.raises(gx.InputError, match="no field 'strss1'") as error:
            check_fields(film, ["strss1"])
        assert ("wrinkle_slope" in str(error.value)) == has_maps
    # Asked for, a map is refused with the reason.
    run = gx.Simulation(gx.Scene(own), gx.Midpoint(dt=0.1))
    with pytest.raises(gx.InputError, match="as its law is OwnLaw"):
        gx.fields.field_values(run, own, field="wrinkle_slope")


def test_a_picture_does_not_propose_to_record_what_no_run_records(tmp_path: Path) -> None:
    film = gx.Membrane(sheet(COMM, 1, 1), LINEAR)
    outputs = [gx.Recording(tmp_path, {"film": ["displacement", "direction"]})]
    gx.Simulation(gx.Scene(film), gx.Midpoint(dt=0.1), outputs=outputs).run(until=0.1)
    reader = gx.plot.RunReader(tmp_path)
    fields = "its fields are: displacement (and displacement_x for a component, with _x, _y, _z, "
    remedies = {
        "strss1": f"{fields}_normal); draw one of these",
        "direction": f"{fields}_normal); the direction of tension is not drawn",
        "stress1": "record it by gx.Recording",
    }
    for field, remedy in remedies.items():
        with pytest.raises(gx.InputError, match=f"no field '{field}'") as error:
            reader.check_field(field)
        assert remedy in str(error.value)
        assert ("gx.Recording" in str(error.value)) == (field == "stress1")


def test_properties_that_a_law_derives_are_not_proposed() -> None:
    law = gx.Elastica(**MATERIAL, half_wavelength=0.01)
    with pytest.raises(gx.InputError, match="no property 'colour' that may vary") as error:
        gx.Membrane(sheet(COMM, 1, 1), law, properties={"colour": {}})
    assert str(error.value).endswith("choose from density.")


def test_items_without_parameters_are_not_proposed() -> None:
    film = gx.Membrane(sheet(COMM, 2, 2), LINEAR, initial_stress=1e6, name="film")
    walls = [gx.Fixed(film, edge, name=f"{edge} wall") for edge in EDGES]
    scene = gx.Scene(film, *walls, gx.Pressure(film, 1.0, name="wind"))
    equilibrium = gx.Equilibrium(scene)
    equilibrium.find()
    point = gx.probes.Position(film.port_at((0.5, 0.5, 0.0)), "z")
    with pytest.raises(gx.InputError, match="has no item 'fim'") as error:
        gx.analysis.gradient(equilibrium, of=point, by=["fim.thickness"])
    assert str(error.value).endswith("its items with parameters are: film, wind.")
