"use strict";
// Numbers and geometry first, without a document, so that they can be tested alone; the page below.

const Live = (() => {
  const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
  const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
  const scaled = (a, s) => a.map((x) => x * s);
  const unit = (a) => scaled(a, 1 / Math.hypot(...a));
  const times = (m, v) => m.map((row) => dot(row, v));
  const product = (a, b) => a.map((row) => [0, 1, 2].map((j) => row[0] * b[0][j] + row[1] * b[1][j] + row[2] * b[2][j]));
  const SAME = [[1, 0, 0], [0, 1, 0], [0, 0, 1]];

  // Rotation by the least angle that takes a direction to the vertical (Rodrigues).
  function upright(from) {
    const c = from[2];
    const v = cross(from, [0, 0, 1]);
    if (c < -1 + 1e-9) return [[1, 0, 0], [0, -1, 0], [0, 0, -1]];
    const k = 1 / (1 + c), [x, y, z] = v;
    return [
      [1 - k * (y * y + z * z), k * x * y - z, k * x * z + y],
      [k * x * y + z, 1 - k * (x * x + z * z), k * y * z - x],
      [k * x * z - y, k * y * z + x, 1 - k * (x * x + y * y)],
    ];
  }

  // The attitude after the vertical of the case has become `up`: as little turned from the one before as can be.
  const followed = (attitude, up) => product(upright(times(attitude, unit(up))), attitude);

  // Room to picture: x to the right, y down, and how near (> 0: the near half), seen from an azimuth and 20 deg above.
  function seen(point, azimuth) {
    const a = azimuth * Math.PI / 180, e = 20 * Math.PI / 180;
    const right = -Math.sin(a) * point[0] + Math.cos(a) * point[1];
    const towards = Math.cos(a) * point[0] + Math.sin(a) * point[1];
    return [right, towards * Math.sin(e) - point[2] * Math.cos(e), towards * Math.cos(e) + point[2] * Math.sin(e)];
  }

  const rounded = (x) => String(Number(x.toPrecision(3))).replace("-", "−");

  // A parameter as people read it: value, 95 % of its error, and limit in the unit of the calibration's table.
  function stated(p) {
    const [value, error, limit] = [p.value, 1.96 * p.std, p.limit].map((x) => rounded(x * p.factor));
    return `${value} ± ${error} ${p.shown_unit}, limit ${limit}`;
  }

  // How much of the way to its limit a parameter is, by 1.96 standard deviations: 1 is there.
  const share = (p) => (p.std > 0 ? Math.min(1, p.limit / (1.96 * p.std)) : 1);

  // What is known after another event; states are never changed, but made anew.
  function after(known, event) {
    switch (event.event) {
      case "start": return { start: event, rests: {}, problems: [], attitude: known.attitude };
      case "rest": return { ...known, rests: { ...known.rests, [event.number]: event } };
      case "problem": {
        const { withdraws } = event;
        const left = withdraws ? known.problems.filter((p) => p.statement !== withdraws) : [...known.problems, event];
        return { ...known, problems: left };
      }
      case "state": {
        const attitude = event.up ? followed(known.attitude, event.up) : known.attitude;
        return { ...known, state: event, attitude };
      }
      default: return { ...known, [event.event]: event }; // progress, next, done
    }
  }

  const begin = () => ({ rests: {}, problems: [], attitude: SAME });
  return { after, begin, cross, followed, rounded, scaled, seen, share, stated, times, unit, upright };
})();

if (typeof module !== "undefined") module.exports = Live;

if (typeof document !== "undefined") (() => {
  const find = (id) => document.getElementById(id);
  const SVG = "http://www.w3.org/2000/svg";
  const RADIUS = 95, SIZES = [0.42, 0.3, 0.12]; // the ball, and half the edges of the box in it
  let known = Live.begin(), drawn = null, ended = false;

  function mark(name, attributes, text) {
    const made = document.createElementNS(SVG, name);
    for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
    if (text !== undefined) made.textContent = text;
    return made;
  }

  function line(text, cls) {
    const made = document.createElement("li");
    made.textContent = text;
    if (cls) made.className = cls;
    return made;
  }

  // --- the sphere: the room stands still, the device and its directions turn in it ---

  function sphere() {
    const azimuth = Number(find("azimuth").value);
    const place = (v) => Live.seen(Live.times(known.attitude, v), azimuth);
    const at = (v) => { const [x, y, near] = place(v); return { x: RADIUS * x, y: RADIUS * y, near }; };
    const far = [], close = [];
    const put = (v, cls, r) => {
      const p = at(v);
      const made = mark("circle", { cx: p.x.toFixed(2), cy: p.y.toFixed(2), r, class: p.near < 0 ? `${cls} behind` : cls });
      (p.near < 0 ? far : close).push(made);
    };
    for (const rest of Object.values(known.rests)) {
      if (rest.mean_accel) put(Live.unit(rest.mean_accel), rest.accepted ? "covered" : "refused", 4);
    }
    if (known.next && !known.done) put(Live.unit(known.next.up), "wanted", 8);
    const top = Live.seen([0, 0, 1], azimuth);
    close.push(mark("circle", { cx: 0, cy: (RADIUS * top[1]).toFixed(2), r: 3.5, class: "now" }));
    find("sphere").replaceChildren(
      mark("circle", { r: RADIUS, class: "ball" }),
      ...[-60, -30, 0, 30, 60].map((latitude) => mark("ellipse", {
        cx: 0, cy: (-RADIUS * Math.sin(latitude * Math.PI / 180) * Math.cos(20 * Math.PI / 180)).toFixed(2),
        rx: (RADIUS * Math.cos(latitude * Math.PI / 180)).toFixed(2),
        ry: (RADIUS * Math.cos(latitude * Math.PI / 180) * Math.sin(20 * Math.PI / 180)).toFixed(2), class: "grid",
      })),
      ...far, ...box(at), ...close);
    const rests = Object.values(known.rests).filter((r) => r.accepted).length;
    find("sphere").setAttribute("aria-label", `${rests} directions covered` + (known.next ? `; wanted: ${known.next.statement}` : ""));
  }

  // The device as a box with its axes; faces from the farthest to the nearest.
  function box(at) {
    const axes = [[1, 0, 0], [0, 1, 0], [0, 0, 1]];
    const corner = (signs) => at(signs.map((s, k) => s * SIZES[k]));
    const faces = [];
    for (const k of [0, 1, 2]) {
      for (const side of [-1, 1]) {
        const [i, j] = [(k + 1) % 3, (k + 2) % 3];
        const corners = [[-1, -1], [1, -1], [1, 1], [-1, 1]].map(([a, b]) => {
          const signs = [0, 0, 0];
          signs[k] = side; signs[i] = a; signs[j] = b;
          return corner(signs);
        });
        const points = corners.map((p) => `${p.x.toFixed(1)},${p.y.toFixed(1)}`).join(" ");
        faces.push([corners.reduce((sum, p) => sum + p.near, 0), mark("polygon", { points, class: "face" })]);
      }
    }
    const arms = axes.map((axis, k) => {
      const from = at(Live.scaled(axis, SIZES[k])), to = at(Live.scaled(axis, SIZES[k] + 0.2)), text = at(Live.scaled(axis, SIZES[k] + 0.29));
      const group = mark("g", {});
      group.append(
        mark("line", { x1: from.x.toFixed(1), y1: from.y.toFixed(1), x2: to.x.toFixed(1), y2: to.y.toFixed(1), class: "axis" }),
        mark("text", { x: text.x.toFixed(1), y: text.y.toFixed(1), class: "name" }, `+${"xyz"[k]}`));
      return [text.near * 4, group];
    });
    return [...faces, ...arms].sort((a, b) => a[0] - b[0]).map((pair) => pair[1]);
  }

  // --- words and bars ---

  function words() {
    const { start, next, progress, done, state } = known;
    if (start) find("target").textContent = `target: ${start.target}`;
    if (done) find("next").textContent = `Done: ${done.reason}; ${done.rests} rests in ${Math.round(done.seconds)} s.`;
    else if (next) find("next").textContent = next.statement[0].toUpperCase() + next.statement.slice(1);
    else if (start) find("next").textContent = `Lay the device down and leave it alone for ${start.hold} s.`;
    document.querySelector(".say").classList.toggle("done", Boolean(done));
    if (progress && progress.ratio !== null) {
      find("whole").textContent = progress.ratio <= 1 ? "all of them together are within the target"
        : `${Live.rounded(progress.ratio)} times the target; worst: ${progress.parameters[progress.worst].label}`;
    }
    if (!ended) find("status").textContent = done ? "done" : state ? (state.moving ? "moving" : "resting") : "connected";
  }

  function bars() {
    if (!known.progress) return;
    const entries = Object.entries(known.progress.parameters).filter((e) => e[1].limit !== null);
    find("bars").replaceChildren(...entries.map(([, p]) => {
      const made = document.createElement("li"), label = document.createElement("span"), amount = document.createElement("span");
      const bar = document.createElement("progress");
      label.textContent = p.label;
      amount.className = "value";
      amount.textContent = Live.stated(p);
      bar.max = 1;
      bar.value = Live.share(p);
      bar.setAttribute("aria-label", p.label);
      if (bar.value >= 1) made.className = "there";
      made.append(label, amount, bar);
      return made;
    }));
  }

  function device() {
    const state = known.state;
    if (!state) return;
    const said = (id, value, factor, unit) => {
      if (value !== null && value !== undefined) find(id).textContent = `${Live.rounded(value * factor)} ${unit}`;
    };
    said("noise-accel", state.noise.accel, 1 / 9.80665e-3, "mg");
    said("noise-gyro", state.noise.gyro, 180 / Math.PI, "deg/s");
    said("rate", state.rate, 180 / Math.PI, "deg/s");
    said("temperature", state.temperature, 1, "°C");
  }

  function lists() {
    const rests = Object.values(known.rests).reverse();
    find("rests").replaceChildren(...rests.map((r) => line(
      `${r.number}: ${r.start.toFixed(1)} to ${r.end.toFixed(1)} s, ${r.accepted ? (r.held ? "accepted for the force alone, held by hand" : "accepted") : `refused: ${r.why}`}`,
      r.accepted ? "" : "bad")));
    const problems = known.problems.map((p) => line(`${p.severity}: ${p.statement}`, p.severity === "error" ? "bad" : ""));
    find("problems").replaceChildren(...(problems.length ? problems : [line("none", "soft")]));
  }

  // Events come in bursts; what they say is drawn once a frame.
  function draw() {
    drawn = null;
    words(); bars(); device(); lists(); sphere();
  }
  const redraw = () => { drawn ??= requestAnimationFrame(draw); };

  find("azimuth").addEventListener("input", redraw);
  const stored = find("events"); // of a page that was kept as a file
  if (stored) {
    known = JSON.parse(stored.textContent).reduce(Live.after, known);
    ended = true;
    find("status").textContent = known.done ? "kept after the session" : "kept after a session that was cut off";
  } else {
    const source = new EventSource("events");
    source.onmessage = (message) => {
      ended = false;
      known = Live.after(known, JSON.parse(message.data));
      if (known.done) source.close();
      redraw();
    };
    source.onerror = () => {
      if (known.done) return;
      ended = true;
      find("status").textContent = "not connected: the session ended, or the page fell behind";
    };
  }
  redraw();
})();
