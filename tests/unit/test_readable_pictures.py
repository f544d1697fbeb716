"""What users see in pictures: rare colours, names of curves, ropes and tapes, letters on a
phone."""

from __future__ import annotations

import re
from base64 import b64decode
from functools import partial
from io import BytesIO
from itertools import pairwise
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
import pytest
from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.meshes.sheet import EDGES, sheet
from gossamer_fx.records.plot import page
from gossamer_fx.records.plot import plot as pictures
from gossamer_fx.records.plot.colours import STATE_COLOURS, by_state
from gossamer_fx.records.plot.curve_panels import _area_shares, label_ends, run_curves, wrapped
from gossamer_fx.records.plot.viewer import RunView
from tests.small_scenes import WRINKLING

COMM = MPI.COMM_SELF
DT = 1e-3


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> gx.plot.RunReader:
    """A film that falls on a tape, a rope and a spring."""
    film = gx.Membrane(sheet(COMM, 4, 4), WRINKLING, name="film")
    hook = gx.Ground((1.5, 1.5, 0.0))
    tape = gx.connectors.Tape.along_edges(film, gx.CableLaw(1e3, 0.01), edges="left")
    rope = gx.connectors.Rope(film.port("top right"), hook, stiffness=1e3, length=1.0)
    spring = gx.connectors.Spring(film.port("bottom right"), hook, stiffness=10.0, length=1.6)
    fall = gx.Gravity(film, (0.0, 0.0, -9.81))
    folder = tmp_path_factory.mktemp("falls") / "run"
    recording = gx.Recording(folder, every=2, title="A film on ropes")
    scene = gx.Scene(film, tape, rope, spring, fall)
    gx.Simulation(scene, gx.Midpoint(dt=DT), outputs=[recording]).run(until=6 * DT)
    return gx.plot.RunReader(folder)


# ---- ropes, springs and tapes --------------------------------------------------------------------


def test_ropes_springs_and_tapes_are_drawn(recorded: gx.plot.RunReader) -> None:
    """Four bars of the tape, the rope and the spring, at their positions in each state."""
    for frame in range(len(recorded.times)):
        shape = recorded.shape(frame, "state", lambda values: np.zeros(len(values), dtype=int))
        assert shape.lines.shape == (6, 2, 3)
        tape = shape.lines[:4]
        assert tape[:, :, 0] == pytest.approx(0.0, abs=1e-3)
        # Of a falling film the tape's points are those of its mesh.
        segment, step = recorded.bodies["film"].at(frame)
        points = segment.positions(step)
        for point in tape.reshape(-1, 3):
            assert np.linalg.norm(points - point, axis=1).min() == pytest.approx(0.0, abs=1e-12)
        assert shape.lines[4:, 1] == pytest.approx(np.array([[1.5, 1.5, 0.0]] * 2))
    [parts] = RunView(recorded).whole()["header"]["meshes"]
    ends = [
        np.frombuffer(b64decode(part["pieces"]), dtype="<u4")
        for part in parts
        if part["corners"] == 2
    ]
    assert sum(len(pieces) for pieces in ends) == 2 * 6
    for part, pieces in zip(parts[1:], ends, strict=True):
        assert pieces.max() < len(b64decode(part["start"])) // 12


def test_a_scene_without_them_writes_no_table(tmp_path: Path) -> None:
    film = gx.Membrane(sheet(COMM, 2, 2), WRINKLING)
    recording = gx.Recording(tmp_path / "run")
    gx.Simulation(gx.Scene(film), gx.Midpoint(dt=DT), outputs=[recording]).run(until=DT)
    assert not (tmp_path / "run" / "lines.csv").exists()


# ---- colours -------------------------------------------------------------------------------------


def test_a_gif_keeps_the_colour_of_a_few_cells_in_one_frame(tmp_path: Path) -> None:
    """As of film that is slack for a moment: blue in one frame of sixty, among shades of grey and
    orange."""
    from PIL import Image

    height = 80
    width = 120
    shade = np.linspace(0.5, 1.0, width)[None, :, None]
    frames = []
    for number in range(60):
        grey = np.asarray(STATE_COLOURS[2])
        orange = np.asarray(STATE_COLOURS[1])
        image = np.where(np.arange(height)[:, None, None] < 40 + number % 7, grey, orange) * shade
        frames.append(np.rint(255 * image).astype(np.uint8))
    blue = np.rint(255 * np.asarray(STATE_COLOURS[0])).astype(np.uint8)
    frames[31][10:14, 20:24] = blue
    pictures._write_gif(tmp_path / "a.gif", frames, pause=0.05)
    with Image.open(tmp_path / "a.gif") as image:
        image.seek(31)
        shown = np.asarray(image.convert("RGB"))[12, 22].astype(int)
    assert abs(shown - blue).max() <= 8


def test_the_view_shows_numbers_smoothly_and_states_by_triangle(
    recorded: gx.plot.RunReader,
) -> None:
    data = RunView(recorded).whole()
    film = data["header"]["meshes"][0][0]
    triangles = len(b64decode(film["pieces"])) // 12
    vertices = len(b64decode(film["start"])) // 12
    smooth = {legend["name"]: legend["smooth"] for legend in data["legends"]}
    assert smooth["Displacement"] and not smooth["State of the film"]
    number = data["header"]["fields"].index("Displacement")
    for state in data["states"][1:]:
        assert len(b64decode(state["values"][number][0]["data"])) == 2 * vertices
        assert len(b64decode(state["values"][0][0]["data"])) == 2 * triangles


# ---- names of curves -----------------------------------------------------------------------------


def test_long_names_keep_what_tells_them_apart() -> None:
    one = wrapped("damping of the large film of the left wing (mass)", 18, 2)
    other = wrapped("damping of the large film of the left wing (stiffness)", 18, 2)
    assert one != other and one.endswith("(mass)") and other.endswith("(stiffness)")
    for text in (one, other):
        assert len(text.splitlines()) <= 2
        assert all(len(line) <= 18 for line in text.splitlines())
    assert wrapped("kinetic", 18, 2) == "kinetic"


def boxes_of_labels(names: list[str]) -> list:
    """Boxes of the labels of curves that end at the same value, in pixels; and that of the page."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(4.0, 2.9), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots()
    axes.plot([0, 1], [0, 1])
    label_ends(axes, [(name, 0.9, "black") for name in names])
    figure.draw_without_rendering()
    return [text.get_window_extent() for text in axes.texts], figure.bbox


@pytest.mark.parametrize(
    "names",
    [
        [f"in {part} of the left wing" for part in ("film", "hem", "tape", "boom")],
        [f"chamber {number}" for number in range(7)],
        [f"chamber {number} of the folded tube" for number in range(7)],
    ],
)
def test_labels_neither_overlap_nor_leave_the_page(names: list[str]) -> None:
    boxes, page = boxes_of_labels(names)
    boxes.sort(key=lambda box: box.y0)
    for lower, upper in pairwise(boxes):
        assert lower.y1 <= upper.y0 + 1.0
    for box in boxes:
        assert page.x0 <= box.x0 and box.x1 <= page.x1


@pytest.mark.parametrize("largest", [0.5401, -248.6])
def test_the_end_of_a_bar_does_not_touch_what_follows(largest: float) -> None:
    """On a page of one picture, which is narrower than others."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    from gossamer_fx.records.plot.colours import Colouring, Scale

    low, high = sorted((0.0, abs(largest))) if largest > 0 else (largest, -largest)
    scale = Scale("Slope", "", low, high, low, high)
    colours = Colouring("slope", np.zeros((4, 3)), scale=scale, has_slack=True)
    width = 7.0
    figure = Figure(figsize=(width, 0.45), dpi=100)
    FigureCanvasAgg(figure)
    header = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    page._draw_key(header, colours, width)
    figure.draw_without_rendering()
    [bar] = header.child_axes
    last = bar.get_xticklabels()[-1].get_window_extent()
    swatches = header.get_legend()
    assert swatches is not None
    assert last.x1 < swatches.get_window_extent().x0
    assert last.x1 < header.texts[0].get_window_extent().x0


def test_a_film_in_space_is_not_cut() -> None:
    """The box of its axes, seen from its side, is narrower than the film."""
    from matplotlib.figure import Figure

    from demos.common.figures import draw_film

    axes = Figure().add_subplot(projection="3d")
    draw_film(axes, np.eye(3)[None])
    assert not axes.collections[0].get_clip_on()


def test_a_curve_that_ends_at_zero_has_its_name(tmp_path: Path) -> None:
    """As the energy of a contact that has opened, on a logarithmic axis."""
    from matplotlib.figure import Figure

    from gossamer_fx.records.plot.curve_panels import LINES, _lines

    t = np.linspace(0, 1, 50)
    contact = np.where(t < 0.5, 1e-4 * t, 0.0)
    curves = {"kinetic": 1.0 + t, "in contact": contact}
    axes = Figure().subplots()
    _lines(t, curves, dict(zip(curves, LINES, strict=False)), "Energy", "J", axes)
    assert axes.get_yscale() == "log"
    assert {text.get_text() for text in axes.texts} == {"kinetic", "in contact"}


@pytest.mark.parametrize("count", [1, 4, 6])
def test_captions_of_images_side_by_side_do_not_meet(count: int) -> None:
    """As those of pictures that are enlarged, of a scene that is high and narrow."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    captions = [f"equilibrium of t = 0.{k}234 s, {k}.9 times larger" for k in range(count)]
    views = page.Views(captions, size=(0.2, 2.0), draw=lambda scale: [], colours=by_state(False))
    rows, columns = page._arrange(views, page.WIDTH)
    height = page._caption_height(views, columns, page.WIDTH)
    height += page._image_height(views, rows, columns, page.WIDTH)
    figure = Figure(figsize=(page.WIDTH, rows * height), layout="constrained")
    FigureCanvasAgg(figure)
    part = figure.subfigures(1, 1)
    with matplotlib.rc_context(page._STYLE):
        frames = page._frames(part, views, rows, columns, page.WIDTH)
        figure.draw_without_rendering()
        boxes = [axes._left_title.get_window_extent() for axes in frames]
    assert len(boxes) == count
    for left, right in pairwise(boxes):
        assert left.x1 < right.x0 or left.y0 > right.y1
    for box in boxes:
        assert box.x1 <= figure.bbox.x1 and box.y1 <= figure.bbox.y1


# ---- the report ----------------------------------------------------------------------------------


def test_a_report_has_pictures_and_tables_that_scroll(
    recorded: gx.plot.RunReader, tmp_path: Path
) -> None:
    from PIL import Image

    gx.write_report(recorded, tmp_path / "report.html")
    text = (tmp_path / "report.html").read_text()
    pictures_of_page = re.findall(r'<img [^>]*src="data:[^,]*,([^"]*)">', text)
    assert len(pictures_of_page) == 1
    for data in pictures_of_page:
        with Image.open(BytesIO(b64decode(data))) as image:
            assert image.width == page.WIDTH * page.DPI
    assert text.count('<div class="table">') == text.count("<table>")
    assert run_curves(recorded).panels


def test_curves_of_many_parts_leave_none_of_them_out(tmp_path: Path) -> None:
    """Twelve springs and twelve weights: seven colours show the extent of all, and all energy."""
    parts: list[Any] = []
    probes: dict[str, Any] = {}
    for k in range(1, 13):
        weight = gx.PointMass(1.0, position=(k, 0.0, 0.0), comm=MPI.COMM_SELF, name=f"weight {k}")
        spring = gx.connectors.Spring(
            weight.port(), gx.Ground((k, 1.0, 0.0)), stiffness=10.0 * k, length=0.5, name=f"tie {k}"
        )
        parts += [weight, spring]
        probes[f"force {k} [N]"] = gx.probes.Tension(spring)
    outputs = [gx.Recording(tmp_path, probes=probes, every=1)]
    gx.Simulation(gx.Scene(*parts), gx.Midpoint(dt=0.01), outputs=outputs).run(until=0.05)
    reader = gx.plot.RunReader(tmp_path)
    panels: dict[str, Any] = {}
    for panel in run_curves(reader).panels:
        assert isinstance(panel, partial)
        # The first words are the title, the first dictionary the curves.
        curves = [one for one in panel.args if isinstance(one, dict)]
        for title in [one for one in panel.args if isinstance(one, str)][:1]:
            panels[title] = curves[0]
    # At the start the tension of spring k is 5 k.
    for title in ("Tension", "force [N]"):
        ends = {name: values[0] for name, values in panels[title].items()}
        assert ends == pytest.approx({"largest of 12": 60, "mean of 12": 32.5, "least of 12": 5})
    energies = panels["Energy"]
    assert len(energies) == 7 and "in 9 others" in energies
    shown = sum(values for name, values in energies.items() if name.startswith("in "))
    stored = sum(v for name, v in reader.table("ledger.csv").items() if name.startswith("stored "))
    assert shown == pytest.approx(stored, rel=1e-12)


def test_the_panel_of_states_counts_all_films_by_their_area(tmp_path: Path) -> None:
    """A slack film of 1 m² and a taut one of 3 m²: three quarters of the area are taut."""
    law = gx.Miyazaki(1e9, 0.3, density=1400.0, thickness=1e-5, residual_stiffness=1e-3)
    films = [
        gx.Membrane(
            sheet(MPI.COMM_SELF, 2, 2, width=width),
            law,
            displacement=lambda X, stretch=stretch: stretch * X,
            name=name,
        )
        for name, width, stretch in (("slack", 1.0, -1e-3), ("taut", 3.0, 1e-3))
    ]
    held = [gx.Fixed(film, edge) for film in films for edge in EDGES]
    scene = gx.Scene(*films, *held)
    run = gx.Simulation(scene, gx.Midpoint(dt=1e-6), outputs=[gx.Recording(tmp_path / "run")])
    run.run(until=3e-6)
    reader = gx.plot.RunReader(tmp_path / "run")
    shares = _area_shares(reader, reader.table("states.csv"))
    assert shares["taut"] == pytest.approx(0.75)
    assert shares["slack"] == pytest.approx(0.25)


# ---- what is cut or left out --------------------------------------------------------------------


def test_a_long_title_is_broken_into_lines() -> None:
    """No line is wider than the page, and no word is lost."""
    title = "A sail of four quadrants with booms that roll out, " * 4
    for width in (page.WIDTH, 5.0):
        drawn: list[Any] = []

        def keep(figure: Any, *args: Any, kept: list[Any] = drawn, **options: Any) -> None:
            """Measure the title of a page."""
            [text] = [one for one in figure.texts if one.get_text()]
            kept.append((text.get_text(), text.get_window_extent().width / figure.dpi))

        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(matplotlib.figure.Figure, "savefig", keep)
            patch.setattr(page, "replace_file", lambda *args: None)
            page.write_page(
                Path("none.png"), title, None, page.Curves([lambda axes: None]), width=width
            )
        words, inches = drawn[0]
        assert words.split() == title.split() and inches <= width


def test_a_scene_that_travels_far_says_where_it_is(tmp_path: Path) -> None:
    """The altitude of what rises: the camera follows it."""
    film = gx.Membrane(sheet(COMM, 2, 2, 0.1, 0.1), WRINKLING, name="film")
    lift = gx.RigidMotion(velocity=(0.0, 0.0, 20.0))
    recording = gx.Recording(tmp_path, every=1)
    run = gx.Simulation(gx.Scene(film, lift), gx.Midpoint(dt=0.1), outputs=[recording])
    run.run(until=0.4)
    reader = gx.plot.RunReader(tmp_path)
    views = pictures.strip_views(reader, "state", 3, gx.plot.View())
    assert [one.replace("\u00a0", " ") for one in views.captions] == [
        "t = 0 ms, z = 0 m",
        "t = 200 ms, z = 4 m",
        "t = 400 ms, z = 8 m",
    ]
