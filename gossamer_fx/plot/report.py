"""One HTML page about a run that needs no other file: a view to turn, pictures, curves, tables."""

from __future__ import annotations

import json
import tempfile
from base64 import b64encode
from collections.abc import Callable, Iterable
from html import escape
from pathlib import Path

import numpy as np

from gossamer_fx.checks.arguments import check_arguments
from gossamer_fx.checks.errors import OutputFailure, check
from gossamer_fx.outputs.description import lines
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


@check_arguments
def write_report(run: RunReader, path: str | Path) -> None:
    """Write the page.

    Raises:
        InputError: nothing was recorded yet, or the path is a folder.
        OutputFailure: the file cannot be written.
    """
    check(
        bool(run.table("ledger.csv")),
        f"The run in '{run.folder}' has no ledger yet; let it make a step.",
    )
    path = file_to_write(path)
    text = "\n".join(_page(run))
    try:
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise OutputFailure(
            f"Cannot write '{path}' ({error.strerror}); choose a folder that is writable."
        ) from error


def _page(run: RunReader) -> Iterable[str]:
    about, moving = run.about, bool(run.bodies) and len(run.times) > 0
    status = str(about.get("status", "unknown"))
    yield f'<!DOCTYPE html><html lang="en"><head><meta charset="utf-8"><title>{escape(run.title)}</title>'
    yield f'<meta name="viewport" content="width=device-width"><style>{_STYLE}</style></head><body>'
    yield f"<h1>{escape(run.title)}</h1>"
    numbers = about["statistics"]
    good = "" if status in ("finished", "running") else " bad"
    yield (
        f'<p class="status{good}">{escape(status)} at t = {numbers["time"]:.6g} s of {numbers["until"]:.6g} s, '
        f"{numbers['steps']} steps, energy closes to {abs(numbers['energy error']):.1e}</p>"
    )
    if moving:
        yield _VIEW
        yield "<h2>Over the time</h2>"
        field = default_field(run)
        yield _image(lambda file: pictures.strip(run, field, path=file), f"{field} at six times")
    if len(run.table("ledger.csv")["time"]) > 1:
        yield _image(
            lambda file: pictures.curves(run, file),
            "energies, pressures, states, errors, iterations",
        )
    yield "<h2>Scene</h2><pre>" + escape("\n".join(lines(about["scene"]))) + "</pre>"
    yield "<h2>Ledger</h2>" + _table(("", "start", "end", "largest magnitude"), _ledger(run))
    yield "<h2>Solver</h2>" + _table(("", ""), [*_pairs(about["stepper"]), *_pairs(numbers)])
    yield "<h2>Versions</h2>" + _table(("", ""), _pairs(about["versions"]))
    if moving:
        data = json.dumps(view_data(run), separators=(",", ":"))
        yield f'<script type="application/json" id="run-data">{data}</script>'
        yield (
            "<script>"
            + Path(__file__).with_name("viewer.js").read_text(encoding="utf-8")
            + "</script>"
        )
    yield "</body></html>"


def _image(draw: Callable[[Path], None], words: str) -> str:
    """A picture as part of the page."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "picture.png"
        draw(file)
        return f'<img alt="{escape(words)}" src="data:image/png;base64,{b64encode(file.read_bytes()).decode()}">'


def _ledger(run: RunReader) -> Iterable[tuple[str, ...]]:
    """Start, end and largest magnitude of each column."""
    for name, values in run.table("ledger.csv").items():
        if name not in ("time", "step", "iterations", "substeps"):
            numbers = values[0], values[-1], values[int(np.abs(values).argmax())]
            yield name.replace("_", " "), *(f"{value:.6g}" for value in numbers)


def _pairs(numbers: dict[str, object]) -> list[tuple[str, str]]:
    return [(name, f"{v:.6g}" if isinstance(v, float) else str(v)) for name, v in numbers.items()]


def _table(head: tuple[str, ...], rows: Iterable[tuple[str, ...]]) -> str:
    kind = ' class="number"'
    body = "".join(
        f"<tr><th>{escape(first)}</th>"
        + "".join(f"<td{kind}>{escape(word)}</td>" for word in rest)
        + "</tr>"
        for first, *rest in rows
    )
    top = (
        "<tr>" + "".join(f"<th{kind}>{escape(word)}</th>" for word in head) + "</tr>"
        if any(head)
        else ""
    )
    return f"<table>{top}{body}</table>"
