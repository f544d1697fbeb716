"""Recordings from other users: every key of run.json is checked, and no name is executed as part of
a page."""

from __future__ import annotations

import copy
import json
import re
import shutil
from base64 import b64encode
from collections.abc import Iterator
from hashlib import sha256
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pytest
from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.meshes.line import line
from gossamer_fx.meshes.tube import flat_tube
from gossamer_fx.records.fields.fields import FIELDS
from gossamer_fx.records.outputs.run_file import read_run_file
from gossamer_fx.records.plot import report
from tests.small_scenes import WRINKLING

ALONE = MPI.COMM_SELF
ATTACKS = [
    "</script><script>alert(1)</script>",
    "<!--<script> ]]><img src=x onerror=alert(1)>",
    "\" onload='alert(1)' x=\" &lt;script&gt; &amp; a\u2028b\u2029c",
    r"$\frac{1}{$ 100 % \u003c {{7*7}} ${alert(1)} `x` javascript:alert(1)",
    "\x07\ud800",
]


def record(folder: Path, name: str, fields: tuple[str, ...] = ()) -> gx.plot.RunReader:
    """A short run in which everything that has a name has this one."""
    mesh = flat_tube(ALONE, 0.3, 0.03, 2, compartments=2)
    groups = {f"{k} {name}": group for k, group in enumerate(mesh.groups.values())}
    film = gx.Membrane(gx.Mesh(mesh.domain, groups), WRINKLING, name=f"film {name}")
    ball = gx.PointMass(1.0, position=(0.0, 0.0, 1.0), comm=ALONE, name=f"ball {name}")
    tank = gx.Tank(
        1e-3, gas=gx.IdealGas(gamma=1.4, R=287.0), pressure=1e5, temperature=300.0, name=name
    )
    chosen = ("displacement", "state", "group", *fields)
    recording = gx.Recording(
        folder,
        fields={film.name: chosen},
        probes={f"probe {name} x [m]": gx.probes.Position(ball.port(), "x")},
        every=1,
        title=name,
    )
    scene = gx.Scene(film, ball, tank)
    gx.Simulation(scene, gx.Midpoint(dt=1e-3), outputs=[recording]).run(until=2e-3)
    return gx.plot.RunReader(folder)


class Page(HTMLParser):
    """What a browser would find in a page: elements with their attributes, scripts, and the texts
    outside."""

    def __init__(self, text: str) -> None:
        super().__init__(convert_charrefs=True)
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.inside: list[str] = []
        self.scripts: list[str] = []
        self.texts: list[str] = []
        self.feed(text)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs)))
        if tag not in ("meta", "img", "input", "source"):
            self.inside.append(tag)
        if tag == "script":
            self.scripts.append("")

    def handle_endtag(self, tag: str) -> None:
        assert self.inside.pop() == tag

    def handle_data(self, data: str) -> None:
        if self.inside and self.inside[-1] == "script":
            self.scripts[-1] += data
        else:
            self.texts.append(data)

    def handle_comment(self, data: str) -> None:
        raise AssertionError(f"a comment: {data}")


ALLOWED = {
    *("html", "head", "meta", "title", "style", "body", "h1", "h2", "p", "div", "canvas", "button"),
    *("picture", "source", "label"),
    *("input", "span", "select", "img", "pre", "table", "tr", "th", "td", "script"),
}


def check_page(text: str, name: str) -> None:
    """The page has our elements only, two scripts, and the name as a text; its policy allows our
    script alone."""
    page = Page(text)
    assert {tag for tag, _ in page.elements} <= ALLOWED
    attributes = {key for _, found in page.elements for key in found}
    assert not [key for key in attributes if key.startswith("on")]
    links = [found[key] for _, found in page.elements for key in ("src", "href") if key in found]
    assert all(link.startswith("data:image/png;base64,") for link in links)
    assert len(page.scripts) == 2
    data = json.loads(page.scripts[0])
    assert not re.search("[<>&\u2028\u2029]", page.scripts[0])
    [policy] = [
        found["content"]
        for _, found in page.elements
        if found.get("http-equiv") == "Content-Security-Policy"
    ]
    digest = b64encode(sha256(page.scripts[1].encode()).digest()).decode()
    assert f"script-src 'sha256-{digest}'" in policy and "default-src 'none'" in policy
    assert "unsafe" not in policy
    [style] = [t for t in page.texts if "font: 15px" in t]
    digest = b64encode(sha256(style.encode()).digest()).decode()
    assert f"style-src 'sha256-{digest}'" in policy
    shown = name.encode(errors="replace").decode()  # half of a surrogate pair has no UTF-8
    assert any(shown.replace("\x00", "\ufffd") in t or shown in t for t in page.texts)
    names = [kind for legend in data["legends"] for kind, _ in legend.get("names", [])]
    assert any(name in kind for kind in names)  # groups


@pytest.mark.parametrize("attack", ATTACKS)
def test_names_are_texts_in_a_report(
    tmp_path: Path, attack: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Names of bodies, groups, chambers, probes, the title, and of a field, in every part of the
    page and the data."""
    fields: tuple[str, ...] = ()
    if attack.isprintable():
        field = attack.replace("(", "`").replace(")", "`")  # dolfinx cuts names at parentheses
        monkeypatch.setitem(FIELDS, field, FIELDS["stress1"])
        fields = (field,)
    run = record(tmp_path / "run", attack, fields)
    gx.write_report(run, tmp_path / "report.html")
    check_page((tmp_path / "report.html").read_text(encoding="utf-8"), attack)
    gx.plot.strip(run, "group", path=tmp_path / "strip.png", count=2)
    gx.plot.curves(run, tmp_path / "curves.png")


@pytest.mark.parametrize("attack", ATTACKS)
def test_the_name_of_a_load_parameter_is_a_text(tmp_path: Path, attack: str) -> None:
    """In tables, captions, curves and the report of a path of equilibria."""
    ball = gx.PointMass(1.0, position=(0.0, 0.0, -1.0), comm=ALONE, name="ball")
    cable = gx.Cable(line(ALONE, [(0, 0, 0), (1, 0, 0)], 2), gx.CableLaw(1e4, 0.01))
    spring = gx.connectors.Spring(
        ball.port(), gx.Ground((0.0, 0.0, 0.0)), stiffness=10.0, length=1.0
    )
    weight = gx.loads.Force(ball.port(), lambda t: (0.0, 0.0, -t))
    equilibrium = gx.Equilibrium(gx.Scene(ball, cable, spring, weight, gx.Fixed(cable, "line")))
    recording = gx.Recording(tmp_path / "run", title=attack)
    gx.outputs.record(equilibrium, [recording], at=[1.0, 2.0], along=attack)
    run = gx.plot.RunReader(tmp_path / "run")
    assert run.times.tolist() == [1.0, 2.0]
    assert run.along(run.table("points.csv")).tolist() == [1.0, 2.0]
    gx.plot.curves(run, tmp_path / "curves.png")
    gx.write_report(run, tmp_path / "report.html")
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    elements = {tag for tag, _ in Page(page).elements}
    assert elements <= ALLOWED


def test_texts_of_a_strangers_file_are_texts_in_a_report(tmp_path: Path) -> None:
    """Those that no run writes: status, versions, laws, kinds of parts."""
    attack = ATTACKS[0]
    record(tmp_path / "run", "x")
    path = tmp_path / "run" / "run.json"
    about = json.loads(path.read_text())

    def spoil(tree: Any) -> Any:
        """All texts but names of bodies and fields, which are names of files, and all keys of
        versions and laws."""
        if isinstance(tree, dict):
            return {key: spoil(value) for key, value in tree.items()}
        if isinstance(tree, list):
            return [spoil(value) for value in tree]
        return attack if isinstance(tree, str) else tree

    kept = ("fields", "bodies", "groups", "axis")
    strange = {key: value if key in kept else spoil(value) for key, value in about.items()}
    strange["versions"] = {attack: attack}
    for body in strange["scene"]["bodies"].values():
        body["law"] = [attack, {attack: attack}]
    strange["groups"] = [f"{k} {attack}" for k in range(len(about["groups"]))]
    path.write_text(json.dumps(strange))
    gx.write_report(gx.plot.RunReader(tmp_path / "run"), tmp_path / "report.html")
    check_page((tmp_path / "report.html").read_text(encoding="utf-8"), attack)


# ---- damaged files -------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("recorded") / "run"
    record(folder, "x")
    return folder


def places(tree: Any, way: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """All keys and positions in a tree of dicts and lists."""
    inside = enumerate(tree) if isinstance(tree, list) else tree.items()
    for key, value in inside:
        yield (*way, key)
        if isinstance(value, dict | list):
            yield from places(value, (*way, key))


def changed(tree: Any, way: tuple[Any, ...], value: Any) -> Any:
    """A copy in which one entry has another value, or is removed (None)."""
    found = copy.deepcopy(tree)
    inner = found
    for key in way[:-1]:
        inner = inner[key]
    if value is None:
        del inner[way[-1]]
    else:
        inner[way[-1]] = value
    return found


def use(folder: Path, out: Path) -> str:
    """Read a run and make a report; what an `InputError` of one sentence says, or nothing."""
    try:
        gx.write_report(gx.plot.RunReader(folder), out / "report.html")
    except gx.InputError as error:
        assert "\n" not in str(error) and str(error).endswith(".")
        return str(error)
    return ""


# For numbers, texts, lists and objects: a key that is removed, and values of other kinds and sizes.
OTHER_VALUES: list[Any] = [None, "words", 7, -1.5, True, [], {}, [[]], 10**400]


def test_a_run_of_another_format_is_refused(recorded: Path, tmp_path: Path) -> None:
    """Version 0.1 wrote fields that this one does not read."""
    about = json.loads((recorded / "run.json").read_text())
    (tmp_path / "run.json").write_text(json.dumps(about | {"format": 1}))
    assert "is of format 1, not 2; read it with the program that wrote it" in use(
        tmp_path, tmp_path
    )


def test_any_damaged_key_of_run_json_is_refused_in_a_sentence(
    recorded: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What is still a run is read, and a report of it is made, here without pictures."""
    monkeypatch.setattr("gossamer_fx.records.plot.report._image", lambda *given: "")
    folder = tmp_path / "run"
    shutil.copytree(recorded, folder)
    path = folder / "run.json"
    about = json.loads(path.read_text())
    del about["arguments"]  # they are kept for the user, and not read
    about["solids"] = [
        {"X": [[0.0, 0.0, 0.0]] * 3, "triangles": [[0, 1, 2]], "lines": [[0, 1]], "moves": False}
    ]
    refused = 0
    for number, way in enumerate(places(about)):
        for kind, value in enumerate(OTHER_VALUES):
            path.write_text(json.dumps(changed(about, way, value)))
            try:
                read_run_file(folder)
            except gx.InputError as error:
                refused += 1
                assert (
                    "\n" not in str(error) and str(error).endswith(".") and "run.json" in str(error)
                )
                continue
            # A report takes time: each key has two or three values, each value many keys.
            if (number + kind) % 4:
                continue
            said = use(folder, tmp_path)
            assert not said or way[0] in ("fields", "groups", "solids", "axis"), (way, value, said)
    assert refused > 700


def test_what_is_not_a_run_json_is_refused_in_a_sentence(recorded: Path, tmp_path: Path) -> None:
    folder = tmp_path / "run"
    shutil.copytree(recorded, folder)
    path = folder / "run.json"
    for content in (
        "",
        "[]",
        "null",
        "{",
        "7",
        '"run"',
        "[" * 100_000,
        "\ufeff{}",
        '{"format": 1}',
    ):
        path.write_text(content)
        assert "run.json" in use(folder, tmp_path)
    path.write_bytes(b"\xff\xfe\x00")
    assert "cannot be read" in use(folder, tmp_path)


@pytest.mark.parametrize(
    "name", ["ledger.csv", "points.csv", "states.csv", "gas.csv", "probes.csv"]
)
def test_damaged_tables_are_refused_in_a_sentence(
    recorded: Path, tmp_path: Path, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Without a column or its first row, with words, with rows of other lengths, with other
    columns."""
    monkeypatch.setattr("gossamer_fx.records.plot.report.view_scripts", lambda data: "")

    whole = report._image

    def image(words: str, views: object, *curves: Any) -> str:
        # Pictures of the film read no tables.
        return whole(words, None, *curves) if curves else words

    monkeypatch.setattr("gossamer_fx.records.plot.report._image", image)
    shutil.copytree(recorded, tmp_path / "run")
    path = tmp_path / "run" / name
    rows = path.read_text().splitlines()
    head = rows[0].split(",")
    # The columns that every report reads.
    for column in {"time", "kinetic [J]", "iterations"} & set(head):
        k = head.index(column)
        cut = [",".join(word for i, word in enumerate(row.split(",")) if i != k) for row in rows]
        path.write_text("\n".join(cut))
        assert use(tmp_path / "run", tmp_path)
    for content in ("time\nx\n", "time,step\n1,2,3\n4\n", "a,b\n1,2\n", "\x00", "time\n" * 3):
        path.write_text(content)
        said = use(tmp_path / "run", tmp_path)
        assert not said or name in said
