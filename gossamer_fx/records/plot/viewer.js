// The view of a run that can be turned.  three.js draws it; its data are in the page, or come from `gossamer watch`.
"use strict";
(function () {
  const $ = id => document.getElementById(id);
  const canvas = $("view");
  if (!canvas) return; // a run with curves only
  const slider = $("time"), chooser = $("field"), component = $("component"), factor = $("factor"), cut = $("cut"), depth = $("depth");
  const given = JSON.parse($("run-data").textContent);
  let renderer;
  try {
    renderer = new THREE.WebGLRenderer({ canvas, antialias: true });
  } catch {
    $("viewer").textContent = "This browser has no WebGL; the pictures show the run.";
    return;
  }

  // ---- data ----
  const binary = text => Uint8Array.from(atob(text), c => c.charCodeAt(0)).buffer;

  const unpacked = curves.unpacked;

  async function ask(path, method = "GET") {
    const answer = await fetch(path, { method, cache: "no-store" });
    if (!answer.ok) throw new Error(`the server answers ${answer.status}`);
    const data = await answer.json();
    if (data.message) throw new Error(data.message);
    return data;
  }

  let header, version = 0, coloured = 0, drawn = 0; // states that the scales of colours have, and rows of the curves
  let legends = new Map(), states = new Map();
  const MOST_STATES = 100; // in memory; a report has no more than 80

  async function legendOf(field) {
    if (!legends.has(field)) legends.set(field, given.legends ? given.legends[field] : await ask(`legend/${version}/${field}`));
    return legends.get(field);
  }
  async function stateOf(record, field) {
    const key = given.states ? record : `${record}/${field}`;
    if (!states.has(key)) {
      const packed = given.states ? given.states[record] : await ask(`state/${version}/${key}`);
      const state = { mesh: packed.mesh, moved: packed.moved.map(unpacked), values: {} };
      if (states.size >= MOST_STATES) states.delete(states.keys().next().value);
      states.set(key, state);
      state.packed = packed.values;
    }
    const state = states.get(key);
    for (const one of [field, header.stateField])
      state.values[one] ||= (state.packed[one] || []).map(packed => packed && { numbers: unpacked(packed), atPoints: packed.atPoints });
    return state;
  }

  // ---- scene ----
  const scene = new THREE.Scene(), camera = new THREE.OrthographicCamera();
  camera.up.set(0, 0, 1);
  const controls = new THREE.OrbitControls(camera, canvas);
  // A surface that faces the eye has the colour of the bar, others are darker.
  const light = new THREE.DirectionalLight(0xffffff, 0.45 * Math.PI);
  camera.add(light, light.target);
  light.position.set(0, 0, 1);
  light.target.position.set(0, 0, 0);
  scene.add(camera, new THREE.AmbientLight(0xffffff, 0.55 * Math.PI));
  renderer.setClearColor(0xffffff);
  // Three rows of colours: by value, of what has no value, and by value for film that is slack.
  const table = new THREE.DataTexture(new Uint8Array(12), 1, 3);
  table.colorSpace = THREE.SRGBColorSpace;
  const COLOURED = 1 / 6, BLANK = 3 / 6, SLACK = 5 / 6, INK = [76, 84, 94];
  function film(Material) {
    const material = new Material({ map: table, side: THREE.DoubleSide, polygonOffset: true, polygonOffsetFactor: 1, polygonOffsetUnits: 2 });
    // White and black lines of the image, not of the film.
    material.onBeforeCompile = shader => {
      shader.fragmentShader = shader.fragmentShader.replace("#include <map_fragment>", `#include <map_fragment>
        float stripe = mod(floor(gl_FragCoord.x) + floor(gl_FragCoord.y), 16.0);
        if (vMapUv.y > 0.7 && stripe < 4.0) diffuseColor.rgb = vec3(stripe < 2.0 ? 1.0 : 0.0);`);
    };
    return material;
  }
  const lit = film(THREE.MeshLambertMaterial), plain = film(THREE.MeshBasicMaterial);
  const thin = new THREE.LineMaterial({ linewidth: 0.7, color: 0x33383d });
  const stroke = new THREE.LineMaterial({ linewidth: 2, vertexColors: true });
  const dot = new THREE.PointsMaterial({ size: 8, sizeAttenuation: false, color: new THREE.Color().setRGB(...INK.map(c => c / 255), THREE.SRGBColorSpace) });
  const mark = new THREE.Points(new THREE.BufferGeometry(), new THREE.PointsMaterial({ size: 11, sizeAttenuation: false, color: 0xd00060, depthTest: false }));
  mark.renderOrder = 1;
  mark.frustumCulled = false;
  mark.visible = false;
  // The largest and the least value of what is shown.
  const extremes = [0xd62020, 0x2050d0].map(color => {
    const one = new THREE.Points(new THREE.BufferGeometry(), new THREE.PointsMaterial({ size: 10, sizeAttenuation: false, color, depthTest: false }));
    one.renderOrder = 1;
    one.frustumCulled = one.visible = false;
    return one;
  });
  scene.add(mark, ...extremes);

  let parts = [], mesh = -1, legend = null, centre = null, picked = null;
  const hidden = new Set();

  function build(number) {
    for (const part of parts) {
      scene.remove(part.object);
      part.object.geometry.dispose();
      if (part.edges) part.edges.geometry.dispose();
    }
    mesh = number;
    parts = header.meshes[number].map(about => {
      const part = { name: about.name, corners: about.corners, pieces: new Uint32Array(binary(about.pieces)),
        start: Float64Array.from(new Float32Array(binary(about.start)), (value, i) => about.origin[i % 3] + value),
        X: about.X && new Float64Array(binary(about.X)) };
      part.x = part.start.slice();
      const geometry = new THREE.BufferGeometry();
      if (!part.pieces.length) part.object = new THREE.Points(geometry, dot);
      else if (part.corners === 2) part.object = new THREE.LineSegments2(new THREE.LineSegmentsGeometry(), stroke);
      else {
        for (const [name, size] of [["position", 3], ["normal", 3], ["uv", 2]])
          geometry.setAttribute(name, new THREE.BufferAttribute(new Float32Array(size * part.pieces.length), size));
        part.object = new THREE.Mesh(geometry, lit);
      }
      part.object.frustumCulled = false;
      part.object.visible = !hidden.has(part.name);
      scene.add(part.object);
      if (part.corners === 3 && part.pieces.length) {
        part.edges = new THREE.LineSegments2(new THREE.LineSegmentsGeometry(), thin);
        part.edges.frustumCulled = false;
        part.edges.raycast = () => {}; // the film below is picked
        part.object.add(part.edges);
      }
      return part;
    });
    const boxes = parts.map(part => {
      const box = Object.assign(document.createElement("input"), { type: "checkbox", checked: part.object.visible });
      box.onchange = () => {
        part.object.visible = box.checked;
        hidden[box.checked ? "delete" : "add"](part.name);
        if (!box.checked && picked && picked.name === part.name) { picked = null; attempt(history); }
        tell();
        findExtremes();
        draw();
      };
      const label = document.createElement("label");
      label.append(box, ` ${part.name}`);
      return label;
    });
    $("parts").replaceChildren(...(parts.length > 1 ? boxes : []));
  }

  // Row of the table of colours for the value of a piece or at a point of it, in [0, 1]; NaN where there is none.
  function row(values, piece, point) {
    if (!values || !legend) return NaN;
    const value = values.numbers[values.atPoints ? point : piece], rows = legend.table.length - 1;
    if (!legend.smooth) return (Math.round(value) % rows + 0.5) / rows;
    return (along(value) * (rows - 1) + 0.5) / rows;
  }

  // The ends of the bar: those of the field, unless the user has given others, in the unit of the legend.
  function range() {
    const given = one => $(one).value === "" ? NaN : Number($(one).value) * legend.factor;
    const low = given("low"), high = given("high");
    return [Number.isNaN(low) ? legend.low : low, Number.isNaN(high) ? legend.high : high];
  }
  // Position of a value on the bar, from 0 to 1.
  function along(value) {
    let [low, high] = range();
    if ($("log").checked && high > 0) {
      low = Math.log10(Math.max(low, 1e-4 * high));
      value = Math.log10(Math.max(value, 10 ** low));
      high = Math.log10(high);
    }
    return high > low ? Math.min(Math.max((value - low) / (high - low), 0), 1) : 0;
  }

  function place(part, moved) {
    const by = Number(factor.value) || 0;
    for (let i = 0; i < part.x.length; i++) part.x[i] = part.start[i] + by * moved[i];
  }
  // The lowest and the highest coordinates of what is shown [m].
  function box() {
    const low = [Infinity, Infinity, Infinity], high = [-Infinity, -Infinity, -Infinity];
    for (const { x, object } of parts) if (object.visible) for (let i = 0; i < x.length; i++) {
      low[i % 3] = Math.min(low[i % 3], x[i]);
      high[i % 3] = Math.max(high[i % 3], x[i]);
    }
    return low[0] <= high[0] ? [low, high] : [[-1, -1, -1], [1, 1, 1]];
  }

  function fill(part, values, states) {
    const { pieces, x, object } = part, at = Float64Array.from(x, (value, i) => value - centre[i % 3]);
    if (!pieces.length) {
      object.geometry.setAttribute("position", new THREE.BufferAttribute(Float32Array.from(at), 3));
      object.geometry.computeBoundingSphere();
    } else if (part.corners === 2) {
      const positions = new Float32Array(3 * pieces.length), colours = new Float32Array(3 * pieces.length), colour = new THREE.Color();
      for (let i = 0; i < pieces.length; i++) {
        for (let k = 0; k < 3; k++) positions[3 * i + k] = at[3 * pieces[i] + k];
        const found = legend && legend.onLines ? row(values, i >> 1, pieces[i]) : NaN;
        const rgb = found >= 0 ? legend.table[Math.floor(found * (legend.table.length - 1))] : INK;
        colour.setRGB(...rgb.map(c => c / 255), THREE.SRGBColorSpace).toArray(colours, 3 * i);
      }
      object.geometry.dispose();
      object.geometry = new THREE.LineSegmentsGeometry();
      object.geometry.setPositions(positions);
      object.geometry.setColors(colours);
    } else {
      const normals = new Float64Array(at.length), { position, normal, uv } = object.geometry.attributes;
      for (let i = 0; i < pieces.length; i += 3) {
        const [a, b, c] = [3 * pieces[i], 3 * pieces[i + 1], 3 * pieces[i + 2]];
        const u = [0, 1, 2].map(k => at[b + k] - at[a + k]), v = [0, 1, 2].map(k => at[c + k] - at[a + k]);
        const n = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
        for (const corner of [a, b, c]) for (let k = 0; k < 3; k++) normals[corner + k] += n[k];
      }
      for (let i = 0; i < pieces.length; i++) {
        const p = 3 * pieces[i], size = Math.hypot(normals[p], normals[p + 1], normals[p + 2]) || 1;
        for (let k = 0; k < 3; k++) {
          position.array[3 * i + k] = at[p + k];
          normal.array[3 * i + k] = normals[p + k] / size;
        }
        const piece = Math.floor(i / 3), found = row(values, piece, pieces[i]);
        const isSlack = legend && legend.hasSlack && states && Math.round(states.numbers[piece]) === header.slack;
        uv.array[2 * i] = found >= 0 ? found : 0.5;
        uv.array[2 * i + 1] = !(found >= 0) ? BLANK : isSlack ? SLACK : COLOURED;
      }
      position.needsUpdate = normal.needsUpdate = uv.needsUpdate = true;
      object.geometry.computeBoundingSphere();
      object.material = legend && legend.smooth && part.X && !$("light").checked ? plain : lit;
      part.edges.visible = $("edges").checked;
      if (part.edges.visible) {
        const ends = new Float32Array(6 * pieces.length);
        for (let i = 0; i < pieces.length; i++) {
          const next = i % 3 === 2 ? i - 2 : i + 1;
          for (let k = 0; k < 3; k++) {
            ends[6 * i + k] = at[3 * pieces[i] + k];
            ends[6 * i + 3 + k] = at[3 * pieces[next] + k];
          }
        }
        part.edges.geometry.dispose();
        part.edges.geometry = new THREE.LineSegmentsGeometry();
        part.edges.geometry.setPositions(ends);
      }
    }
  }

  // The number of the field that is shown: of a vector that of its length or of a component.
  const fieldNow = () => Number(component.hidden ? chooser.value : component.value);
  // What can be shown of the chosen field, if it is a vector; another one keeps the axis.
  function listComponents() {
    const found = header.components[chooser.value] || [], before = component.selectedIndex;
    component.replaceChildren(...found.map(([name, number]) => new Option(name, number)));
    component.hidden = !found.length;
    if (found.length) component.selectedIndex = Math.max(before, 0);
  }

  let shown = null; // the state on the screen
  async function show() {
    const record = Number(slider.value), field = fieldNow();
    if (!header || !header.labels.length) return;
    const [state, colours] = [await stateOf(record, field), header.fields.length ? await legendOf(field) : null];
    if (record !== Number(slider.value) || field !== fieldNow()) return; // another one was asked for
    if (colours !== legend) { legend = colours; explain(); }
    const isFirst = !centre;
    if (state.mesh !== mesh) build(state.mesh);
    parts.forEach((part, i) => place(part, state.moved[i]));
    if (isFirst || $("follow").checked) {
      const [low, high] = box();
      centre = low.map((value, k) => (value + high[k]) / 2);
    }
    shown = { record, values: state.values[field] || [] };
    const states = state.values[header.stateField] || [];
    parts.forEach((part, i) => fill(part, shown.values[i], states[i]));
    $("time-label").textContent = header.labels[record];
    Object.assign(canvas.dataset, { record, field: header.fields[field] || "" });
    curves.at(record);
    findExtremes();
    if (isFirst) home();
    tell();
    draw();
  }

  function draw() {
    const [wide, high] = [canvas.clientWidth, canvas.clientHeight], half = camera.top;
    renderer.setPixelRatio(window.devicePixelRatio || 1);
    renderer.setSize(wide, high, false);
    camera.right = half * wide / high;
    camera.left = -camera.right;
    camera.updateProjectionMatrix();
    renderer.clippingPlanes = plane ? [plane()] : [];
    renderer.render(scene, camera);
    overlay();
    canvas.dataset.drawn = `${renderer.info.render.triangles} ${renderer.info.render.calls}`;
  }

  // ---- what is drawn over the picture: axes, scale bar, colours with numbers, time ----
  const SVG_INK = "#33383d";
  function overlay() {
    const sheet = $("overlay"), ratio = window.devicePixelRatio || 1;
    sheet.width = canvas.clientWidth * ratio;
    sheet.height = canvas.clientHeight * ratio;
    const pen = sheet.getContext("2d");
    pen.scale(ratio, ratio);
    pen.font = "12px system-ui, sans-serif";
    pen.fillStyle = pen.strokeStyle = SVG_INK;
    const [wide, high] = [canvas.clientWidth, canvas.clientHeight];
    // The axes of space, each as long as it is seen.
    const [x0, y0] = [36, high - 36];
    const axes = [0, 1, 2].map(k => new THREE.Vector3(...[0, 1, 2].map(i => Number(i === k))).applyQuaternion(camera.quaternion.clone().invert()));
    for (const k of [0, 1, 2].sort((i, j) => axes[i].z - axes[j].z)) {
      const [x, y] = [x0 + 26 * axes[k].x, y0 - 26 * axes[k].y];
      pen.strokeStyle = ["#c02020", "#208020", "#2040c0"][k];
      pen.lineWidth = 2;
      pen.beginPath();
      pen.moveTo(x0, y0);
      pen.lineTo(x, y);
      pen.stroke();
      pen.fillText("xyz"[k], x + 4 * Math.sign(x - x0) - 3, y + (y > y0 ? 12 : -3));
    }
    // A round length.
    const scale = high / (camera.top - camera.bottom) * camera.zoom, longest = 0.25 * wide / scale;
    const power = 10 ** Math.floor(Math.log10(longest)), length = [5, 2, 1].find(one => one * power <= longest) * power;
    const right = wide - 14, bottom = high - 14;
    pen.strokeStyle = SVG_INK;
    pen.beginPath();
    pen.moveTo(right - length * scale, bottom);
    pen.lineTo(right, bottom);
    pen.stroke();
    const time = header.labels[Number(canvas.dataset.record)] || "";
    const isTight = legend && legend.smooth && pen.measureText(time + legend.name + legend.unit).width > wide - 60;
    pen.fillText(time, 14, isTight ? 36 : 18);
    pen.textAlign = "right";
    const [unit, name] = [[1e3, "km"], [1, "m"], [1e-2, "cm"], [1e-3, "mm"]].find(one => length >= one[0] * 0.999) || [1e-6, "µm"];
    pen.fillText(`${digits(length / unit, 3)} ${name}`, right, bottom - 5);
    if (!legend || !legend.smooth) return;
    const [low, top] = range(), left = wide - 30, from = 34, until = Math.min(high - 60, from + 180);
    const colours = legend.table.slice(0, -1);
    for (let y = from; y < until; y++) {
      pen.fillStyle = `rgb(${colours[Math.round((until - 1 - y) / (until - 1 - from) * (colours.length - 1))]})`;
      pen.fillRect(left, y, 14, 1.5);
    }
    pen.fillStyle = SVG_INK;
    const ticks = $("log").checked ? [] : curves.ticks(low / legend.factor, top / legend.factor, 4);
    const ends = [low, top].map(one => one / legend.factor);
    const numbers = [...ends, ...ticks.filter(one => ends.every(end => Math.abs(along(one * legend.factor) - along(end * legend.factor)) > 0.1))];
    for (const value of numbers) {
      const y = until - along(value * legend.factor) * (until - from);
      pen.fillRect(left - 4, y - 0.5, 4, 1);
      pen.fillText(digits(value, 4), left - 6, y + 4);
    }
    pen.fillText(`${legend.name}${legend.unit ? ` [${legend.unit}]` : ""}`, wide - 14, 18);
  }

  // Points of the largest and the least value of the field, at which marks are.
  function findExtremes() {
    const found = [null, null];
    if ($("extremes").checked && legend && legend.smooth && shown) parts.forEach((part, i) => {
      const values = shown.values[i];
      if (!values || !part.object.visible) return;
      values.numbers.forEach((value, n) => {
        if (Number.isNaN(value)) return;
        const point = values.atPoints ? n : part.pieces[part.corners * n];
        if (!found[0] || value > found[0].value) found[0] = { value, part, point };
        if (!found[1] || value < found[1].value) found[1] = { value, part, point };
      });
    });
    const words = [];
    extremes.forEach((one, k) => {
      one.visible = Boolean(found[k]);
      if (!found[k]) return;
      const { value, part, point } = found[k];
      const at = [0, 1, 2].map(i => part.x[3 * point + i] - centre[i]);
      one.geometry.setAttribute("position", new THREE.BufferAttribute(Float32Array.from(at), 3));
      words.push(`${["Largest", "Least"][k]}: ${digits(value / legend.factor)} ${legend.unit} at ${triple(part.x, point)} m of ${part.name}`);
    });
    $("extreme-words").textContent = words.join("\n");
  }

  // The value of the picked point, or its height, in all states: a curve next to the others.  It is drawn while it is read,
  // and goes on where the run has grown.
  let asked = 0, trace = { key: "", values: [], isField: false };
  async function history() {
    const turn = ++asked;
    if (!picked || !header || header.labels.length < 2) { curves.extra(null); return; }
    const part = header.meshes[mesh].findIndex(one => one.name === picked.name), field = fieldNow();
    if (part < 0) { curves.extra(null); return; }
    const words = [version, field, mesh, part, picked.piece, picked.point].join("/");
    if (trace.key !== words) {
      trace = { key: words, values: [], isField: false };
      curves.extra(null);
    }
    while (trace.values.length < header.labels.length) {
      const first = trace.values.length;
      const more = given.states ? await valueInPage(first, field, part) : await ask(`history/${words}/${first}`);
      if (turn !== asked) return; // another point was picked
      trace.values.push(...more.values.map(one => one ?? NaN));
      trace.isField ||= more.isField;
      if (!given.states || trace.values.length === header.labels.length) drawHistory();
    }
  }
  async function valueInPage(record, field, part) {
    const state = await stateOf(record, field);
    if (state.mesh !== mesh) return { values: [NaN], isField: false };
    const values = (state.values[field] || [])[part];
    if (values) return { values: [values.numbers[values.atPoints ? picked.point : picked.piece]], isField: true };
    const height = 3 * picked.point + 2;
    return { values: [parts[part].start[height] + state.moved[part][height]], isField: false };
  }
  function drawHistory() {
    const isField = trace.isField && legend, scale = isField && legend.smooth ? legend.factor : 1;
    const unit = isField && legend.unit ? ` [${legend.unit}]` : "";
    const title = isField ? `${legend.name}${unit} at the point of ${picked.name}` : `z [m] of ${picked.name}`;
    curves.extra(title, trace.values.map((value, record) => [record, value / scale]));
  }

  // Look along an axis, from a side.
  function look(words) {
    home(...{ iso: [-25, 25], x: [90, 0], y: [0, 0], z: [0, 90] }[words]);
    draw();
  }

  // Look at all of what is shown, and at where it started unless the view moves along.
  function home(turn = -25, rise = 25) {
    const [azimuth, elevation] = [turn, rise].map(degrees => degrees * Math.PI / 180);
    const [ca, sa, ce, se] = [Math.cos(azimuth), Math.sin(azimuth), Math.cos(elevation), Math.sin(elevation)];
    const right = [ca, sa, 0], up = [-sa * se, ca * se, ce], eye = [sa * ce, -ca * ce, se];
    const low = [Infinity, Infinity, Infinity], high = [-Infinity, -Infinity, -Infinity];
    const seen = parts.filter(part => part.object.visible).flatMap(part => $("follow").checked ? [part.x] : [part.x, part.start]);
    for (const x of seen) for (let i = 0; i < x.length; i += 3)
      [right, up, eye].forEach((axis, k) => {
        const along = axis[0] * (x[i] - centre[0]) + axis[1] * (x[i + 1] - centre[1]) + axis[2] * (x[i + 2] - centre[2]);
        low[k] = Math.min(low[k], along);
        high[k] = Math.max(high[k], along);
      });
    if (!(low[0] <= high[0])) return;
    const size = high.map((value, k) => value - low[k]), middle = high.map((value, k) => (value + low[k]) / 2);
    const whole = Math.hypot(...size) || 1;
    camera.zoom = 1;
    camera.top = 0.55 * Math.max(size[1], size[0] * canvas.clientHeight / canvas.clientWidth, 1e-3 * whole);
    camera.bottom = -camera.top;
    camera.near = 0;
    camera.far = 200 * whole; // what moves stays in view
    const target = [0, 1, 2].map(k => middle[0] * right[k] + middle[1] * up[k] + middle[2] * eye[k]);
    controls.target.set(...target);
    // Seen from above, y is up.
    camera.up.set(...(rise === 90 ? [0, 1, 0] : [0, 0, 1]));
    camera.position.set(...target.map((value, k) => value + 100 * whole * eye[k]));
    controls.update();
  }

  // ---- plane that cuts ----
  let plane = null;
  function setPlane() {
    depth.hidden = !cut.value;
    plane = null;
    if (cut.value && parts.length) {
      const axis = "xyz".indexOf(cut.value[0]), sign = cut.value[1] === ">" ? 1 : -1, [low, high] = box();
      const size = high[axis] - low[axis], at = low[axis] + depth.value / 1000 * size;
      $("depth-label").textContent = `${digits(rounded(at, size), 4)} m`;
      plane = () => new THREE.Plane(new THREE.Vector3(...[0, 1, 2].map(k => k === axis ? sign : 0)), -sign * (at - centre[axis]));
    } else $("depth-label").textContent = "";
    draw();
  }

  // ---- picking ----
  function pick(event) {
    const frame = canvas.getBoundingClientRect(), ray = new THREE.Raycaster();
    const pointer = new THREE.Vector2(2 * (event.clientX - frame.left) / frame.width - 1, 1 - 2 * (event.clientY - frame.top) / frame.height);
    ray.params.Line2 = { threshold: 8 };
    ray.params.Points = { threshold: 8 * (camera.top - camera.bottom) / camera.zoom / canvas.clientHeight };
    ray.setFromCamera(pointer, camera);
    const seen = parts.filter(part => part.object.visible), cutting = plane && plane();
    const [hit] = ray.intersectObjects(seen.map(part => part.object)).filter(one => !cutting || cutting.distanceToPoint(one.point) >= 0);
    picked = null;
    if (hit) {
      const part = parts.find(one => one.object === hit.object);
      picked = { name: part.name, piece: hit.faceIndex || 0, point: 0 };
      // The corner of the piece that is nearest to the ray.
      let nearest = Infinity;
      for (let i = 0; i < part.corners && part.pieces.length; i++) {
        const point = part.pieces[part.corners * picked.piece + i];
        const away = ray.ray.distanceToPoint(new THREE.Vector3(...[0, 1, 2].map(k => part.x[3 * point + k] - centre[k])));
        if (away < nearest) { nearest = away; picked.point = point; }
      }
    }
    tell();
    attempt(history);
    draw();
  }

  // What is below the resolution of numbers of 16 bits is zero.
  const rounded = (value, range) => Math.abs(value) < range / 65534 ? 0 : value;
  const digits = (value, count = 5) => String(Number(value.toPrecision(count)));
  const triple = (array, point, count) => `(${[0, 1, 2].map(k => digits(array[3 * point + k], count)).join(", ")})`;

  // Words about the point that was picked, at the time that is shown.
  function tell() {
    const index = picked ? parts.findIndex(part => part.name === picked.name) : -1;
    mark.visible = index >= 0 && parts[index].object.visible && 3 * picked.point < parts[index].x.length;
    $("copying").hidden = !(mark.visible && parts[index].X);
    if (!mark.visible) {
      if (picked === null) $("picked").textContent = "Click on a point for its values. Drag to turn, shift-drag to move, wheel to zoom.";
      return;
    }
    const part = parts[index], values = shown.values[index];
    const at = [0, 1, 2].map(k => part.x[3 * picked.point + k] - centre[k]);
    mark.geometry.setAttribute("position", new THREE.BufferAttribute(Float32Array.from(at), 3));
    const lines = [`${part.name}: at ${triple(part.x, picked.point)} m`];
    if (values && legend) {
      const value = values.numbers[values.atPoints ? picked.point : picked.piece];
      const kind = legend.names.find(one => !legend.smooth && one[1] === Math.round(value) % (legend.table.length - 1));
      if (kind) lines.push(`${legend.name}: ${kind[0]}`);
      else if (legend.smooth) lines.push(`${legend.name}: ${Number.isNaN(value) ? "none" : `${digits(rounded(value, legend.high - legend.low) / legend.factor)} ${legend.unit}`}`);
    }
    if (part.X) {
      const point = triple(part.X, picked.point, 10), name = part.name.replace(/\W+/g, "_").replace(/^(?=\d)/, "_");
      lines.push(`Point of the mesh: ${point} m`);
      $("probe").value = `"${part.name.replace(/["\\]/g, "\\$&")} ${triple(part.X, picked.point, 4)} z [m]": gx.probes.Displacement(${name}.port_at(${point}), "z"),`;
    }
    $("picked").textContent = lines.join("\n");
  }

  // ---- key of the colours ----
  function explain() {
    $("legend").replaceChildren();
    if (!legend) return;
    const colours = legend.table.slice(0, -1), missing = legend.table.at(-1);
    const rgba = [colours, colours.map(() => missing), colours].flat().flatMap(colour => [...colour, 255]);
    table.dispose();
    table.image = { data: Uint8Array.from(rgba), width: colours.length, height: 3 };
    table.needsUpdate = true;
    const add = (kind, background, words) => {
      const one = document.createElement(kind);
      one.style.background = background;
      $("legend").append(one, words);
    };
    for (const [name, kind] of legend.names) add("i", `rgb(${colours[kind]})`, ` ${name}  `);
    $("range").hidden = !legend.smooth;
    if (legend.smooth && legend.beyond) $("legend").append(`(${legend.beyond})  `);
    if (legend.hasSlack) add("i", "repeating-linear-gradient(135deg, #fff 0 2px, #000 2px 4px)", " slack  ");
    if (legend.hasMissing) add("i", `rgb(${missing})`, " no value");
  }

  // ---- the user ----
  let isPlaying = false;
  async function play() {
    isPlaying = !isPlaying;
    $("play").textContent = isPlaying ? "Pause" : "Play";
    while (isPlaying) {
      const began = performance.now();
      slider.value = Number(slider.value) >= Number(slider.max) ? 0 : Number(slider.value) + 1;
      await attempt(show);
      const pause = FRAME / (Number($("speed").value) || 1);
      await wait(pause - performance.now() + began);
    }
  }
  async function attempt(action) {
    try {
      await action();
    } catch (error) {
      if ($("status")) $("status").textContent = `${error.message}`;
      else throw error;
    }
  }
  const showNow = () => attempt(show);
  function goTo(record) {
    if (record > Number(slider.max)) return;
    slider.value = record;
    showNow();
  }
  $("speed").append(...[0.25, 0.5, 1, 2, 4].map(one => new Option(`× ${one}`, one, one === 1, one === 1)));
  $("play").onclick = play;
  slider.oninput = showNow;
  chooser.onchange = component.onchange = event => {
    if (event.target === chooser) listComponents();
    for (const one of ["low", "high"]) $(one).value = "";
    $("log").checked = false;
    attempt(show).then(() => attempt(history));
  };
  for (const one of ["low", "high", "log", "light", "edges", "extremes"]) $(one).oninput = showNow;
  for (const one of ["iso", "x", "y", "z"]) $(`look-${one}`).onclick = () => look(one);
  // The view with what is drawn over it, in the size of a sheet; film and picture are the same.
  function copyTo(sheet) {
    draw(); // the browser forgets the picture when it has shown it
    const pen = sheet.getContext("2d");
    pen.fillStyle = "#fff";
    pen.fillRect(0, 0, sheet.width, sheet.height);
    for (const layer of [canvas, $("overlay")]) pen.drawImage(layer, 0, 0, sheet.width, sheet.height);
  }
  const newSheet = () => Object.assign(document.createElement("canvas"), { width: canvas.width, height: canvas.height });
  function save(blob, words, ending) {
    const name = words.replace(/[^\w.=-]+/g, "_").replace(/^_|_$/g, "");
    const link = Object.assign(document.createElement("a"), { href: URL.createObjectURL(blob), download: `${name || "view"}.${ending}` });
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 1000);
  }
  $("picture").onclick = () => {
    const sheet = newSheet();
    copyTo(sheet);
    sheet.toBlob(blob => save(blob, `${document.title} ${header.labels[Number(slider.value)] || ""}`, "png"));
  };

  // ---- film: all states from the first to the last, at the chosen speed ----
  const FRAME = 80, MOST_FRAMES = 250; // pause of a frame [ms] at speed 1, and 20 s
  const kind = ["video/webm;codecs=vp9", "video/webm", "video/mp4"].find(one => window.MediaRecorder && MediaRecorder.isTypeSupported(one));
  const wait = pause => new Promise(done => setTimeout(done, Math.max(pause, 0)));
  let isFilming = false;
  async function saveFilm() {
    if (isFilming) { isFilming = false; return; } // the second click ends it
    if (isPlaying) await play();
    isFilming = true;
    $("film").textContent = "End film";
    const sheet = newSheet(), last = Number(slider.max), frames = Math.min(last + 1, MOST_FRAMES), found = [], before = slider.value;
    copyTo(sheet);
    const recorder = new MediaRecorder(sheet.captureStream(), { mimeType: kind, videoBitsPerSecond: 8e6 });
    recorder.ondataavailable = event => found.push(event.data);
    const hasStopped = new Promise(done => { recorder.onstop = done; });
    const pause = FRAME / (Number($("speed").value) || 1);
    try {
      for (let frame = 0; frame < frames && isFilming; frame++) {
        const began = performance.now();
        slider.value = Math.round(frame * last / (frames - 1));
        await show();
        copyTo(sheet);
        if (!frame) recorder.start();
        await wait(pause - performance.now() + began);
      }
      await wait(500); // the last one is seen, too, where drawing is slow
      if (recorder.state === "recording") {
        recorder.stop();
        await hasStopped;
        save(new Blob(found, { type: kind }), document.title, kind.slice(6).split(";")[0]);
      }
    } finally {
      isFilming = false;
      $("film").textContent = "Save film";
    }
    slider.value = before;
    await show();
  }
  $("film").onclick = () => attempt(saveFilm);
  factor.oninput = $("follow").onchange = showNow;
  cut.append(...["", "x <", "x >", "y <", "y >", "z <", "z >"].map(words => new Option(words ? `keep ${words}` : "none", words.replace(" ", ""))));
  cut.onchange = depth.oninput = setPlane;
  $("home").onclick = canvas.ondblclick = () => { home(); draw(); };
  $("copy").onclick = () => {
    $("probe").select();
    document.execCommand("copy"); // the newer interface is shut in a frame of a notebook
    $("copy").textContent = "Copied";
  };
  canvas.onkeydown = event => { if (event.key === " ") { event.preventDefault(); play(); } };
  let pressed = [0, 0];
  canvas.addEventListener("pointerdown", event => { pressed = [event.clientX, event.clientY]; $("copy").textContent = "Copy probe"; });
  canvas.addEventListener("pointerup", event => {
    if (Math.hypot(event.clientX - pressed[0], event.clientY - pressed[1]) < 5 && shown) pick(event);
  });
  controls.addEventListener("change", draw);
  new ResizeObserver(() => { if (shown) draw(); }).observe(canvas);

  function setHeader(found) {
    header = found;
    const field = chooser.value, partial = new Set(Object.values(header.components).flatMap(found => found.slice(1).map(one => one[1])));
    chooser.replaceChildren(...header.fields.map((name, i) => new Option(name, i)).filter((_, i) => !partial.has(i)));
    chooser.value = header.fields[field] ? field : 0;
    listComponents();
    if (mesh < 0) $("follow").checked = header.follows;
    mesh = -1;
  }
  function setLabels(labels) {
    const wasLast = Number(slider.value) >= Number(slider.max);
    header.labels = labels;
    slider.max = Math.max(labels.length - 1, 0);
    slider.hidden = $("play").hidden = labels.length < 2;
    $("film").hidden = labels.length < 2 || !kind;
    if (wasLast && !isPlaying && !isFilming) slider.value = slider.max;
  }

  // ---- a run that is computing ----
  async function follow() {
    const news = await ask("progress");
    $("title").textContent = document.title = news.title;
    $("status").textContent = news.status;
    $("status").className = news.kind;
    $("stop").hidden = !news.canStop;
    if (!news.version) return;
    if (news.version !== version) {
      const found = await ask(`header/${news.version}`);
      version = news.version;
      states = new Map();
      setHeader(found);
    }
    const count = header.labels.length, isNew = mesh < 0 || news.legends !== coloured;
    if (isNew) legends = new Map();
    coloured = news.legends;
    setLabels(news.labels);
    if (isNew || news.labels.length !== count) await show();
    if (picked && (isNew || news.labels.length !== count)) attempt(history);
    if (news.curves && news.curves !== drawn) {
      curves.set(await ask(`curves/${news.curves}`), goTo);
      drawn = news.curves;
    }
  }
  async function poll() {
    await attempt(follow);
    setTimeout(poll, version ? 1000 : 250); // the first record is shown at once
  }

  // The first click asks whether it is meant, and the second one stops the run.
  if ($("stop")) {
    const words = $("stop").textContent;
    let isSure = false;
    $("stop").onclick = () => attempt(async () => {
      if (!isSure) {
        isSure = true;
        $("stop").textContent = "Stop? It ends with its step, and can go on later";
        setTimeout(() => { isSure = false; $("stop").textContent = words; }, 4000);
        return;
      }
      await ask("stop", "POST");
      $("stop").hidden = true;
    });
  }

  if (given.curves) curves.set(given.curves, goTo);
  if (given.header) {
    setHeader(given.header);
    setLabels(header.labels);
    attempt(show);
  } else poll();
})();
