"""One HTML page about a run that needs no other file: a view to turn, pictures, curves, tables.

The recording may come from a stranger.  All texts from it are escaped, in HTML and in the data for the view, and the
page has a content security policy: a browser runs the one script that is ours, known by its hash, and loads nothing.
"""

from __future__ import annotations

import json
import tempfile
from base64 import b64encode
from collections.abc import Callable, Iterable, Mapping
from hashlib import sha256
from html import escape
from pathlib import Path
from typing import Any

import numpy as np

from gossamer_fx.checks.arguments import check_arguments
from gossamer_fx.checks.errors import OutputFailure, check
from gossamer_fx.outputs.description import lines, number_text
from gossamer_fx.plot import plot as pictures
from gossamer_fx.plot.colours import default_field
from gossamer_fx.plot.plot import file_to_write
from gossamer_fx.plot.run_reader import RunReader
from gossamer_fx.plot.viewer import view_data

_STYLE = """
body { font: 15px/1.45 system-ui, sans-serif; color: #33383d; max-width: 1180px; margin: 2em auto; padding: 0 1em; }
h1 { font-size: 1.6em; font-weight: 500; margin-bottom: 0.1em; }
h2 { font-size: 1.15em; font-weight: 500; margin-top: 2em; }
p.status { color: #66707a; margin-top: 0; } p.status.bad { color: #b3441e; }
img { max-width: 100%; } table { border-collapse: collapse; } pre { font-size: 13px; overflow-x: auto; }
td, th { padding: 0.15em 1.2em 0.15em 0; text-align: left; font-weight: 400; vertical-align: top; }
th { color: #66707a; } td.number, th.number { text-align: right; font-variant-numeric: tabular-nums; }
#view { width: 100%; height: 460px; display: block; border: 1px solid #dde1e5; touch-action: none; outline: none; }
#bar { display: flex; gap: 1em; align-items: center; margin: 0.5em 0; }
#time { flex: 1; } #time-label { min-width: 8em; }
#legend i { display: inline-block; width: 0.9em; height: 0.9em; border: 1px solid #66707a; vertical-align: -0.1em; }
#legend b { display: inline-block; width: 12em; height: 0.7em; }
""".strip()

_VIEW = """
<div id="viewer"><canvas id="view" tabindex="0"></canvas>
<div id="bar"><button id="play">Play</button><input id="time" type="range" min="0"><span id="time-label"></span>
<select id="field"></select><span id="legend"></span></div></div>
<p class="status">Drag to turn, shift-drag to move, wheel to zoom, double click to go back.</p>
""".strip()

# Characters with a meaning in HTML, and line ends that JSON allows and JavaScript does not; JSON can write them so.
_JSON_ESCAPES = {ord(c): f"\\u{ord(c):04x}" for c in "<>&\u2028\u2029"}


@check_arguments
def write_report(run: RunReader, path: str | Path) -> None:
    """Write an HTML page about a run: a view to turn, pictures, curves and tables.

    Args:
        run: a recorded run; it may come from a stranger.
        path: of the file, ending in `.html`.

    Raises:
        InputError: nothing was recorded yet, or the path is a folder.
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
    try:
        # A file name or a title may hold half of a surrogate pair, which has no UTF-8.
        path.write_text(text, encoding="utf-8", errors="replace")
    except OSError as error:
        raise OutputFailure(
            f"Cannot write '{path}' ({error.strerror}); choose a folder that is writable."
        ) from error


def _page(run: RunReader) -> Iterable[str]:
    """The page, line by line."""
    script = Path(__file__).with_name("viewer.js").read_text(encoding="utf-8")
    ledger = run.table("ledger.csv")
    shows_scene = bool(run.bodies) and len(run.times) > 0
    yield '<!DOCTYPE html><html lang="en"><head><meta charset="utf-8">'
    yield f'<meta http-equiv="Content-Security-Policy" content="{_policy(script)}">'
    yield f"<title>{escape(run.title)}</title>"
    yield f'<meta name="viewport" content="width=device-width"><style>{_STYLE}</style></head><body>'
    yield f"<h1>{escape(run.title)}</h1>"
    yield _status(run.about)
    if shows_scene:
        field = default_field(run)
        yield _VIEW
        if len(run.times) > 1:
            yield "<h2>Over the time</h2>"
        yield _image(lambda file: pictures.strip(run, field, path=file), f"{field} at six times")
    if len(ledger["time"]) > 1:
        yield _image(
            lambda file: pictures.curves(run, file),
            "energies, pressures, states, errors, iterations",
        )
    yield "<h2>Scene</h2><pre>" + escape("\n".join(lines(run.about["scene"]))) + "</pre>"
    yield "<h2>Ledger</h2>" + _table(("", "start", "end", "largest magnitude"), _ledger(ledger))
    numbers = [*_pairs(run.about["stepper"]), *_pairs(run.about["statistics"])]
    yield "<h2>Solver</h2>" + _table((), numbers)
    yield "<h2>Versions</h2>" + _table((), _pairs(run.about["versions"]))
    if shows_scene:
        yield f'<script type="application/json" id="run-data">{_json(view_data(run))}</script>'
        yield f"<script>{script}</script>"
    yield "</body></html>"


def _policy(script: str) -> str:
    """The content security policy: images and styles in the page, and this one script."""
    sources = [
        f"'sha256-{b64encode(sha256(text.encode()).digest()).decode()}'"
        for text in (script, _STYLE)
    ]
    return f"default-src 'none'; img-src data:; script-src {sources[0]}; style-src {sources[1]}"


def _json(data: Any) -> str:
    """Data for a script element: no character in it can end the element or begin another one."""
    return json.dumps(data, separators=(",", ":")).translate(_JSON_ESCAPES)


def _status(about: Mapping[str, Any]) -> str:
    """How the run ended."""
    status = about["status"]
    numbers = about["statistics"]
    if "result" in about:
        pairs = _pairs(about["result"])
        words = ", ".join(f"{name} {value}" for name, value in pairs)
        return f'<p class="status">{escape(words)}</p>'
    kind = "status" if status in ("finished", "running") else "status bad"
    closes = "at rest"
    # Recordings of earlier versions do not say it.
    if not numbers.get("at rest", False):
        closes = f"energy closes to {abs(numbers['energy error']):.1e}"
    words = (
        f"{status} at t = {numbers['time']:.6g} s of {numbers['until']:.6g} s, {numbers['steps']} steps, "
        f"{closes}"
    )
    return f'<p class="{kind}">{escape(words)}</p>'


def _image(draw: Callable[[Path], None], words: str) -> str:
    """A picture as part of the page."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "picture.png"
        draw(file)
        data = b64encode(file.read_bytes()).decode()
    return f'<img alt="{escape(words)}" src="data:image/png;base64,{data}">'


def _ledger(ledger: Mapping[str, Any]) -> Iterable[tuple[str, ...]]:
    """Start, end and largest magnitude of each column."""
    for name, values in ledger.items():
        if name not in ("time", "step", "iterations", "substeps"):
            largest = values[int(np.abs(values).argmax())]
            numbers = (values[0], values[-1], largest)
            yield name.replace("_", " "), *(f"{value:.6g}" for value in numbers)


def _pairs(numbers: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Names and values as rows of a table."""
    return [(name, number_text(value)) for name, value in numbers.items()]


def _table(head: tuple[str, ...], rows: Iterable[tuple[str, ...]]) -> str:
    """A table whose first column has names, and the others numbers."""
    found = []
    if head:
        found.append(_row("th", head))
    found += [_row("td", row) for row in rows]
    return f"<table>{''.join(found)}</table>"


def _row(kind: str, words: tuple[str, ...]) -> str:
    first, *rest = words
    cells = "".join(f'<{kind} class="number">{escape(word)}</{kind}>' for word in rest)
    return f"<tr><th>{escape(first)}</th>{cells}</tr>"
