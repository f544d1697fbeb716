// The curves of a run, with a cursor at the state that the view shows, or below the mouse.  Its data are in the page, or come
// from `gossamer watch`.
"use strict";
const curves = (function () {
  // RIGHT leaves room for half of the last number of the time axis.
  const WIDTH = 380, HEIGHT = 170, LEFT = 52, RIGHT = 16, TOP = 6, BOTTOM = 30;
  const frame = document.getElementById("curves");
  // The name of the language of pictures; a page has no addresses.
  const template = document.createElement("template");
  template.innerHTML = "<svg></svg>";
  const SVG = template.content.firstChild.namespaceURI;
  let data = null, panels = [], added = null, hovered = null, chosen = null, choose = () => {};

  // Rows of numbers, which are fractions of the range of each column; 65535 stands for no number.
  function unpacked({ low, span, data }) {
    const raw = new Uint16Array(Uint8Array.from(atob(data), c => c.charCodeAt(0)).buffer), columns = low.length;
    return Float64Array.from(raw, (n, i) => n === 65535 ? NaN : low[i % columns] + n / 65534 * span[i % columns]);
  }
  function element(name, attributes, words) {
    const one = document.createElementNS(SVG, name);
    for (const key in attributes) one.setAttribute(key, attributes[key]);
    if (words !== undefined) one.textContent = words;
    return one;
  }
  function digits(value) {
    if (Number.isNaN(value)) return "–";
    const size = Math.abs(value);
    return size && (size < 1e-3 || size >= 1e6) ? value.toExponential(2).replace("e+", "e") : String(Number(value.toPrecision(4)));
  }

  // Round numbers between two limits, about so many.
  function ticks(low, high, count) {
    const raw = (high - low) / count, power = 10 ** Math.floor(Math.log10(raw));
    const step = [1, 2, 5, 10].map(one => one * power).find(one => one >= raw * 0.999), found = [];
    if (!(step > 0)) return [low];
    for (let k = Math.ceil(low / step - 1e-6); k * step <= high + 1e-6 * step; k++) found.push(k * step);
    return found;
  }
  // Whole powers of ten, not too many.
  function decades(low, high) {
    const first = Math.ceil(low - 1e-6), last = Math.floor(high + 1e-6), step = Math.max(1, Math.ceil((last - first) / 5));
    const found = [];
    for (let k = first; k <= last; k += step) found.push(k);
    return found;
  }
  const SUPER = "⁰¹²³⁴⁵⁶⁷⁸⁹";
  const power = k => `10${k < 0 ? "⁻" : ""}${String(Math.abs(k)).replace(/\d/g, one => SUPER[one])}`;
  const tidy = (value, step) => String(Number(value.toFixed(Math.min(Math.max(0, 1 - Math.floor(Math.log10(step))), 20))));

  const across = value => LEFT + (value - data.start) / (data.end - data.start || 1) * (WIDTH - LEFT - RIGHT);
  function path(xy, up, closed) {
    let words = "", isDrawing = false;
    for (let i = 0; i < xy.length; i += 2) {
      if (Number.isNaN(xy[i + 1])) { isDrawing = false; continue; }
      words += `${isDrawing ? "L" : "M"}${across(xy[i]).toFixed(1)} ${up(xy[i + 1]).toFixed(1)}`;
      isDrawing = true;
    }
    return closed ? `${words}Z` : words;
  }

  function build(about, number) {
    const box = document.createElement("div"), title = document.createElement("p"), values = document.createElement("p");
    box.className = "panel";
    title.className = "title";
    title.textContent = about.title;
    values.className = "values";
    const picture = element("svg", { viewBox: `0 0 ${WIDTH} ${HEIGHT}`, role: "img", "aria-label": about.title });
    const span = about.high - about.low || 1, bottom = HEIGHT - BOTTOM;
    const up = value => bottom - (value - about.low) / span * (bottom - TOP);
    const clip = `clip-${number}`, inside = element("clipPath", { id: clip });
    inside.append(element("rect", { x: LEFT, y: TOP - 2, width: WIDTH - LEFT - RIGHT, height: bottom - TOP + 4 }));
    picture.append(inside);
    const drawn = element("g", { "clip-path": `url(#${clip})` });
    for (const { colour, alpha, xy } of about.areas)
      drawn.append(element("path", { d: path(unpacked(xy), up, true), fill: colour, "fill-opacity": alpha }));
    const lines = about.lines.map(({ name, colour, faint, xy }) => {
      const numbers = xy.data ? unpacked(xy) : xy;
      drawn.append(element("path", { d: path(numbers, up), fill: "none", stroke: colour, "stroke-width": faint ? 0.5 : 1.5, "stroke-opacity": faint ? 0.5 : 1 }));
      if (numbers.length < 60)
        for (let i = 0; i < numbers.length; i += 2)
          if (!Number.isNaN(numbers[i + 1])) drawn.append(element("circle", { cx: across(numbers[i]), cy: up(numbers[i + 1]), r: 1.6, fill: colour }));
      return { name, colour, faint, numbers };
    });
    picture.append(drawn);
    const ink = { stroke: "#66707a", "stroke-width": 0.8 };
    picture.append(element("path", { d: `M${LEFT} ${TOP}V${bottom}H${WIDTH - RIGHT}`, fill: "none", ...ink }));
    const heights = about.log ? decades(about.low, about.high) : ticks(about.low, about.high, 5);
    const step = Math.abs(heights[1] - heights[0]) || Math.abs(heights[0]) || 1;
    for (const value of heights) {
      const y = up(value);
      picture.append(element("line", { x1: LEFT - 3, x2: LEFT, y1: y, y2: y, ...ink }));
      picture.append(element("text", { x: LEFT - 6, y: y + 3.5, "text-anchor": "end", "font-size": 10.5, fill: "#33383d" }, about.log ? power(value) : tidy(value, step)));
    }
    const columns = ticks(data.start, data.end, 5), width = Math.abs(columns[1] - columns[0]) || 1;
    for (const value of columns) {
      const x = across(value);
      picture.append(element("line", { x1: x, x2: x, y1: bottom, y2: bottom + 3, ...ink }));
      picture.append(element("text", { x, y: bottom + 14, "text-anchor": "middle", "font-size": 10.5, fill: "#33383d" }, tidy(value, width)));
    }
    picture.append(element("text", { x: (LEFT + WIDTH - RIGHT) / 2, y: HEIGHT - 3, "text-anchor": "middle", "font-size": 10.5, fill: "#33383d" }, data.label));
    const cursor = element("line", { y1: TOP, y2: bottom, stroke: "#d00060", "stroke-width": 1, visibility: "hidden", class: "cursor" });
    picture.append(cursor);
    const position = event => {
      const seen = picture.getBoundingClientRect();
      const part = ((event.clientX - seen.left) / seen.width * WIDTH - LEFT) / (WIDTH - LEFT - RIGHT);
      return part < 0 || part > 1 ? null : data.start + part * (data.end - data.start);
    };
    picture.addEventListener("pointermove", event => { hovered = position(event); show(); });
    picture.addEventListener("pointerleave", () => { hovered = null; show(); });
    picture.addEventListener("click", event => {
      const wanted = position(event);
      if (wanted === null || !data.records.length) return;
      const away = data.records.map(one => Math.abs(one - wanted));
      choose(away.indexOf(Math.min(...away)));
    });
    box.append(title, values, picture);
    return { box, values, lines, about, cursor };
  }

  // The value of a line at a position of the axis: of the nearest point, as a path may go back.
  function valueAt(numbers, at) {
    let nearest = -1, least = Infinity;
    for (let i = 0; i < numbers.length; i += 2) {
      const away = Math.abs(numbers[i] - at);
      if (away < least) { least = away; nearest = i; }
    }
    return nearest < 0 ? NaN : numbers[nearest + 1];
  }

  function show() {
    if (!data) return;
    const at = hovered ?? (chosen === null ? null : data.records[chosen]) ?? null;
    for (const { values, lines, about, cursor } of added ? [added, ...panels] : panels) {
      cursor.setAttribute("visibility", at === null ? "hidden" : "visible");
      if (at !== null) { cursor.setAttribute("x1", across(at)); cursor.setAttribute("x2", across(at)); }
      values.replaceChildren();
      const add = (colour, words) => {
        const one = document.createElement("span"), dot = element("svg", { width: 10, height: 10 });
        dot.append(element("rect", { width: 9, height: 9, fill: colour }));
        one.append(dot, ` ${words}`);
        values.append(one, " ");
      };
      if (at !== null) values.append(`${digits(at)} `);
      for (const { name, colour, faint, numbers } of lines) if (!faint) {
        const value = at === null ? NaN : valueAt(numbers, at);
        add(colour, at === null ? name : `${name} ${digits(about.log ? 10 ** value : value)}`);
      }
      for (const { name, colour } of about.areas) if (name) add(colour, name);
    }
  }

  // A further panel before the others, with numbers of recorded states: pairs of the number of a state and a value.
  function extra(title, numbers) {
    if (added) added.box.remove();
    added = null;
    const known = data && title ? numbers.filter(([record, value]) => record in data.records && !Number.isNaN(value)) : [];
    if (known.length < 2) return;
    const xy = Float64Array.from(known.flatMap(([record, value]) => [data.records[record], value]));
    const values = known.map(one => one[1]), low = Math.min(...values), high = Math.max(...values), space = 0.05 * (high - low) || 1;
    added = build({ title, log: false, low: low - space, high: high + space, areas: [], lines: [{ name: "", colour: "#d00060", faint: false, xy }] }, "extra");
    added.box.id = "history";
    frame.prepend(added.box);
    show();
  }

  return {
    unpacked,
    ticks,
    extra,
    // Draw other data; `chooser` is called with the number of the state at which the user clicks.
    set(found, chooser) {
      data = found;
      choose = chooser || choose;
      panels = found.panels.map(build);
      frame.replaceChildren(...(added ? [added.box] : []), ...panels.map(one => one.box));
      frame.dataset.panels = panels.length;
      show();
    },
    // Put the cursor at a recorded state.
    at(record) { chosen = record; show(); },
  };
})();
if (document.getElementById("run-data")) {
  const found = JSON.parse(document.getElementById("run-data").textContent).curves;
  if (found) curves.set(found);
}
