"""One HTML page about a run that needs no other file: a view to turn, pictures, curves, tables.

The recording may come from a stranger.  All texts from it are escaped, in HTML and in the data for
the view, and the page has a content security policy: a browser runs the one script that is ours,
known by its hash, and loads nothing.
"""

from __future__ import annotations

import json
from base64 import b64encode
from collections.abc import Iterable, Mapping
from functools import cache
from hashlib import sha256
from html import escape
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from gossamer_fx.core.checks.arguments import check_arguments
from gossamer_fx.core.checks.errors import check
from gossamer_fx.core.model.body import Array
from gossamer_fx.records.fields.units import energy_words
from gossamer_fx.records.outputs.description import lines, number_text
from gossamer_fx.records.outputs.output import replace_file
from gossamer_fx.records.plot import plot as pictures
from gossamer_fx.records.plot.answers import answers, is_round_off, ledger_unit
from gossamer_fx.records.plot.camera import View
from gossamer_fx.records.plot.colours import default_field
from gossamer_fx.records.plot.curve_data import curve_data
from gossamer_fx.records.plot.curve_panels import STORED, Curves, run_curves
from gossamer_fx.records.plot.page import Views, write_page
from gossamer_fx.records.plot.plot import file_to_write
from gossamer_fx.records.plot.run_reader import RunReader
from gossamer_fx.records.plot.viewer import RunView
from gossamer_fx.solve.view import LOAD_FACTOR, Axis

_STYLE = """
body { font: 15px/1.45 system-ui, sans-serif; color: #33383d; max-width: 1400px; margin: 2em auto; padding: 0 1em; }
h1 { font-size: 1.6em; font-weight: 500; margin-bottom: 0.1em; }
h2 { font-size: 1.15em; font-weight: 500; margin-top: 2em; }
p.status { color: #66707a; margin-top: 0; } p.status.bad { color: #b3441e; }
img { max-width: 100%; } table { border-collapse: collapse; } pre { font-size: 13px; overflow-x: auto; }
td, th { padding: 0.15em 1.2em 0.15em 0; text-align: left; font-weight: 400; vertical-align: top; }
th { color: #66707a; } td.number { white-space: nowrap; } td.number, th.number { text-align: right; font-variant-numeric: tabular-nums; }
#view { width: 100%; height: 460px; display: block; border: 1px solid #dde1e5; touch-action: none; outline: none; }
#stage { position: relative; } #overlay { position: absolute; left: 0; top: 0; width: 100%; height: 100%; pointer-events: none; } #low, #high { width: 5.5em; }
#extreme-words { white-space: pre-line; margin: 0; }
.bar { display: flex; flex-wrap: wrap; gap: 0.4em 1em; align-items: center; margin: 0.5em 0; }
#time { flex: 1; min-width: 8em; } #time-label { min-width: 8em; } #factor { width: 5em; } #probe { flex: 1; min-width: 0; }
#parts { max-height: 8em; overflow-y: auto; } #parts label { overflow-wrap: anywhere; } select { max-width: 14em; }
#legend i { display: inline-block; width: 0.9em; height: 0.9em; border: 1px solid #66707a; vertical-align: -0.1em; }
#legend b { display: inline-block; width: 12em; height: 0.7em; max-width: 40vw; }
#picked { white-space: pre-line; overflow-wrap: anywhere; margin: 0.3em 0; } [hidden] { display: none !important; }
div.table { overflow-x: auto; } #curves { display: grid; grid-template-columns: repeat(auto-fill, minmax(min(100%, 340px), 1fr)); gap: 0.8em 1.2em; }
#curves svg { display: block; width: 100%; } #curves .panel > svg { touch-action: pan-y; cursor: pointer; } #curves p { margin: 0; font-size: 13px; overflow-wrap: anywhere; }
#curves .values { color: #66707a; font-size: 12px; min-height: 1.5em; } #curves .values span { margin-right: 0.7em; } #curves .values svg { display: inline; width: 10px; }
@media (min-width: 1100px) {
  #watch { display: grid; grid-template-columns: minmax(0, 1fr) 380px; gap: 1.5em; }
  #watch #curves { max-height: 88vh; overflow-y: auto; display: block; } #watch #view { height: 60vh; }
}
@media (max-width: 700px) {
  body { margin: 0.8em auto; padding: 0 0.7em; } #view { height: 320px; }
  td, th { padding-right: 0.8em; } div.table { font-size: 13px; }
}
""".strip()

VIEW = """
<div id="viewer"><div id="stage"><canvas id="view" tabindex="0"></canvas><canvas id="overlay"></canvas></div>
<div class="bar"><button id="play">Play</button><label>Speed <select id="speed"></select></label><input id="time" type="range" min="0" value="0">
<span id="time-label"></span></div>
<div class="bar"><label>Colour <select id="field"></select> <select id="component" hidden aria-label="Component"></select></label><span id="legend"></span>
<span id="range"><label>from <input id="low" type="number" step="any" placeholder="least"></label> <label>to <input id="high" type="number" step="any" placeholder="largest"></label>
<label><input id="log" type="checkbox"> log</label> <label><input id="extremes" type="checkbox"> extremes</label></span></div>
<p id="extreme-words" class="status"></p>
<div class="bar"><label>Deformation × <input id="factor" type="number" value="1" step="any"></label>
<label>Cut <select id="cut"></select></label><input id="depth" type="range" min="0" max="1000" value="500" hidden><span id="depth-label"></span>
<label><input id="follow" type="checkbox"> move along</label><label><input id="light" type="checkbox" checked> light</label><label><input id="edges" type="checkbox"> edges</label></div>
<div class="bar"><button id="home">Show all</button><button id="look-iso">Oblique</button><button id="look-x">Along x</button><button id="look-y">Along y</button>
<button id="look-z">Along z</button><button id="picture">Save picture</button><button id="film">Save film</button></div>
<div class="bar" id="parts"></div>
<p id="picked" class="status">Click on a point for its values. Drag to turn, shift-drag to move, wheel to zoom.</p>
<div class="bar" id="copying" hidden><input id="probe" readonly><button id="copy">Copy probe</button></div></div>
""".strip()

# The script replaces the words.
CURVES = '<div id="curves">Curves need JavaScript; gossamer plot --curves draws them, too.</div>'

# Characters with a meaning in HTML, and line ends that JSON allows and JavaScript does not; JSON
# can write them so.
_JSON_ESCAPES = {ord(c): f"\\u{ord(c):04x}" for c in "<>&\u2028\u2029"}


_LEDGER_HEAD = ("", "start", "end", "largest magnitude")
_EQUILIBRIA_HEAD = ("at", "unbalanced force", "iterations", "supplied [J]", "stored [J]")
_SUPPLIED_NOTE = (
    "Supplied is the work of loads and supports from state to state, with the loads of the later "
    "one: it differs from what is stored by the jumps of the load, which does not make the states wrong."
)
# Rows of the table of equilibria, which are evenly spread over a longer path.
_MAX_EQUILIBRIA = 12
_PRESTRESS_HEAD = ("", "asked for", "reached, mean", "least", "largest", "reached")
_TENSIONS_HEAD = ("[N]", "mean", "least", "largest")


@check_arguments
def write_report(run: RunReader, path: str | Path) -> None:
    """Write an HTML page about a run: a view to turn, pictures, curves and tables.

    Args:
        run: a recorded run; it may come from a stranger.
        path: of the file, ending in `.html`.

    Raises:
        InputError: nothing was recorded yet, files of the run cannot be read, or the path is a
            folder.
        OutputFailure: the file cannot be written.

    Example:
        >>> page = folder / "report.html"
        >>> gx.write_report(recorded, page)
        >>> "A fall" in page.read_text()
        True
    """
    check(
        bool(run.table("ledger.csv")),
        f"The run in '{run.folder}' has no ledger yet; let it make a step.",
    )
    path = file_to_write(path)
    text = "\n".join(_page(run))
    # A file name or a title may hold half of a surrogate pair, which has no UTF-8.
    replace_file(path, text.encode("utf-8", errors="replace"))


def _page(run: RunReader) -> Iterable[str]:
    """Yield the lines of the HTML page of a report."""
    ledger = run.table("ledger.csv")
    shows_scene = bool(run.bodies) and len(run.times) > 0
    yield page_head(run.title)
    kind, words = status_words(run.about)
    yield f'<p class="{kind}">{escape(words)}</p>'
    yield f'<p class="status">{escape(_origin(run))}</p>'
    parameters = run.about.get("parameters", {})
    if parameters:
        words = ", ".join(f"{name} {value}" for name, value in parameters.items())
        yield f'<p class="status">with {escape(words)}</p>'
    head, rows = answers(run)
    if rows:
        yield "<h2>Answers</h2>" + _table(head, rows)
    # The energies of a mode are those of an arbitrary amplitude.
    curves = Curves([])
    if run.kind != "mode" and len(run.along(ledger)) > 1:
        curves = run_curves(run)
    if shows_scene and curves.panels:
        # Next to each other where there is room, so that both are seen at the same time.
        yield f'<div id="watch">{VIEW}{CURVES}</div>'
    elif shows_scene:
        yield VIEW
    elif curves.panels:
        yield CURVES
    if shows_scene:
        field = default_field(run)
        if len(run.times) > 1:
            yield f"<h2>Over the {escape(run.axis.name)}</h2>"
        views = pictures.strip_views(run, field, pictures.STRIP_COUNT, View())
        yield _image(f"{field} at six times", views)
    yield "<h2>Scene</h2><pre>" + escape("\n".join(lines(run.about["scene"]))) + "</pre>"
    if run.kind == "equilibrium":
        yield "<h2>Equilibria</h2>" + _table(_EQUILIBRIA_HEAD, _equilibria(run, ledger))
        yield f"<p>{_SUPPLIED_NOTE}</p>"
    elif run.kind == "run":
        yield "<h2>Balances</h2>" + _table(_LEDGER_HEAD, _ledger(run, ledger))
    prestress = run.about.get("prestress", {})
    if prestress:
        yield "<h2>Prestress</h2>" + _table(_PRESTRESS_HEAD, _prestress(prestress))
    tensions = run.table("tensions.csv")
    if tensions:
        yield "<h2>Tensions at the end</h2>" + _table(_TENSIONS_HEAD, _tensions(tensions))
    numbers = [*_pairs(run.about["method"]), *_pairs(run.about["statistics"])]
    yield "<h2>Solver</h2>" + _table((), numbers)
    yield "<h2>Versions</h2>" + _table((), _pairs(run.about["versions"]))
    data: dict[str, Any] = {}
    records: Array = np.zeros(0)
    if shows_scene:
        data = RunView(run).whole()
        records = np.asarray(run.times)[data["records"]]
    if curves.panels:
        data["curves"] = curve_data(curves, curves.at(records))
    if data:
        yield view_scripts(data)
    yield "</body></html>"


def _origin(run: RunReader) -> str:
    """What was run, when, and by which version."""
    origin = run.about.get("origin", {})
    versions = run.about["versions"]
    program = f"gossamer_fx {versions.get('gossamer_fx', 'of an unknown version')}"
    if origin.get("commit"):
        program += f", commit {origin['commit']}"
    ranks = run.about["scene"]["ranks"]
    parts = [origin.get("command", ""), origin.get("date", ""), program]
    parts.append("one rank" if ranks == 1 else f"{ranks} ranks")
    return "; ".join(part for part in parts if part)


def page_head(title: str, sources: str = "img-src data:") -> str:
    """The HTML page up to its heading, with a content security policy: styles and scripts of this
    module alone.

    Args:
        sources: of what else the page loads, in the words of a policy.
    """
    script_hash, style_hash = (
        f"'sha256-{b64encode(sha256(text.encode()).digest()).decode()}'"
        for text in (_script(), _STYLE)
    )
    policy = f"default-src 'none'; {sources}; script-src {script_hash}; style-src {style_hash}"
    return (
        '<!DOCTYPE html><html lang="en"><head><meta charset="utf-8">'
        f'<meta http-equiv="Content-Security-Policy" content="{policy}">'
        f"<title>{escape(title)}</title>"
        f'<meta name="viewport" content="width=device-width"><style>{_STYLE}</style></head><body>'
        f'<h1 id="title">{escape(title)}</h1>'
    )


def view_scripts(data: Mapping[str, Any]) -> str:
    """The data of a view and the script that shows it, as elements at the end of a page.

    No character in the data can end its element or begin another one.
    """
    text = json.dumps(data, separators=(",", ":")).translate(_JSON_ESCAPES)
    return (
        f'<script type="application/json" id="run-data">{text}</script><script>{_script()}</script>'
    )


@cache
def _script() -> str:
    """The library three.js and our scripts, which use it."""
    folder = Path(__file__).parent
    return "\n".join(
        (folder / name).read_text(encoding="utf-8")
        for name in ("three.min.js", "curves.js", "viewer.js")
    )


def status_words(about: Mapping[str, Any]) -> tuple[str, str]:
    """Class of the HTML paragraph that states how a run ended, and its words.

    Args:
        about: the contents of run.json; an equilibrium or a path has its words as "summary".
    """
    status = about["status"]
    numbers = about["statistics"]
    if "summary" in about:
        return "status", about["summary"]
    if "result" in about:
        pairs = _pairs(about["result"])
        words = ", ".join(f"{name} {value}" for name, value in pairs)
        if about["kind"] == "mode":
            words += "; the amplitude of a mode is arbitrary"
        return "status", words
    kind = "status" if status in ("finished", "running") else "status bad"
    along = about["axis"]
    axis = Axis(along["name"], along["unit"])
    words = (
        f"{status} at {axis.words(along['at'])} of {along['until']:.6g} {axis.unit}, "
        f"{numbers['steps']} steps"
    )
    if numbers.get("at rest", False):
        words += ", at rest"
    elif "energy error" in numbers:
        words += f", energy closes to {abs(numbers['energy error']):.1e}"
        if "energy defect" in numbers and "largest energy" in numbers:
            largest = energy_words(numbers["largest energy"])
            words += f" of {largest}, {abs(numbers['energy defect']):.1e} J"
    return kind, words


def _image(words: str, views: Views) -> str:
    """Pictures as an image of the HTML page; `words` stand for it if it is not shown."""
    file = BytesIO()
    write_page(file, "", views)
    data = b64encode(file.getvalue()).decode()
    return f'<img alt="{escape(words)}" src="data:image/png;base64,{data}">'


def _equilibria(run: RunReader, ledger: Mapping[str, Any]) -> Iterable[tuple[str, ...]]:
    """Load, unbalanced force over the load, iterations, work of loads and supports, and stored
    energy of all parts, in states of a path."""
    axis = LOAD_FACTOR if LOAD_FACTOR.column in ledger else run.axis
    loads = ledger[axis.column]
    stored = sum(values for name, values in ledger.items() if name.startswith(STORED))
    energy = np.broadcast_to(stored, loads.shape)
    # A file that somebody changed may lack it.
    residuals = ledger.get("residual", np.full(len(loads), np.nan))
    for row in np.unique(np.linspace(0, len(loads) - 1, _MAX_EQUILIBRIA).astype(int)):
        residual = f"{residuals[row]:.1e}" if np.isfinite(residuals[row]) else ""
        yield (
            axis.words(float(loads[row]), digits=4),
            residual,
            f"{ledger['iterations'][row]:.0f}",
            f"{ledger['supplied'][row]:.6g}",
            f"{energy[row]:.6g}",
        )


def _ledger(run: RunReader, ledger: Mapping[str, Any]) -> Iterable[tuple[str, ...]]:
    """Start, end and largest magnitude of each column that is neither zero nor round-off
    throughout."""
    for name, values in ledger.items():
        if name in (*run.not_values, "iterations", "substeps") or not values.any():
            continue
        if not is_round_off(name, run, ledger):
            largest = values[int(np.abs(values).argmax())]
            numbers = (values[0], values[-1], largest)
            unit = ledger_unit(name)
            words = name.replace("_", " ") + (f" [{unit}]" if unit else "")
            yield words, *(f"{value:.6g}" for value in numbers)


def _prestress(parts: Mapping[str, Mapping[str, Any]]) -> Iterable[tuple[str, ...]]:
    """Rows of the prestress that was asked for and reached, with the unit of each part."""
    for name, part in parts.items():
        share = "-"
        # The file may come from a stranger.
        if part["asked"]:
            share = f"{100 * part['mean'] / part['asked']:.3g} %"
        values = (part["asked"], part["mean"], part["least"], part["largest"])
        yield f"{name} [{part['unit']}]", *(f"{value:.6g}" for value in values), share


def _tensions(table: Mapping[str, Any]) -> Iterable[tuple[str, ...]]:
    """Mean, least and largest tension [N] of each line in the last recorded state.

    Args:
        table: tensions.csv, whose columns are called "NAME mean [N]", and so on.
    """
    for column, values in table.items():
        name, is_mean, _ = column.rpartition(" mean [N]")
        if not is_mean or not len(values):
            continue
        cells = [f"{values[-1]:.6g}"]
        for which in ("least", "largest"):
            of_line = table.get(f"{name} {which} [N]")
            # A spring or rope has one tension only.
            cells.append("" if of_line is None else f"{of_line[-1]:.6g}")
        yield name, *cells


def _pairs(numbers: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Names and values as rows of a table."""
    return [(name, number_text(value)) for name, value in numbers.items()]


def _table(head: tuple[str, ...], rows: Iterable[tuple[str, ...]]) -> str:
    """A table whose first column has names, and the others numbers; empty columns are left out."""
    cells = list(rows)
    columns = len(cells[0]) if cells else 0
    used = [k for k in range(columns) if k == 0 or any(row[k] for row in cells)]
    found = []
    if head and cells:
        found.append(_row("th", tuple(head[k] for k in used)))
    found += [_row("td", tuple(row[k] for k in used)) for row in cells]
    return f'<div class="table"><table>{"".join(found)}</table></div>'


def _row(kind: str, words: tuple[str, ...]) -> str:
    """A row of a table: a heading, then cells of a kind, "th" or "td"."""
    first, *rest = words
    cells = "".join(f'<{kind} class="number">{escape(word)}</{kind}>' for word in rest)
    return f"<tr><th>{escape(first)}</th>{cells}</tr>"
