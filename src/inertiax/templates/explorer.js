"use strict";
// Unpacks the numbers and the plotting library, both gzip in base64, and fills the plot with what is picked.
const pick = (id) => document.getElementById(id);

async function unpacked(id) {
  const text = atob(pick(id).textContent.trim());
  const bytes = Uint8Array.from(text, (c) => c.charCodeAt(0));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
  return new Response(stream).arrayBuffer();
}

function column(numbers, said, blocks) {
  const values = new Float64Array(blocks);
  let sum = 0;
  for (let k = 0; k < blocks; k++) {
    sum = (sum + numbers[said.at + k]) & 65535;
    values[k] = said.low + said.step * sum;
  }
  return values;
}

const titled = (c) => (c.unit ? `${c.name}, ${c.unit}` : c.name);

function options(select, names, chosen) {
  const old = chosen ?? select.value;
  select.replaceChildren(...names.map((n) => new Option(n, n)));
  if (names.includes(old)) select.value = old;
}

async function start() {
  const layout = JSON.parse(pick("layout").textContent);
  const [numbers, library] = await Promise.all([unpacked("numbers"), unpacked("library")]);
  const script = document.createElement("script");
  script.textContent = new TextDecoder().decode(library);
  document.head.append(script);
  const words = new Uint16Array(numbers);
  const views = await Bokeh.embed.embed_item(JSON.parse(pick("figure").textContent));
  const named = (name) => [...views][0].model.document.get_model_by_name(name);
  const figure = named("figure"), points = named("points"), colours = named("colours");
  const of = (columns, name) => columns.find((c) => c.name === name);

  const dark = matchMedia("(prefers-color-scheme: dark)"), palette = [...colours.palette];

  // The plot is drawn on a canvas, which no style sheet reaches. Viridis ends in the ground's own colours.
  function dress() {
    colours.palette = dark.matches ? palette.slice(80) : palette.slice(0, 236);
    const style = getComputedStyle(document.documentElement);
    const [ground, ink, soft, line] = ["ground", "ink", "soft", "line"].map((n) => style.getPropertyValue(`--${n}`).trim());
    figure.setv({ background_fill_color: ground, border_fill_color: ground, outline_line_color: line });
    for (const axis of [figure.below[0], figure.left[0]])
      axis.setv({
        axis_label_text_color: ink, major_label_text_color: soft, axis_line_color: soft,
        major_tick_line_color: soft, minor_tick_line_color: soft,
      });
    for (const grid of figure.center) grid.setv({ grid_line_color: line });
  }

  function show() {
    const t = layout.find((one) => one.triad === pick("triad").value);
    const get = (said) => column(words, said, t.blocks);
    const over = of(t.variables, pick("over").value), by = of(t.variables, pick("colour").value);
    const before = of(t.before, pick("channel").value);
    const y = get(before);
    if (pick("which").value === "after") get(of(t.effects, before.name)).forEach((v, k) => (y[k] -= v));
    const c = get(by);
    colours.low = by.low;
    colours.high = by.low + 65535 * by.step;
    points.data = { x: get(over), y, c };
    figure.below[0].axis_label = titled(over);
    figure.left[0].axis_label = `residual of ${titled(before)}`;
    const rms = Math.sqrt(y.reduce((s, v) => s + v * v, 0) / t.blocks);
    pick("said").textContent =
      `${t.blocks} blocks; rms ${rms.toPrecision(3)} ${before.unit}; colour: ${titled(by)} from ` +
      `${colours.low.toPrecision(4)} to ${colours.high.toPrecision(4)}. Drag a box to zoom; hover for values.`;
    document.body.dataset.ready ??= String(Math.round(performance.now())); // ms since the page was opened
  }

  function renew() {
    const t = layout.find((one) => one.triad === pick("triad").value);
    const names = t.variables.map((v) => v.name);
    options(pick("channel"), t.before.map((b) => b.name), t.opening.channel);
    options(pick("over"), names, t.opening.over);
    options(pick("colour"), names);
    show();
  }

  const clearest = layout.reduce((a, b) => (b.opening.share > a.opening.share ? b : a));
  options(pick("triad"), layout.map((one) => one.triad), clearest.triad);
  pick("triad").addEventListener("change", renew);
  for (const id of ["channel", "which", "over", "colour"]) pick(id).addEventListener("change", show);
  dress();
  dark.addEventListener("change", dress);
  renew();
}

start().catch((error) => {
  pick("said").textContent = `The page cannot be shown: ${error.message}. A browser of 2023 or later is needed.`;
});
