"""Pages that are made from the code: the reference from docstrings, the gallery from demos, the
options from parsers.

A docstring is plain text: paragraphs, equations as indented lines, Args, Raises and Returns with
one entry a name.
"""

from __future__ import annotations

import ast
import importlib
import inspect
import re
import shutil
import sys
import tomllib
from collections.abc import Sequence
from operator import attrgetter
from pathlib import Path
from types import FunctionType
from typing import Any

import gossamer_fx
from gossamer_fx.app.cli.demo import demos_of
from gossamer_fx.core.checks.lazy_names import public_names

HERE = Path(__file__).parent
ROOT = HERE.parent
OUT = HERE / "generated"
SECTIONS = {
    "Args": "Arguments",
    "Raises": "Errors",
    "Returns": "Returns",
    "Yields": "Yields",
    "Attributes": "Attributes",
}
# what parts, outputs and steppers of every kind have; "Your own item" and `model/terms.py` explain
# it
CONTRACT = {"terms", "requires", "describe", "initial_state", "initialise", "start"}
CONTRACT |= {"open", "record", "close", "cursor", "resume", "times", "writes", "coordinates"}
CONTRACT |= {"reconstruct"}
ROOMS = {
    "mesh": "Meshes",
    "bodies": "Bodies: films, plates, cables, beams, rigid bodies",
    "materials": "Laws of films",
    "gas": "Gas",
    "constraints": "Supports, prescribed motion, ties, rigid regions, joints",
    "connectors": "Springs, ropes, tapes, creases, attached masses",
    "fold": "Fold maps",
    "contact": "Contact",
    "loads": "Loads and damping",
    "control": "Control",
    "orbit": "Orbit",
    "reduction": "Reduced models",
    "scene": "Scene and start",
    "steppers": "Time steppers and step control",
    "terms": "Stress rules",
    "analysis": "Equilibria, forms, vibrations",
    "fields": "Fields",
    "probes": "Probes",
    "outputs": "Outputs",
    "run": "Runs: simulation, events, checkpoints",
    "plot": "Pictures",
    "sweep": "Sweeps",
    "cli": "Cases",
    "solvers": "Solvers",
    "model": "Ports",
    "checks": "Errors",
}


# ---- docstrings ----------------------------------------------------------------------------------


# Names as docstrings write them, with or without their namespace, by the name they stand for.
LINKED = {name.split(".")[-1]: name for name in public_names()}
LINKED |= {name: name for name in public_names()}


def markdown(text: str) -> str:
    """A docstring as Markdown."""
    lines = text.splitlines()
    out: list[str] = []
    i = 0
    while i < len(lines):
        line = lines[i]
        heading = re.fullmatch(r"(\w+):", line.strip())
        if heading and heading[1] in SECTIONS and not line.startswith(" "):
            i, entries = _entries(lines, i + 1)
            out += ["", f"**{SECTIONS[heading[1]]}**", "", *entries, ""]
        elif line == "Example:":
            out += ["", "**Example**", ""]
            i += 1
        elif line.startswith("    "):
            block = []
            while i < len(lines) and (lines[i].startswith("    ") or not lines[i].strip()):
                block.append(lines[i])
                i += 1
            while not block[-1].strip():
                block.pop()
            # Sphinx colours an interactive session, and leaves an equation as it is.
            language = "text"
            if ">>>" in block[0]:
                language = "pycon"
            out += [
                "",
                f"```{language}",
                *inspect.cleandoc("\n".join(["", *block])).splitlines(),
                "```",
                "",
            ]
        else:
            # A row of a table has its own markup.
            if not line.startswith("|"):
                line = prose(line)
            out.append(line)
            i += 1
    return "\n".join(out)


def _entries(lines: list[str], i: int) -> tuple[int, list[str]]:
    """Entries `name: text` as a definition list, and where they end."""
    out: list[str] = []
    while i < len(lines) and (lines[i].startswith("    ") or not lines[i].strip()):
        entry = re.match(r"    ([\w*][\w*, ]*): (.*)", lines[i])
        if entry:
            out += ["", f"`{entry[1]}`", f":   {prose(entry[2])}"]
        elif lines[i].strip() and out:
            out.append(f"    {prose(lines[i].strip())}")
        elif lines[i].strip():
            out += [prose(lines[i].strip())]
        i += 1
    return i, out


def prose(line: str) -> str:
    """A line of text: what Markdown would take for its own is escaped, public names are linked."""
    out = []
    for words in re.split(r"(`[^`]*`)", line):
        if words.startswith("`"):
            out.append(_linked(words))
        else:
            out.append(re.sub(r"([*_<\\~#])", r"\\\1", words))
    return "".join(out)


def _linked(code: str) -> str:
    """A word in backticks as a link to its entry of the reference, if it is a public name."""
    name = LINKED.get(code.strip("`").removeprefix("gx."))
    if not name:
        return code
    return f"{{py:obj}}`{name} <gossamer_fx.{name}>`"


# ---- reference -----------------------------------------------------------------------------------


def thing(name: str) -> Any:
    """The object of a public name, e.g. "Chamber" or "gas.Ring", without the check of its
    arguments."""
    found = attrgetter(name)(gossamer_fx)
    if inspect.isfunction(found):
        return inspect.unwrap(found)
    return found


def room_of(name: str) -> str:
    """The folder of the package in which the object of a public name is defined."""
    if "." in name:
        return name.split(".")[0]
    house, room = thing(name).__module__.split(".")[1:3]
    return house if house in ROOMS else room


def members(cls: type) -> list[tuple[str, str, Any]]:
    """Public methods and properties of a class that are its own or its parents' of this package,
    with their kind."""
    found: dict[str, tuple[str, str, Any]] = {}
    for parent in reversed([c for c in cls.__mro__ if c.__module__.startswith("gossamer_fx")]):
        for name, value in vars(parent).items():
            if name.startswith("_"):
                continue
            plain = value
            if isinstance(value, staticmethod | classmethod):
                plain = value.__func__
            if isinstance(plain, FunctionType):
                found[name] = ("method", name, plain)
            elif isinstance(plain, property):
                found[name] = ("property", name, plain.fget)
    return [found[name] for name in sorted(found)]


def signature(thing: Any, bound: bool = False) -> str:
    """Arguments as in the code; of methods without self."""
    try:
        found = inspect.signature(thing)
    except (TypeError, ValueError):
        return "()"
    parameters = [
        p
        for i, p in enumerate(found.parameters.values())
        if not (bound and i == 0 and p.name == "self")
    ]
    shown = []
    for p in parameters:
        if p.default is not p.empty:
            p = p.replace(default=_Shown(p.default))
        shown.append(p)
    return str(found.replace(parameters=shown)).replace("'", "")


class _Shown:
    """A default value as a short word."""

    def __init__(self, value: Any) -> None:
        text = repr(value)
        # Addresses of objects and long tables say nothing to a reader.
        is_short = len(text) < 40 and "<" not in text and "Frozen" not in text
        self._text = text if is_short else "..."

    def __repr__(self) -> str:
        return self._text.replace("'", '"')


def entry(name: str) -> str:
    """Reference of one public name."""
    it = thing(name)
    text = inspect.getdoc(it) or ""
    namespace, _, short = f"gossamer_fx.{name}".rpartition(".")
    # by the name of its module Sphinx finds the code of an entry
    module = f":module: {namespace}\n\n"
    if not inspect.isclass(it):
        return _directive("py:function", short + signature(it), module + markdown(text))
    kind_of_class = "py:class"
    head = short + signature(it)
    if issubclass(it, BaseException):
        # Users catch errors, and do not make them: their arguments do not matter.
        kind_of_class = "py:exception"
        head = short
    body = [markdown(text)]
    for kind, member, plain in members(it):
        doc = inspect.getdoc(plain)
        if doc:
            words = member
            if kind == "method":
                words += signature(plain, bound=True)
            body.append(_directive(f"py:{kind}", words, markdown(doc), fence=":::"))
    body[0] = module + body[0]
    return _directive(kind_of_class, head, "\n\n".join(body))


def _directive(kind: str, head: str, body: str, fence: str = "::::") -> str:
    """A block of MyST: options follow the head at once, text follows an empty line."""
    options = "\n"
    if body.startswith(":module:"):
        options = ""
    return f"{fence}{{{kind}}} {head}\n{options}{body}\n{fence}\n"


def undocumented() -> list[str]:
    """Public names that say nothing about themselves, methods and properties of public classes
    included."""
    missing = []
    for name in public_names():
        it = thing(name)
        if not inspect.getdoc(it):
            missing.append(name)
        if inspect.isclass(it) and not issubclass(it, BaseException):
            missing += [
                f"{name}.{member}"
                for _, member, plain in members(it)
                if member not in CONTRACT and not inspect.getdoc(plain)
            ]
    return missing


def reference() -> dict[str, str]:
    """One page a room, and their index."""
    rooms: dict[str, list[str]] = {}
    for name in public_names():
        rooms.setdefault(room_of(name), []).append(name)
    order = [*[r for r in ROOMS if r in rooms], *sorted(set(rooms) - set(ROOMS))]
    pages = {}
    rows = []
    for room in order:
        title = ROOMS.get(room, room.capitalize())
        pages[f"reference_{room}"] = f"# {title}\n\n" + "\n".join(
            entry(name) for name in rooms[room]
        )
        links = ", ".join(f"{{py:obj}}`{name} <gossamer_fx.{name}>`" for name in rooms[room])
        rows.append(f"| [{title}](reference_{room}.md) | {links} |")
    toc = "\n".join(f"reference_{room}" for room in order)
    pages["reference"] = (
        "# Every public name\n\n"
        "Names of `import gossamer_fx as gx`: core names, e.g. `gx.Chamber`, and names of "
        "namespaces, e.g. `gx.gas.Ring`. SI units and radians "
        "throughout; a group is the name of a physical group of the mesh.\n\n"
        "| what | names |\n|---|---|\n"
        + "\n".join(rows)
        + f"\n\n```{{toctree}}\n:hidden:\n\n{toc}\n```\n"
    )
    return pages


def mesh_generators() -> list[tuple[str, Any]]:
    """Names within `gossamer_fx.meshes` and functions of all mesh generators."""
    found = []
    for path in sorted((ROOT / "meshes").glob("[a-z]*.py")):
        module = importlib.import_module(f"gossamer_fx.meshes.{path.stem}")
        for name, it in vars(module).items():
            plain = inspect.unwrap(it) if inspect.isfunction(it) else it
            is_own = getattr(plain, "__module__", "").endswith(f"meshes.{path.stem}")
            if is_own and not name.startswith("_") and _makes_mesh(plain):
                found.append((f"{path.stem}.{name}", plain))
    return found


def _makes_mesh(it: Any) -> bool:
    """Whether a function returns a mesh on the ranks of a communicator."""
    if not inspect.isfunction(it):
        return False
    found = inspect.signature(it)
    return found.return_annotation == "Mesh" and "comm" in list(found.parameters)[:1]


def meshes() -> str:
    """One page of all mesh generators."""
    parts = [
        "# Ready meshes\n\nImport a generator from its module, e.g. "
        "`from gossamer_fx.meshes.sheet import sheet`. Meshes of your own: "
        "[import and mesh](../howto/import.md).\n"
    ]
    for name, it in mesh_generators():
        module, _, short = name.rpartition(".")
        head = f":module: gossamer_fx.meshes.{module}\n\n"
        body = head + markdown(inspect.getdoc(it) or "")
        parts.append(_directive("py:function", short + signature(it), body))
    return "\n".join(parts)


# ---- gallery, options, presets -------------------------------------------------------------------


# the program of each demo by its name
PROGRAMS = demos_of(ROOT / "demos")


def demos() -> list[tuple[str, str, str]]:
    """Name, title and docstring of each demo."""
    found = []
    for path in PROGRAMS.values():
        doc = ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or ""
        found.append((path.stem, doc.split("\n\n")[0].replace("\n", " "), doc.partition("\n\n")[2]))
    return found


LEVELS = {1: "a first scene", 2: "one subject", 3: "many parts"}


def subjects() -> list[dict[str, Any]]:
    """The demos by subject, with level and run time, as `gallery.toml` lists them.

    Raises:
        ValueError: a demo is not in the list of its folder, or in it without being there.
    """
    found = tomllib.loads((HERE / "gallery.toml").read_text(encoding="utf-8"))["subject"]
    listed = {
        f"{subject['folder']}/{demo['name']}" for subject in found for demo in subject["demos"]
    }
    there = {f"{path.parent.name}/{name}" for name, path in PROGRAMS.items()}
    if listed != there:
        raise ValueError(
            f"docs/gallery.toml and demos differ by {sorted(listed ^ there)}: list every demo once"
        )
    return list(found)


def gallery() -> dict[str, str]:
    """A page of cards by subject, and one page a demo: what it shows, its picture, commands,
    notebook."""
    texts = {name: (title, text) for name, title, text in demos()}
    parts = [
        "# Gallery\n\nEach card opens the page of a demo, with its commands, its sources and a "
        "notebook. The times are of one core.\n"
    ]
    pages = {}
    for subject in subjects():
        parts.append(f"## {subject['title']}\n\n:::::{{grid}} 1 2 3 3\n:gutter: 3\n")
        for demo in subject["demos"]:
            name = demo["name"]
            title, text = texts[name]
            parts.append(_card(demo, title))
            pages[f"demo_{name}"] = _demo_page(name, demo["title"], title, text)
        parts.append(":::::\n")
    toc = "\n".join(pages)
    parts.append(f"```{{toctree}}\n:hidden:\n\n{toc}\n```\n")
    return {"gallery": "\n".join(parts), **pages}


def _card(demo: dict[str, Any], title: str) -> str:
    """The card of a demo in the gallery, with its picture if it has one."""
    name = demo["name"]
    picture = []
    if _picture(name):
        picture.append(f":img-top: {_thumbnail(name, demo.get('crop', WHOLE))}")
    options = "\n".join([*picture, f":link: demo_{name}", ":link-type: doc"])
    foot = f"{demo['time']} · {LEVELS[demo['level']]}"
    head = f"::::{{grid-item-card}} {demo['title']}\n{options}\n"
    return f"{head}\n{prose(title)}\n\n:::{{card-footer}}\n{foot}\n:::\n::::"


def _demo_page(name: str, heading: str, title: str, text: str) -> str:
    """The page of a demo: what it shows, its picture, its text, and its notebook."""
    parts = [f"# {heading}\n\n{prose(title)}\n"]
    if _picture(name):
        shutil.copy(PROGRAMS[name].with_suffix(".png"), OUT / f"{name}.png")
        parts.append(f"![{title}]({name}.png)\n")
    parts.append(markdown(text) + "\n")
    notebook(name, heading)
    program = PROGRAMS[name].relative_to(ROOT)
    parts.append(
        f"{{download}}`notebook <{name}.ipynb>` · {{download}}`Python <../../{program}>`\n"
    )
    return "\n".join(parts)


def _picture(name: str) -> Path | None:
    """The picture of a demo, None if it has none."""
    path = PROGRAMS[name].with_suffix(".png")
    if not path.exists():
        return None
    return path


# of a card on a large screen [pixels]; all cards are alike, so that their texts are in line
THUMBNAIL = (480, 320)
WHOLE = (0.0, 0.0, 1.0, 1.0)


def _thumbnail(name: str, crop: Sequence[float]) -> str:
    """A small copy of a part of a demo's picture, on white; its name relative to the page."""
    from PIL import Image

    with Image.open(PROGRAMS[name].with_suffix(".png")) as whole:
        width, height = whole.size
        left, top, right, bottom = crop
        box = (int(left * width), int(top * height), int(right * width), int(bottom * height))
        part = whole.convert("RGB").crop(box)
    part.thumbnail(THUMBNAIL)
    card = Image.new("RGB", THUMBNAIL, "white")
    card.paste(part, ((THUMBNAIL[0] - part.width) // 2, (THUMBNAIL[1] - part.height) // 2))
    card.save(OUT / f"{name}_small.png")
    return f"{name}_small.png"


def notebook(name: str, heading: str) -> None:
    """A demo as a notebook: its text, its code, and a cell that runs it.

    The code of a demo runs when its file is the main program; in a notebook the last cell does the
    same.
    """
    import nbformat
    from nbformat.v4 import new_code_cell, new_markdown_cell, new_notebook

    text = ast.get_docstring(ast.parse(_source(name))) or ""
    definitions, main = code_of(name)
    note = "Start Jupyter in a clone of gossamer_fx: the demo takes parts from its folder `demos`."
    cells = [
        new_markdown_cell(f"# {heading}\n\n{plain_text(text)}\n\n{note}"),
        new_code_cell(definitions),
    ]
    # A scene that only a command varies has no main program.
    if main:
        cells.append(new_code_cell(main))
    for i, cell in enumerate(cells):
        cell["id"] = f"cell-{i}"  # the same in every build
    nbformat.write(new_notebook(cells=cells), OUT / f"{name}.ipynb")


def _source(name: str) -> str:
    return PROGRAMS[name].read_text(encoding="utf-8")


def code_of(name: str) -> tuple[str, str]:
    """The definitions of a demo, and what its file does as the main program."""
    source = _source(name)
    docstring = ast.parse(source).body[0]
    body = "\n".join(source.splitlines()[docstring.end_lineno :])
    definitions, _, main = body.partition('if __name__ == "__main__":\n')
    return definitions.strip(), inspect.cleandoc("\n" + main)


def plain_text(text: str) -> str:
    """A docstring for a notebook, whose Markdown has no roles of Sphinx: indented lines stay as
    they are."""
    out = []
    for line in text.splitlines():
        if not line.startswith("    "):
            line = re.sub(r"([*_])", r"\\\1", line)
        out.append(line)
    return "\n".join(out)


def options() -> str:
    """Help texts as the programs print them."""
    from gossamer_fx.app.cli.command import _parser

    launcher = re.search(
        r"<<'TEXT'\n(.*?)TEXT", (ROOT / "gossamer").read_text(encoding="utf-8"), re.DOTALL
    )
    help_of_launcher = ""
    if launcher:
        help_of_launcher = launcher[1]
    parts = [
        "# Commands and their options\n\nThe launcher, in a clone:\n",
        f"```text\n{help_of_launcher}```\n",
    ]
    parser: Any = _parser()
    parts.append("An installed package has the command `gossamer` with these.\n")
    for name, sub in parser._subparsers._group_actions[0].choices.items():
        sub.prog = f"gossamer {name}"
        parts.append(f"## {name}\n\n```text\n{sub.format_help()}```\n")
    return "\n".join(parts)


def presets() -> str:
    """Films, fibres, gases and surfaces with their figures and sources."""
    from gossamer_fx.mechanics.gas.ideal_gas import IdealGas, PolynomialGas
    from gossamer_fx.mechanics.orbit import optics
    from gossamer_fx.presets import fibres, films, gases

    parts = ["# Presets\n\n## Films\n\n" + markdown(inspect.getdoc(films) or "")]
    parts.append("\n| name | E [GPa] | ν | density [kg/m³] | source |\n|---|---|---|---|---|")
    for name, film in vars(films).items():
        if isinstance(film, films.FilmMaterial):
            parts.append(
                f"| `films.{name}` | {film.E / 1e9:g} | {film.nu:g} | {film.density:g} | "
                f"{prose(film.source)} |"
            )
    parts.append("\n## Fibres\n\n" + markdown(inspect.getdoc(fibres) or ""))
    parts.append("\n| name | E [GPa] | density [kg/m³] | source |\n|---|---|---|---|")
    for name, fibre in vars(fibres).items():
        if isinstance(fibre, fibres.Fibre):
            figures = f"{fibre.E / 1e9:.4g} | {fibre.density:g}"
            parts.append(f"| `fibres.{name}` | {figures} | {prose(fibre.source)} |")
    parts.append(
        "\n## Gases\n\n"
        + markdown(inspect.getdoc(gases) or "")
        + "\n\n| name | γ | R [J/(kg K)] |\n|---|---|---|"
    )
    for name, gas in vars(gases).items():
        if isinstance(gas, IdealGas | PolynomialGas):
            parts.append(f"| `gases.{name}` | {gas.heat_ratio(298.15):.4g} | {gas.R:.2f} |")
    parts.append("\n## Surfaces in sunlight\n\n" + markdown(inspect.getdoc(optics.Optics) or ""))
    parts.append("\n| name | r | s | ε | B |\n|---|---|---|---|---|")
    for name, sheet in vars(optics).items():
        if isinstance(sheet, optics.Optics):
            for side, it in zip(("front", "back"), sheet.sides, strict=True):
                figures = (
                    f"{it.reflectivity:g} | {it.specular:g} | {it.emissivity:g} | "
                    f"{it.lambertian:.4g}"
                )
                parts.append(f"| `optics.{name}`, {side} | {figures} |")
    parts.append(
        "\nThe sail's coefficients go back to measurements of 2.5 µm Kapton with 100 nm aluminium "
        "in front and "
        "chromium behind; Heaton & Artusio-Glimpse (NASA NTRS 20150021404) revise them.\n"
    )
    return "\n".join(parts)


def measured_tests() -> str:
    """Every test of the validation, from the stored results."""
    from demos.validation.__main__ import table_of_tests

    head = (
        "# Measured, test by test\n\nWhat is predicted for each test? Of a curve the table has the "
        "values in the middle of its range, and the mean size of the relative errors. "
        "[Measured](../measured.md) explains the cases and their misses.\n\n"
    )
    return head + table_of_tests()


def measured_intervals() -> str:
    """The intervals of every test of the validation, and what its cases state about inputs."""
    from demos.validation.__main__ import table_of_intervals, tables_of_uncertainties

    stated, exact = tables_of_uncertainties()
    return (
        "# Measured: intervals and what they are from\n\nHow sure is each predicted and each "
        "measured number, and why? [Measured](../measured.md#how-sure-a-number-is) says how the "
        "intervals are made. Of a curve the first table has the values in the middle of its "
        "range.\n\n"
        f"{table_of_intervals()}\n## What is stated\n\nThe uncertainties of inputs and measured "
        "values as the cases state them. A range of values is that of the tests.\n\n"
        f"{stated}\n## What is taken as exact\n\n{exact}"
    )


def benchmark_points() -> str:
    """Every point of the error curves, from the stored results."""
    # The scripts of the benchmarks import each other by their names.
    sys.path.insert(0, str(ROOT / "demos" / "benchmarks"))
    from bench import tables_of_points

    head = (
        "# Error against time, point by point\n\nWhich numbers do the pictures of "
        "[error against time](../benchmark.md) show? A remark says where steps of a program did "
        "not converge.\n\n"
    )
    return head + tables_of_points()


def pages() -> dict[str, str]:
    """All pages by name."""
    texts = {
        "options": options(),
        "presets": presets(),
        "meshes": meshes(),
        "measured_tests": measured_tests(),
        "measured_intervals": measured_intervals(),
        "benchmark_points": benchmark_points(),
        "studies": (ROOT / "demos" / "studies" / "summary.md").read_text(encoding="utf-8"),
    }
    return {**reference(), **gallery(), **texts}


def write(app: Any = None) -> None:
    OUT.mkdir(exist_ok=True)
    made = pages()
    # Of names and demos that are gone
    for path in OUT.glob("*.md"):
        if path.stem not in made:
            path.unlink()
    for name, text in made.items():
        path = OUT / f"{name}.md"
        if not path.exists() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")


DOI = re.compile(r"(?<![\w/\[])doi:(10\.\d{4,9}/[^\s,;|`\]]*[^\s,;|`\].])")
FENCE = re.compile(r"^(```|~~~).*?^\1", re.DOTALL | re.MULTILINE)


def link_dois(app: Any, page: str, source: list[str]) -> None:
    """Make a link of each `doi:10...` of a page, but not in blocks of code."""
    text = source[0]
    parts: list[str] = []
    end = 0
    for block in FENCE.finditer(text):
        parts += [_with_links(text[end : block.start()]), block[0]]
        end = block.end()
    source[0] = "".join([*parts, _with_links(text[end:])])


def _with_links(text: str) -> str:
    return DOI.sub(_doi_link, text)


def _doi_link(found: re.Match[str]) -> str:
    doi = found[1]
    tail = ""
    # a closing bracket belongs to the sentence unless the DOI opened it, as in
    # 10.1016/S0020-7683(98)00123-4
    while doi.endswith(")") and doi.count(")") > doi.count("("):
        doi = doi[:-1]
        tail = ")" + tail
    return f"[doi:{doi}](<https://doi.org/{doi}>){tail}"


def link_names(app: Any, page: str, template: str, context: dict[str, Any], doctree: Any) -> None:
    """In pages of source code, give links back to the reference the namespaces of their names.

    Sphinx takes all names that a file defines for those of one namespace.
    """
    if page.startswith("_modules/"):
        context["body"] = with_namespaces(context["body"])


def with_namespaces(body: str) -> str:
    """HTML whose links to entries of the reference, e.g. "#gossamer_fx.Probes", have their
    namespaces."""
    return re.sub(
        r"#gossamer_fx\.(\w+)(?=[.\"])",
        lambda found: f"#gossamer_fx.{LINKED.get(found[1], found[1])}",
        body,
    )


def setup(app: Any) -> dict[str, bool]:
    app.connect("builder-inited", write)
    app.connect("source-read", link_dois)
    app.connect("html-page-context", link_names)
    return {"parallel_read_safe": True}
