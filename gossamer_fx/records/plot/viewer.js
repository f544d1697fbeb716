// A turnable view of a run: drag to turn, shift-drag to move, wheel to zoom, space to play.
"use strict";
(function () {
  const bytes = text => Uint8Array.from(atob(text), c => c.charCodeAt(0));
  const data = JSON.parse(document.getElementById("run-data").textContent);
  const canvas = document.getElementById("view"), slider = document.getElementById("time");
  const label = document.getElementById("time-label"), chooser = document.getElementById("field");
  const button = document.getElementById("play"), legend = document.getElementById("legend");
  const gl = canvas.getContext("webgl", { antialias: true });
  if (!gl) {
    document.getElementById("viewer").textContent = "This browser has no WebGL; the pictures below show the run.";
    return;
  }

  // ---- the run: positions are 16-bit parts of the box around everything, colours are rows of a table ----
  const parts = data.parts.map(part => ({
    triangles: new Uint32Array(bytes(part.triangles).buffer),
    lines: new Uint32Array(bytes(part.lines).buffer),
    positions: new Uint16Array(bytes(part.positions).buffer),
    kinds: part.kinds.map(bytes),
    first: part.first, frames: part.frames, vertices: part.vertices,
  }));
  const middle = data.low.map((low, i) => low + data.span[i] / 2);
  const radius = Math.hypot(...data.span) / 2 || 1;

  function positions(frame) {
    const part = parts.find(p => frame < p.first + p.frames), n = 3 * part.vertices;
    const whole = part.positions.subarray((frame - part.first) * n, (frame - part.first + 1) * n);
    const x = new Float32Array(n);
    for (let i = 0; i < n; i++) x[i] = (data.low[i % 3] + whole[i] / 65535 * data.span[i % 3] - middle[i % 3]) / radius;
    return [part, x];
  }

  // Corners one after the other: position, normal, colour.
  function mesh(frame, field) {
    const [part, x] = positions(frame), t = part.triangles, normals = new Float32Array(x.length);
    for (let i = 0; i < t.length; i += 3) {
      const [a, b, c] = [3 * t[i], 3 * t[i + 1], 3 * t[i + 2]];
      const u = [0, 1, 2].map(k => x[b + k] - x[a + k]), v = [0, 1, 2].map(k => x[c + k] - x[a + k]);
      const n = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
      for (const corner of [a, b, c]) for (let k = 0; k < 3; k++) normals[corner + k] += n[k];
    }
    const table = data.fields[field].table, smooth = data.fields[field].smooth;
    const count = smooth ? t.length : t.length / 3; // a colour for each corner, or for each triangle
    const kinds = part.kinds[field].subarray((frame - part.first) * count, (frame - part.first + 1) * count);
    const out = new Float32Array(9 * (t.length + part.lines.length));
    let o = 0;
    const put = (corner, n, colour) => {
      for (let k = 0; k < 3; k++) {
        out[o + k] = x[3 * corner + k];
        out[o + 3 + k] = n ? normals[3 * corner + k] : 0;
        out[o + 6 + k] = colour[k] / 255;
      }
      o += 9;
    };
    for (let i = 0; i < t.length; i++) put(t[i], true, table[kinds[smooth ? i : Math.floor(i / 3)]]);
    for (const corner of part.lines) put(corner, false, [76, 84, 94]);
    return [out, t.length, part.lines.length];
  }

  // ---- drawing ----
  const program = gl.createProgram();
  for (const [kind, source] of [[gl.VERTEX_SHADER, `
      attribute vec3 place, normal, colour; uniform mat3 turn; uniform vec3 shift; uniform vec2 scale;
      varying vec3 n, c;
      void main() {
        vec3 p = turn * place;
        n = turn * normal; c = colour;
        gl_Position = vec4((p.xy + shift.xy) * scale, -0.5 * p.z, 1.0);
        if (length(n) == 0.0) gl_Position.z -= 0.002; // lines stand before the film that they lie on
      }`], [gl.FRAGMENT_SHADER, `
      precision mediump float; varying vec3 n, c;
      void main() {
        float size = length(n);
        vec3 u = size > 0.0 ? n / size * (n.z < 0.0 ? -1.0 : 1.0) : vec3(0.0, 0.0, 1.0);
        vec3 light = normalize(vec3(-0.45, 0.55, 0.7));
        float matt = 0.4 + 0.6 * (0.5 + 0.5 * dot(u, light));
        float gloss = pow(max(dot(u, normalize(light + vec3(0.0, 0.0, 1.0))), 0.0), 24.0);
        gl_FragColor = vec4(size > 0.0 ? c * matt + 0.18 * gloss : c, 1.0);
      }`]]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, source);
    gl.compileShader(shader);
    gl.attachShader(program, shader);
  }
  gl.linkProgram(program);
  gl.useProgram(program);
  gl.enable(gl.DEPTH_TEST);
  gl.clearColor(1, 1, 1, 1);
  gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
  ["place", "normal", "colour"].forEach((name, i) => {
    const at = gl.getAttribLocation(program, name);
    gl.enableVertexAttribArray(at);
    gl.vertexAttribPointer(at, 3, gl.FLOAT, false, 36, 12 * i);
  });
  const uniform = name => gl.getUniformLocation(program, name);

  const eye = {};
  // Rows right, up, towards the eye; column by column.
  function turn() {
    const [a, e] = [eye.azimuth, eye.elevation].map(d => d * Math.PI / 180);
    const [ca, sa, ce, se] = [Math.cos(a), Math.sin(a), Math.cos(e), Math.sin(e)];
    return [ca, -sa * se, sa * ce, sa, ca * se, -ca * ce, 0, ce, se];
  }
  // Look at the whole of the frame that is shown.
  function home() {
    Object.assign(eye, { azimuth: -25, elevation: 25, zoom: 1, x: 0, y: 0 });
    const [, x] = positions(Number(slider.value)), t = turn(), low = [1e9, 1e9], high = [-1e9, -1e9];
    for (let i = 0; i < x.length; i += 3) for (let k = 0; k < 2; k++) {
      const p = t[k] * x[i] + t[3 + k] * x[i + 1] + t[6 + k] * x[i + 2];
      low[k] = Math.min(low[k], p);
      high[k] = Math.max(high[k], p);
    }
    eye.x = -(low[0] + high[0]) / 2;
    eye.y = -(low[1] + high[1]) / 2;
    const wide = canvas.clientWidth / canvas.clientHeight, [w, h] = [0, 1].map(k => high[k] - low[k] || 1e-3);
    eye.zoom = 1.8 * Math.min(wide / w, 1 / h);
  }
  let shown = [-1, -1], counts = [0, 0];
  function draw() {
    const ratio = window.devicePixelRatio || 1, frame = Number(slider.value), field = Number(chooser.value);
    canvas.width = canvas.clientWidth * ratio;
    canvas.height = canvas.clientHeight * ratio;
    gl.viewport(0, 0, canvas.width, canvas.height);
    if (shown[0] !== frame || shown[1] !== field) {
      const [corners, triangles, lines] = mesh(frame, field);
      gl.bufferData(gl.ARRAY_BUFFER, corners, gl.DYNAMIC_DRAW);
      counts = [triangles, lines];
      shown = [frame, field];
      label.textContent = data.labels[frame];
    }
    gl.uniformMatrix3fv(uniform("turn"), false, turn());
    gl.uniform3f(uniform("shift"), eye.x, eye.y, 0);
    gl.uniform2f(uniform("scale"), eye.zoom * canvas.height / canvas.width, eye.zoom);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.drawArrays(gl.TRIANGLES, 0, counts[0]);
    for (const [i, j] of [[0, 0], [1, 0], [0, 1], [1, 1]]) { // lines of two pixels
      const pixel = 2 / canvas.height / eye.zoom;
      gl.uniform3f(uniform("shift"), eye.x + i * pixel, eye.y + j * pixel, 0);
      gl.drawArrays(gl.LINES, counts[0], counts[1]);
    }
    canvas.dataset.drawn = counts.join(" ");
  }

  function tell() {
    const field = data.fields[Number(chooser.value)];
    legend.replaceChildren();
    const swatch = colour => {
      const box = document.createElement("i");
      box.style.background = `rgb(${colour})`;
      return box;
    };
    if (field.names) field.names.forEach(([name, kind]) => legend.append(swatch(field.table[kind]), ` ${name}  `));
    else {
      const bar = document.createElement("b");
      bar.style.background = `linear-gradient(to right, ${field.table.map(c => `rgb(${c})`).join(",")})`;
      legend.append(`${field.low} `, bar, ` ${field.high}  ${field.unit}`);
    }
  }

  // ---- the user ----
  data.fields.forEach((field, i) => chooser.add(new Option(field.name, i)));
  slider.max = data.labels.length - 1;
  slider.value = slider.max;
  slider.oninput = draw;
  chooser.onchange = () => { tell(); draw(); };
  let timer = 0;
  button.onclick = () => {
    if (timer) { clearInterval(timer); timer = 0; button.textContent = "Play"; return; }
    button.textContent = "Stop";
    timer = setInterval(() => { slider.value = (Number(slider.value) + 1) % data.labels.length; draw(); }, 80);
  };
  canvas.onpointerdown = event => canvas.setPointerCapture(event.pointerId);
  canvas.onpointermove = event => {
    if (!event.buttons) return;
    if (event.shiftKey || event.buttons > 1) {
      eye.x += 2 * event.movementX / canvas.clientHeight / eye.zoom;
      eye.y -= 2 * event.movementY / canvas.clientHeight / eye.zoom;
    } else {
      eye.azimuth -= event.movementX / 3;
      eye.elevation = Math.max(-90, Math.min(90, eye.elevation + event.movementY / 3));
    }
    draw();
  };
  canvas.onwheel = event => { event.preventDefault(); eye.zoom *= Math.exp(-event.deltaY / 800); draw(); };
  canvas.ondblclick = () => { home(); draw(); };
  canvas.onkeydown = event => { if (event.key === " ") { event.preventDefault(); button.onclick(); } };
  window.onresize = draw;
  tell();
  home();
  draw();
})();
