"""Which parts of a scene go with which questions: ./gossamer python tools/features.py [--write].

Each part is put into a small scene of a square film, and each question is asked of it.  A cell of
the table is "yes" if there is an answer, or else it has the number of the sentence with which the
program refuses.  With --write the table and the sentences are put into docs/features.md.
"""

from __future__ import annotations

import logging
import re
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.analysis.cases.results import markdown_table
from gossamer_fx.meshes.airbag import airbag
from gossamer_fx.meshes.creased_strip import creased_strip
from gossamer_fx.meshes.sheet import crossed_sheet

PAGE = Path(__file__).resolve().parents[1] / "docs" / "features.md"
BETWEEN = re.compile(r"(?<=<!-- features -->\n).*?(?=<!-- /features -->)", re.DOTALL)
COMM = MPI.COMM_SELF
FILM = {"E": 1e9, "nu": 0.3, "density": 1400.0, "thickness": 1e-4}
EDGE = 0.2
FLOOR = gx.contact.Plane(point=(0.0, 0.0, -2e-3), normal=(0.0, 0.0, 1.0))

# A film replaced by its reduced model, or nothing.
Film = Any


@dataclass(frozen=True)
class Parts:
    """A scene of a film.

    Attributes:
        items: of the scene; the first one is the film.
        by: a parameter of the gradient.
    """

    items: list[Any]
    by: str = "film.thickness"


def held(body: Any) -> list[Any]:
    """Supports along two edges; none of a reduced film, which has no groups."""
    if type(body) not in (gx.Membrane, gx.Plate):
        return []
    return [gx.Fixed(body, edge) for edge in ("left", "right")]


def square(film: Film, law: Any = None, order: int = 1, **options: Any) -> Any:
    """A square film that is taut, or what replaces it."""
    law = law or gx.Miyazaki(**FILM)
    if film is not None:
        return film
    mesh = crossed_sheet(COMM, 3, 3, EDGE, EDGE)
    return gx.Membrane(mesh, law, order=order, initial_stress=1e6, name="film", **options)


def scene_of(
    law: Any = None, order: int = 1, by: str = "film.thickness", **options: Any
) -> Callable[[Film], Parts]:
    """A film under pressure, held along two edges."""

    def make(film: Film) -> Parts:
        body = square(film, law, order, **options)
        return Parts([body, *held(body), gx.Pressure(body, 100.0)], by)

    return make


def plate(film: Film) -> Parts:
    body = film
    if body is None:
        mesh = crossed_sheet(COMM, 3, 3, EDGE, EDGE)
        body = gx.Plate(mesh, gx.Linear(**{**FILM, "thickness": 1e-3}), name="film")
    return Parts([body, *held(body), gx.Pressure(body, 100.0)])


def with_item(
    make_item: Callable[[Any], Any], by: str = "film.thickness", **options: Any
) -> Callable[[Film], Parts]:
    """The film under pressure with another item on it."""

    def make(film: Film) -> Parts:
        parts = scene_of(**options)(film)
        return Parts([*parts.items, make_item(parts.items[0])], by)

    return make


def tape(body: Any) -> Any:
    law = gx.CableLaw(EA=6000.0, line_density=0.01)
    return gx.connectors.Tape.along_edges(body, law, edges="bottom", name="tape")


def floor(body: Any) -> Any:
    return gx.Contact(body, FLOOR, distance=1e-3, stiffness=1e3)


def rough_floor(body: Any) -> Any:
    return gx.Contact(body, FLOOR, distance=1e-3, stiffness=1e3, friction=0.3, slip_velocity=1e-3)


def creased(film: Film) -> Parts:
    body = film
    if body is None:
        mesh = creased_strip(COMM, 2, 2, 0.1, 0.1)
        body = gx.Membrane(mesh, gx.Miyazaki(**FILM), initial_stress=1e6, name="film")
    crease = gx.connectors.Crease(body, "crease", stiffness=1e-3)
    return Parts([body, *held(body), gx.Pressure(body, 100.0), crease])


def gas(film: Film) -> Parts:
    body = film
    if body is None:
        body = gx.Membrane(airbag(COMM, 0.2, 4), gx.Miyazaki(**FILM), name="film")
    air = gx.IdealGas(gamma=1.4, R=287.0)
    bag = gx.Chamber(
        body, gas=air, pressure=1000.0, temperature=293.0, dead_volume=1e-5, name="bag"
    )
    supports = [gx.Fixed(body, "seam")] if type(body) is gx.Membrane else []
    return Parts([body, bag, *supports])


ROWS: dict[str, Callable[[Film], Parts]] = {
    "film of order 1": scene_of(),
    "film of order 2": scene_of(order=2),
    "`Orthotropic` film": scene_of(
        gx.Orthotropic(
            E1=1e9,
            E2=5e8,
            nu12=0.3,
            G12=1e8,
            density=1400.0,
            thickness=1e-4,
            direction=(1.0, 0.0, 0.0),
        )
    ),
    "`NeoHooke` film": scene_of(gx.materials.NeoHooke(1e8, density=1400.0, thickness=1e-4)),
    "`Elastica` film": scene_of(
        gx.Elastica(**FILM, half_wavelength=0.02), by="film.initial_stress"
    ),
    "`Plate`": plate,
    "tape on the film": with_item(tape),
    "crease": creased,
    "gas in a chamber": gas,
    "contact": with_item(floor),
    "contact with friction": with_item(rough_floor),
    "film damping": with_item(lambda body: gx.Damping(body, stiffness_factor=1e-5)),
    "weight": with_item(lambda body: gx.Gravity(body, (0.0, 0.0, -9.81))),
}


def equilibrium_of(parts: Parts) -> gx.Equilibrium:
    """The equilibrium of a scene, found."""
    found = gx.Equilibrium(gx.Scene(*parts.items))
    found.find()
    return found


def height(parts: Parts) -> Any:
    """The height of the middle of the film."""
    return gx.analysis.EnclosedVolume(parts.items[0]) if _is_closed(parts) else gx.analysis.Energy()


def _is_closed(parts: Parts) -> bool:
    return any(isinstance(item, gx.Chamber) for item in parts.items)


def equilibrium(make: Callable[[Film], Parts]) -> None:
    equilibrium_of(make(None))


def modes(make: Callable[[Film], Parts]) -> None:
    gx.analysis.modes(equilibrium_of(make(None)), count=1)


def static_gradient(make: Callable[[Film], Parts]) -> None:
    parts = make(None)
    gx.analysis.gradient(equilibrium_of(parts), of=height(parts), by=[parts.by])


def run_of(parts: Parts, outputs: Any = ()) -> gx.Simulation:
    """A run of two steps."""
    run = gx.Simulation(gx.Scene(*parts.items), gx.Midpoint(dt=1e-4), outputs=outputs)
    run.run(until=2e-4)
    return run


def run(make: Callable[[Film], Parts]) -> None:
    run_of(make(None))


def gradient_of_a_run(make: Callable[[Film], Parts]) -> None:
    parts = make(None)
    start = gx.Simulation(gx.Scene(*parts.items), gx.Midpoint(dt=1e-4))
    tape = gx.analysis.RunTape(start)
    start.run(until=2e-4)
    gx.analysis.gradient(tape, of=height(parts), by=[parts.by])


def reduced_model(make: Callable[[Film], Parts]) -> None:
    parts = without_supports(make(None))
    shapes: Any = gx.reduction.Snapshots(parts.items[0])
    run_of(parts, [shapes])
    reduced = gx.reduction.reduce(parts.items[0], [shapes], modes=2)
    run_of(without_supports(make(reduced)))


def without_supports(parts: Parts) -> Parts:
    """The scene of a free film: a reduced film is tied by ports, and has no supports."""
    items = [item for item in parts.items if not isinstance(item, gx.Fixed)]
    return Parts(items, parts.by)


def path(make: Callable[[Film], Parts]) -> None:
    gx.analysis.path(equilibrium_of(make(None)), until=1.05, first_step=0.05, max_steps=3)


COLUMNS: dict[str, Callable[[Callable[[Film], Parts]], None]] = {
    "equilibrium": equilibrium,
    "path": path,
    "modes": modes,
    "gradient of an equilibrium": static_gradient,
    "run": run,
    "gradient of a run": gradient_of_a_run,
    "reduced model": reduced_model,
}


def table() -> tuple[list[list[str]], list[str]]:
    """Cells of the table, first the headings; and the sentences of refusals, by number from 1."""
    logging.getLogger("gossamer_fx").setLevel(logging.ERROR)
    sentences: list[str] = []
    rows = [["part of the scene", *COLUMNS]]
    for name, make in ROWS.items():
        cells = [name]
        for ask in COLUMNS.values():
            try:
                ask(make)
                cells.append("yes")
            except (gx.InputError, gx.NoEquilibrium, gx.StepFailure) as refusal:
                text = str(refusal)
                if text not in sentences:
                    sentences.append(text)
                cells.append(f"no ({sentences.index(text) + 1})")
        rows.append(cells)
    return rows, sentences


def words() -> str:
    """The table and the sentences as the page shows them."""
    rows, sentences = table()
    listed = "\n".join(f"{k}. {text}" for k, text in enumerate(sentences, start=1))
    return f"\n{markdown_table(rows)}\nThe program refuses with these sentences:\n\n{listed}\n\n"


def main(arguments: list[str]) -> int:
    found = words()
    print(found)
    if "--write" in arguments:
        old = PAGE.read_text(encoding="utf-8")
        PAGE.write_text(BETWEEN.sub(lambda _: found, old), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
