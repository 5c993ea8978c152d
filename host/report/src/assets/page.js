"use strict";
// Errors are kept for whoever opens the page without a console; `#selftest` prints them.
const errors = [];
window.addEventListener("error", e => errors.push(String(e.message)));

const page = JSON.parse(document.getElementById("data").textContent);
const root = document.documentElement;
const css = name => getComputedStyle(root).getPropertyValue("--" + name).trim();
let colours = {};

// ---- data

function bytes(text) {
  return Uint8Array.from(atob(text), c => c.charCodeAt(0)).buffer;
}
// uPlot takes null for "no value".
const values = text => Array.from(new Float32Array(bytes(text)), v => Number.isNaN(v) ? null : v);
// Times and columns as they are drawn at present; at first the whole recording.
const whole = { x: null, columns: [], perBucket: page.time.perBucket, buckets: null };
let view = whole;
function timeX() { return view.x ??= Array.from(new Float64Array(bytes(page.time.x))); }
function timeColumn(c) { return view.columns[c] ??= values(page.time.columns[c]); }
function timeBuckets() { return view.buckets ??= Array.from(new Uint8Array(bytes(page.time.buckets))); }

function dataOf(plot) {
  if (plot.own) return [Array.from(new Float64Array(bytes(plot.own.x))), ...plot.own.columns.map(values)];
  return [timeX(), ...plot.columns.map(timeColumn)];
}

// ---- numbers

const PREFIXED = ["N", "Nm", "W", "Pa", "m", "m/m", "rad", "V", "Hz"];
const PREFIXES = [["G", 1e9], ["M", 1e6], ["k", 1e3], ["", 1], ["m", 1e-3], ["µ", 1e-6], ["n", 1e-9]];
function prefixOf(unit, data) {
  if (!PREFIXED.includes(unit)) return ["", 1];
  let most = 0;
  for (const column of data) for (const v of column) if (v !== null && Math.abs(v) > most) most = Math.abs(v);
  // Up to 2000 and down to 0.2 without one.
  return most === 0 ? ["", 1] : PREFIXES.find(([, factor]) => most >= (factor > 1 ? 2 : 0.2) * factor) ?? PREFIXES.at(-1);
}
function text(v, digits = 5) {
  if (v === null || v === undefined || Number.isNaN(v)) return "–";
  const s = Number(v.toPrecision(digits));
  return (s !== 0 && (Math.abs(s) < 1e-4 || Math.abs(s) >= 1e7)) ? v.toExponential(3).replace(/\.?0+e/, "e") : String(s).replace("-", "−");
}
// Numbers at an axis: with as many decimals as two neighbours need to differ.
function tickTexts(ticks, factor) {
  const known = ticks.filter(v => v !== null), step = Math.min(...known.slice(1).map((v, i) => Math.abs(v - known[i]) / factor));
  const most = Math.max(...known.map(v => Math.abs(v) / factor)), digits = Math.max(6, Math.ceil(Math.log10(most / step)) + 1);
  return ticks.map(v => v === null ? "" : text(v / factor, Number.isFinite(digits) ? Math.min(digits, 15) : 6));
}
const label = axis => axis.quantity + (axis.unit ? ` [${axis.unit}]` : "");

// ---- linked views: all plots over time share range and cursors, each other plot has its own

const charts = [];
const groups = new Map();
function groupOf(plot, index) {
  const key = plot.own ? "own" + index : "time";
  if (!groups.has(key)) groups.set(key, { key, charts: [], range: null, full: null, cursors: null });
  return groups.get(key);
}
function show(group, min, max) {
  const [low, high] = group.full;
  const width = Math.min(max - min, high - low);
  min = Math.min(Math.max(min, low), high - width);
  group.range = [min, min + width];
  for (const c of group.charts) c.u.setScale("x", { min, max: min + width });
  if (group.key === "time") refineSoon();
}

let dragMode = "zoom", cursorsOn = false;
function panning(e) { return e.button === 0 && (dragMode === "pan" || e.shiftKey); }

function startPan(chart, e) {
  e.preventDefault();
  const { u, group } = chart, { min, max } = u.scales.x, from = e.clientX;
  const perPixel = (max - min) / u.over.clientWidth;
  const move = e => show(group, min - (e.clientX - from) * perPixel, max - (e.clientX - from) * perPixel);
  const stop = () => { removeEventListener("mousemove", move); removeEventListener("mouseup", stop); };
  addEventListener("mousemove", move);
  addEventListener("mouseup", stop);
}

// ---- measuring cursors

function nearest(x, at) {
  let low = 0, high = x.length - 1;
  while (low < high) { const m = (low + high) >> 1; if (x[m] < at) low = m + 1; else high = m; }
  return low > 0 && at - x[low - 1] < x[low] - at ? low - 1 : low;
}
function placeCursor(group, which, at) {
  const x = group.charts[0].data[0];
  if (!x.length) return;
  group.cursors ??= [null, null];
  group.cursors[which] = x[nearest(x, at)];
  group.charts.forEach(drawCursors);
}
function defaultCursors(group) {
  const [min, max] = group.range;
  placeCursor(group, 0, min + (max - min) / 3);
  placeCursor(group, 1, min + (max - min) * 2 / 3);
}
function measure(chart) {
  const [a, b] = chart.group.cursors, x = chart.data[0];
  const ia = nearest(x, a), ib = nearest(x, b);
  return {
    x1: a, x2: b, dx: b - a,
    series: chart.plot.series.map((s, i) => {
      const y1 = chart.data[i + 1][ia] ?? null, y2 = chart.data[i + 1][ib] ?? null;
      return { label: s.label, mark: s.mark, y1, y2, dy: y1 === null || y2 === null ? null : y2 - y1 };
    }),
  };
}
function drawCursors(chart) {
  const { u, group } = chart, on = cursorsOn && group.cursors !== null;
  chart.handles.forEach((handle, i) => {
    const at = on ? u.valToPos(group.cursors[i], "x") : -1;
    handle.hidden = !(at >= 0 && at <= u.over.clientWidth);
    handle.style.left = at + "px";
  });
  chart.readout.hidden = !on;
  if (!on) return;
  const m = measure(chart), axis = chart.plot.x, time = axis.quantity === "Time";
  const x = time ? "t" : "x", [prefix, factor] = chart.prefix, [xPrefix, xFactor] = chart.xPrefix;
  const rows = [["", "A", "B", "B − A"],
    [`${time ? "t" : axis.quantity}${axis.unit ? ` [${xPrefix}${axis.unit}]` : ""}`, text(m.x1 / xFactor, 8), text(m.x2 / xFactor, 8), `Δ${x} ${text(m.dx / xFactor, 6)}` +
      (axis.unit === "s" && m.dx !== 0 && chart.plot.size !== "third" ? `  (${text(1 / Math.abs(m.dx), 5)} Hz)` : "")]];
  const unit = chart.plot.y.unit ? ` [${prefix}${chart.plot.y.unit}]` : "";
  m.series.forEach((s, i) => {
    if (!u.series[i + 1].show || s.mark === "lower" || s.mark === "upper") return;
    rows.push([s.label + unit, text(s.y1 === null ? null : s.y1 / factor), text(s.y2 === null ? null : s.y2 / factor),
      "Δy " + text(s.dy === null ? null : s.dy / factor)]);
  });
  chart.readout.replaceChildren(...rows.map((cells, r) => {
    const tr = document.createElement("tr");
    tr.append(...cells.map(c => { const td = document.createElement(r ? "td" : "th"); td.textContent = c; return td; }));
    return tr;
  }));
}
function addHandles(chart) {
  const { u, group } = chart;
  chart.handles = ["a", "b"].map((name, i) => {
    const handle = document.createElement("div");
    handle.className = "cursor " + name;
    handle.dataset.name = name.toUpperCase();
    handle.tabIndex = 0;
    handle.hidden = true;
    handle.addEventListener("mousedown", e => e.stopPropagation());
    handle.addEventListener("pointerdown", e => { handle.setPointerCapture(e.pointerId); handle.focus(); e.preventDefault(); });
    handle.addEventListener("pointermove", e => {
      if (handle.hasPointerCapture(e.pointerId))
        placeCursor(group, i, u.posToVal(e.clientX - u.over.getBoundingClientRect().left, "x"));
    });
    handle.addEventListener("keydown", e => {
      const step = { ArrowLeft: -1, ArrowRight: 1 }[e.key] * (e.shiftKey ? 10 : 1);
      if (!step) return;
      e.preventDefault();
      const x = chart.data[0], here = group.cursors[i];
      let at = nearest(x, here);
      // Several rows may share an x: go on until it changes.
      for (let n = Math.abs(step); n > 0; n--) do at += Math.sign(step); while (x[at] === x[at - Math.sign(step)]);
      placeCursor(group, i, x[Math.min(Math.max(at, 0), x.length - 1)]);
    });
    u.over.append(handle);
    return handle;
  });
  let downAt = null;
  u.over.addEventListener("mousedown", e => downAt = e.clientX);
  u.over.addEventListener("click", e => {
    if (!cursorsOn || group.cursors === null || Math.abs(e.clientX - downAt) > 3 || e.target !== u.over) return;
    const at = u.posToVal(e.clientX - u.over.getBoundingClientRect().left, "x");
    const [a, b] = group.cursors;
    placeCursor(group, Math.abs(at - a) <= Math.abs(at - b) ? 0 : 1, at);
  });
}

// ---- one plot

const HEIGHT = { wide: 300, half: 250, third: 220 };
const ROLES = ["estimate", "reference", "measured", "predicted", "innovation", "other"];

// Names of the colours of the series: that of its role; a further series of the same role has one that
// is not in use in the plot.
function colourNames(plot) {
  // Both are what the model says, and blue.
  const own = s => s.role === "predicted" ? "estimate" : s.role;
  const free = ["other", "innovation", "measured", "estimate", "a", "limit", "reference"].filter(c => !plot.series.some(s => own(s) === c));
  const last = {};
  return plot.series.map(s => {
    if (s.mark === "lower" || s.mark === "upper") return last[own(s)] ?? own(s);
    return last[own(s)] = own(s) in last && free.length ? free.shift() : own(s);
  });
}

// How many later series have a value where this one has.
function covering(data, k) {
  return data.slice(k + 1).filter(later => later.some((v, at) => v !== null && data[k][at] !== null)).length;
}
function seriesOptions(s, chart, i) {
  const { prefix: [prefix, factor], plot } = chart, name = chart.colours[i];
  const stroke = () => colours[name], base = {
    label: s.label, stroke, width: s.role === "reference" ? 1.6 : 1.3, points: { show: false }, spanGaps: false,
    // Without a cursor there is nothing to say.
    value: (u, v, k, at) => at === null ? "" : v === null || v === undefined ? "–" : text(v / factor) + (plot.y.unit ? ` ${prefix}${plot.y.unit}` : ""),
  };
  // What is predicted lies beneath what is measured, and wider: the two are seen also where they agree.
  const beneath = s.role === "predicted" && plot.series.slice(i + 1).some(other => other.role === "measured");
  if (beneath && s.mark === "line") return { ...base, width: 4, stroke: () => colours[name] + "80" };
  if (beneath && s.mark === "points") return { ...base, paths: () => null, points: { show: true, size: 8, width: 0, fill: () => colours[name] + "80" } };
  switch (s.mark) {
    // A few points stay in sight beneath those of later series.
    case "points": return { ...base, paths: () => null, points: { show: true, size: 5 + (chart.data[0].length <= 200 ? 3 * covering(chart.data, i + 1) : 0), width: 0, fill: () => colours[name] + (chart.data[0].length <= 200 ? "" : "99") } };
    case "bars": return { ...base, width: 1, fill: () => colours[name] + "b0", paths: uPlot.paths.bars({ size: [0.75, 40] }), fillTo: () => 0 };
    // The legend shows half the band's width.
    case "upper": case "lower": return {
      ...base, width: 0.6, stroke: () => colours[name] + "70",
      value: (u, v, i, at) => base.value(u, at === null || v === null || s.mark === "lower" ? null : (v - u.data[i + 1][at]) / 2, i, at),
    };
    default: return base;
  }
}

// Rows that rule the vertical scale: neither flagged or not valid, nor with a band many times as wide as usual, as
// while a filter settles. None where the plot says nothing of that.
const WIDE_BAND = 4;
function rulingRows(chart) {
  const { plot } = chart;
  if (plot.own || (!plot.shaded && !plot.band)) return null;
  const rules = new Uint8Array(timeX().length).fill(1);
  if (plot.band) {
    const [upper, lower] = plot.band.map(timeColumn), widths = upper.map((v, i) => v === null || lower[i] === null ? null : v - lower[i]);
    const known = widths.filter(w => w !== null).sort((a, b) => a - b);
    // As usual in the whole recording, which is drawn first.
    chart.widest ??= WIDE_BAND * known[known.length >> 1];
    widths.forEach((w, i) => { if (w > chart.widest) rules[i] = 0; });
  }
  // Least and greatest of a bucket stand in rows of their own: a neighbour may be the one that is flagged.
  if (plot.shaded) timeColumn(plot.shaded.column).forEach((flag, i) => { if (flag > 0) rules.fill(0, Math.max(i - 1, 0), i + 2); });
  return rules;
}
// Values that rule the scale between two rows; what is known by other means rules it always.
function ruling({ plot, data, rules }, from, to, shown = () => true) {
  const of = keep => plot.series.flatMap((s, k) => shown(k) ? data[k + 1].slice(from, to + 1)
    .filter((v, i) => v !== null && (keep(from + i) || s.role === "reference")) : []);
  const found = of(i => rules[i] === 1);
  return found.length ? found : of(() => true);
}
const extent = numbers => numbers.reduce(([low, high], v) => [v < low ? v : low, v > high ? v : high], [Infinity, -Infinity]);

function yRange(chart) {
  const { plot } = chart;
  return (u, low, high) => {
    if (chart.rules && low !== null && low !== undefined) {
      const [from, to] = u.series[0].idxs ?? [0, chart.data[0].length - 1];
      const [least, most] = extent(ruling(chart, from, to, k => u.series[k + 1].show));
      if (least <= most) [low, high] = [least, most];
    }
    for (const { value } of plot.limits) { low = Math.min(low ?? value, value); high = Math.max(high ?? value, value); }
    if (plot.series.some(s => s.mark === "bars")) { low = Math.min(low ?? 0, 0); high = Math.max(high ?? 0, 0); }
    if (low === null || low === undefined) return plot.y.logarithmic ? [0.1, 10] : [0, 1];
    // Two decades below the lowest limit nothing is read off.
    if (plot.y.logarithmic && plot.limits.length) low = Math.max(low, Math.min(...plot.limits.map(l => l.value)) / 100);
    if (plot.y.logarithmic) return uPlot.rangeLog(low, Math.max(high, low * 10), 10, false);
    return uPlot.rangeNum(low, high, 0.08, true).map((v, i) => low >= 0 && i === 0 ? Math.max(v, 0) : v);
  };
}

// Spans in which a column of flags is set, each from halfway to the row before to halfway to the row after.
function spansOf(shaded) {
  if (!shaded) return [];
  const x = timeX(), flags = timeColumn(shaded.column), spans = [];
  const between = i => i <= 0 ? x[0] : i >= x.length ? x.at(-1) : (x[i - 1] + x[i]) / 2;
  for (let i = 0; i < x.length; i++) {
    if (!(flags[i] > 0)) continue;
    const last = spans.at(-1);
    if (last && last[1] === between(i)) last[1] = between(i + 1); else spans.push([between(i), between(i + 1)]);
  }
  return spans;
}
function drawSpans(u, spans) {
  const { ctx, bbox } = u, right = bbox.left + bbox.width;
  ctx.save();
  ctx.fillStyle = colours.limit + "30";
  for (const [from, to] of spans) {
    const a = Math.max(u.valToPos(from, "x", true), bbox.left), b = Math.min(u.valToPos(to, "x", true), right);
    if (b >= bbox.left && a <= right) ctx.fillRect(a, bbox.top, Math.max(b - a, devicePixelRatio), bbox.height);
  }
  ctx.restore();
}

// Names of points: right of each, left where the plot ends; those that would lie on another are left out.
function placedNames({ u, plot, data }, measure) {
  const placed = [], wide = u.over.clientWidth, { min, max } = u.scales.x;
  plot.names.forEach((name, i) => {
    const k = data.findIndex((column, c) => c > 0 && column[i] !== null && u.series[c].show);
    if (!name || k < 0 || data[0][i] < min || data[0][i] > max) return;
    const at = u.valToPos(data[0][i], "x"), y = u.valToPos(data[k][i], "y"), width = measure(name);
    const x = at + 10 + width > wide ? at - 10 - width : at + 10;
    const free = placed.every(p => Math.abs(p.y - y) > 11 || p.x > x + width + 2 || x > p.x + p.width + 2);
    if (free) placed.push({ name, x, y, width });
  });
  return placed;
}
function drawNames(chart) {
  if (!chart.plot.names.length || !chart.u) return;
  const { ctx, bbox } = chart.u, px = devicePixelRatio;
  ctx.save();
  ctx.font = `${11 * px}px system-ui, sans-serif`;
  ctx.textAlign = "left";
  ctx.textBaseline = "middle";
  ctx.fillStyle = colours.text;
  for (const { name, x, y } of placedNames(chart, name => ctx.measureText(name).width / px)) ctx.fillText(name, bbox.left + x * px, bbox.top + y * px);
  ctx.restore();
}

function drawLimits(u, plot) {
  const { ctx, bbox } = u;
  ctx.save();
  ctx.beginPath();
  ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
  ctx.clip();
  const px = devicePixelRatio;
  ctx.font = `${11 * px}px system-ui, sans-serif`;
  ctx.textAlign = "right";
  ctx.textBaseline = "middle";
  for (const { value, label } of plot.limits) {
    const y = Math.round(u.valToPos(value, "y", true)), right = bbox.left + bbox.width;
    // A light edge keeps the line in sight on top of dense curves.
    for (const [stroke, width, dash] of [[colours.card + "b0", 4, []], [colours.limit, 1.6, [7 * px, 4 * px]]]) {
      ctx.strokeStyle = stroke;
      ctx.lineWidth = width * px;
      ctx.setLineDash(dash);
      ctx.beginPath();
      ctx.moveTo(bbox.left, y);
      ctx.lineTo(right, y);
      ctx.stroke();
    }
    // Of two limits the labels are outside of the two.
    const isHighest = plot.limits.length > 1 ? plot.limits.every(l => l.value <= value) : value >= 0;
    const above = y - bbox.top > 18 * px && isHighest;
    const at = Math.min(Math.max(y + (above ? -10 : 10) * px, bbox.top + 8 * px), bbox.top + bbox.height - 8 * px);
    const width = ctx.measureText(label).width + 8 * px;
    ctx.fillStyle = colours.card + "e0";
    ctx.fillRect(right - width, at - 7 * px, width, 14 * px);
    ctx.fillStyle = colours.limit;
    ctx.fillText(label, right - 4 * px, at);
  }
  ctx.restore();
}

// What a chart draws, which rows rule its scale, and what is shaded.
function setData(chart) {
  const { plot } = chart, data = dataOf(plot);
  chart.data = plot.y.logarithmic ? data.map((c, i) => i ? c.map(v => v > 0 ? v : null) : c) : data;
  chart.rules = rulingRows(chart);
  chart.spans = spansOf(plot.shaded);
}

function drawPlot(figure) {
  const index = Number(figure.dataset.plot), plot = page.plots[index];
  figure.dataset.done = "";
  // Its columns may not be among those that were refined.
  if (!plot.own) { setTime(whole); refineSoon(); }
  const group = groupOf(plot, index), chart = { plot, group, figure, colours: colourNames(plot), handles: [] };
  setData(chart);
  const { data, rules, spans } = chart, ruled = rules ? [ruling(chart, 0, data[0].length - 1)] : data.slice(1);
  chart.prefix = prefixOf(plot.y.unit, ruled);
  chart.xPrefix = prefixOf(plot.x.unit, [data[0]]);
  const [prefix, factor] = chart.prefix, [xPrefix, xFactor] = chart.xPrefix;
  if (data.slice(1).every(column => column.every(v => v === null))) {
    const p = document.createElement("p");
    p.className = "problem";
    p.textContent = "No data.";
    figure.append(p);
    return;
  }
  const pad = plot.series.some(s => s.mark === "bars") ? 0.75 * (data[0][1] - data[0][0] || 1) : 0;
  group.full ??= [data[0][0] - pad, data[0].at(-1) + pad];
  if (group.full[0] === group.full[1]) group.full = [group.full[0] - 0.5, group.full[0] + 0.5];
  const axis = {
    stroke: () => colours.soft, grid: { stroke: () => colours.grid, width: 1 }, ticks: { stroke: () => colours.line, width: 1, size: 5 },
    font: "11px system-ui, sans-serif", labelFont: "12px system-ui, sans-serif", labelSize: 20,
  };
  const start = group.range ??= group.full;
  if (spans.length) {
    const key = document.createElement("span");
    key.className = "shaded";
    key.textContent = plot.shaded.label;
    figure.querySelector("figcaption").append(key);
  }
  const bands = plot.series.flatMap((s, i) => s.mark === "upper" ? [{ series: [i + 1, i + 2], fill: () => colours[chart.colours[i]] + "38" }] : []);
  const options = {
    width: Math.max(figure.clientWidth, 200), height: HEIGHT[plot.size],
    scales: {
      x: { time: false, distr: plot.x.logarithmic ? 3 : 1, min: start[0], max: start[1], range: (u, min, max) => [min ?? start[0], max ?? start[1]] },
      y: { distr: plot.y.logarithmic ? 3 : 1, range: yRange(chart) },
    },
    axes: [
      { ...axis, label: label({ quantity: plot.x.quantity, unit: plot.x.unit && xPrefix + plot.x.unit }), size: 30,
        values: (u, ticks) => tickTexts(ticks, xFactor) },
      { ...axis, label: label({ quantity: plot.y.quantity, unit: plot.y.unit && prefix + plot.y.unit }), size: 58,
        values: (u, ticks) => tickTexts(ticks, factor) },
    ],
    series: [
      { label: plot.x.quantity, value: (u, v) => v === null ? "" : text(v / xFactor, 8) + (plot.x.unit ? ` ${xPrefix}${plot.x.unit}` : "") },
      ...plot.series.map((s, i) => seriesOptions(s, chart, i)),
    ],
    bands,
    cursor: {
      drag: { x: true, y: true, uni: 40, dist: 4 }, points: { size: 6 },
      sync: { key: group.key, setSeries: false, scales: ["x", null] , filters: { pub: type => type === "mousemove" || type === "mouseleave" } },
      bind: {
        mousedown: (u, target, handler) => e => { if (panning(e)) startPan(chart, e); else if (e.button === 0) handler(e); },
        dblclick: () => () => { u.setScale("y", { min: null, max: null }); show(group, ...group.full); },
      },
    },
    hooks: {
      drawClear: [u => drawSpans(u, chart.spans)],
      draw: [u => { drawLimits(u, plot); chart.u ??= u; drawNames(chart); if (chart.readout) drawCursors(chart); }],
      setScale: [(u, key) => {
        if (key !== "x" || !chart.u) return;
        const { min, max } = u.scales.x;
        // What the user did in one plot goes to all; what comes from `show` is there already.
        if (min !== group.range[0] || max !== group.range[1]) show(group, min, max);
      }],
      setSeries: [(u, i, o) => {
        // The lower edge goes where the upper one goes.
        if (i !== null && o.show !== undefined && plot.series[i - 1]?.mark === "upper" && u.series[i + 1].show !== u.series[i].show)
          u.setSeries(i + 1, { show: u.series[i].show });
      }],
      ready: [u => u.root.querySelectorAll(".u-series").forEach((row, i) => { if (plot.series[i - 1]?.mark === "lower") row.style.display = "none"; })],
    },
  };
  const u = chart.u = new uPlot(options, data, figure);
  chart.readout = document.createElement("table");
  chart.readout.className = "readout";
  chart.readout.hidden = true;
  figure.append(chart.readout);
  u.over.addEventListener("wheel", e => {
    // Without a key the wheel scrolls the page.
    if (!e.ctrlKey && !e.metaKey) return;
    e.preventDefault();
    const at = u.posToVal(e.clientX - u.over.getBoundingClientRect().left, "x"), { min, max } = u.scales.x, f = e.deltaY > 0 ? 1.25 : 0.8;
    show(group, at - (at - min) * f, at + (max - at) * f);
  }, { passive: false });
  group.charts.push(chart);
  charts.push(chart);
  addHandles(chart);
  addSaving(chart);
  if (cursorsOn && group.cursors === null) defaultCursors(group);
  drawCursors(chart);
  // In the next frame: a plot of another size may change what is observed.
  new ResizeObserver(() => requestAnimationFrame(() => {
    const width = figure.clientWidth;
    if (!beforePrint && width > 0 && width !== u.width) u.setSize({ width, height: u.height });
  })).observe(figure);
}

function drawSection(details) {
  for (const figure of details.querySelectorAll(".plot:not([data-done])")) {
    figure.classList.add(page.plots[figure.dataset.plot].size);
    try { drawPlot(figure); } catch (e) { errors.push(`${figure.textContent}: ${e}`); figure.append(String(e)); }
  }
}

// ---- toolbar

function setTheme(theme) {
  root.dataset.theme = theme;
  for (const name of [...ROLES, "a", "limit", "text", "soft", "grid", "line", "card"]) colours[name] = css(name);
  for (const { u } of charts) {
    u.redraw(false, true);
    u.root.querySelectorAll(".u-marker").forEach((marker, i) => { if (i > 0) marker.style.borderColor = u.series[i].stroke(u, i); });
  }
}
function setCursors(on) {
  cursorsOn = on;
  document.querySelector("[data-action=cursors]").classList.toggle("on", on);
  for (const group of groups.values()) {
    if (on && group.charts.length && group.cursors === null) defaultCursors(group);
    group.charts.forEach(drawCursors);
  }
}
const actions = {
  cursors: () => setCursors(!cursorsOn),
  reset: () => { for (const c of charts) c.u.setScale("y", { min: null, max: null }); for (const g of groups.values()) if (g.charts.length) show(g, ...g.full); },
  theme: () => setTheme(root.dataset.theme === "dark" ? "light" : "dark"),
};
for (const button of document.querySelectorAll("[data-action]")) button.addEventListener("click", actions[button.dataset.action]);
for (const button of document.querySelectorAll("[data-drag]")) button.addEventListener("click", () => {
  dragMode = button.dataset.drag;
  root.classList.toggle("pan", dragMode === "pan");
  for (const other of document.querySelectorAll("[data-drag]")) other.classList.toggle("on", other === button);
});

const options = new URLSearchParams(location.hash.slice(1));
const dark = matchMedia("(prefers-color-scheme: dark)");
setTheme(options.get("theme") ?? (dark.matches ? "dark" : "light"));
dark.addEventListener("change", () => setTheme(dark.matches ? "dark" : "light"));
for (const details of document.querySelectorAll("details")) {
  details.addEventListener("toggle", () => { if (details.open) drawSection(details); });
  if (options.has("all") || options.has("selftest")) details.open = true;
  if (details.open) drawSection(details);
}
if (options.has("cursors")) setCursors(true);

// ---- print: light, all sections open, plots as wide as A4 lets them

// Of the 178 mm between margins and padding, at 96 px an inch.
const PRINTED = { wide: 672, half: 327, third: 212 };
let beforePrint = null;
addEventListener("beforeprint", () => {
  const sections = [...document.querySelectorAll("details")];
  beforePrint = { theme: root.dataset.theme, open: sections.map(details => details.open) };
  setTheme("light");
  for (const details of sections) { details.open = true; drawSection(details); }
  for (const { u, plot } of charts) u.setSize({ width: PRINTED[plot.size], height: HEIGHT[plot.size] * 0.8 });
});
addEventListener("afterprint", () => {
  if (!beforePrint) return;
  document.querySelectorAll("details").forEach((details, i) => details.open = beforePrint.open[i]);
  setTheme(beforePrint.theme);
  beforePrint = null;
  for (const { u, plot, figure } of charts) u.setSize({ width: figure.clientWidth || u.width, height: HEIGHT[plot.size] });
});

// ---- `#selftest`: open all, look at the pixels, use zoom and cursors, print what came of it

function inked({ u }) {
  const { left, top, width, height } = u.bbox;
  const pixels = u.ctx.getImageData(left, top, width, height).data, seen = new Set();
  for (let i = 0; i < pixels.length; i += 4) if (pixels[i + 3] > 200) seen.add((pixels[i] << 16) | (pixels[i + 1] << 8) | pixels[i + 2]);
  // The grid alone has one colour and its blends; a curve adds that of its role.
  return seen.size > 1;
}
// uPlot draws after the caller is done.
const drawn = () => new Promise(done => setTimeout(done, 50));
async function selftest() {
  const result = { plots: page.plots.length, drawn: charts.length, empty: document.querySelectorAll(".problem").length, blank: charts.filter(c => !inked(c)).map(c => c.plot.title) };
  setCursors(true);
  const time = charts.find(c => c.group.key === "time");
  if (time) {
    const [low, high] = time.group.full;
    placeCursor(time.group, 0, low + 0.25 * (high - low));
    placeCursor(time.group, 1, low + 0.75 * (high - low));
    result.cursors = measure(time);
    result.readout = time.readout.innerText;
    await drawn();
    // Where the lines stand, as parts of the plot's width; -1 where one is not to be seen.
    const frame = time.u.over.getBoundingClientRect();
    result.handles = time.handles.map(h => h.hidden ? -1 : (h.getBoundingClientRect().x + h.offsetWidth / 2 - frame.x) / frame.width);
    // The mouse and the keys, as a user would: arrow on cursor A, drag from a quarter to the half,
    // then with Shift back by a tenth of the width.
    time.handles[0].dispatchEvent(new KeyboardEvent("keydown", { key: "ArrowRight" }));
    result.stepped = time.group.cursors[0];
    const mouse = (type, part, shiftKey = false) => (type === "mouseup" ? document : time.u.over).dispatchEvent(new MouseEvent(type,
      { bubbles: true, cancelable: true, button: 0, shiftKey, movementX: 9, clientX: frame.x + part * frame.width, clientY: frame.y + frame.height / 2 }));
    const drag = async (from, to, shift) => {
      mouse("mousemove", from, shift); await drawn(); mouse("mousedown", from, shift);
      mouse("mousemove", to, shift); await drawn(); mouse("mouseup", to, shift); await drawn();
    };
    await drag(0.25, 0.5);
    result.zoomed = [time.u.scales.x.min, time.u.scales.x.max];
    await drag(0.5, 0.6, true);
    result.linked = time.group.charts.map(c => [c.u.scales.x.min, c.u.scales.x.max]);
    actions.reset();
    await drawn();
    result.reset = time.group.charts.map(c => [c.u.scales.x.min, c.u.scales.x.max]);
    result.spans = time.spans;
    result.csv = csvOf(time).split("\n").slice(0, 2);
    const picture = pngOf(time);
    result.png = [picture.width, picture.height];
  }
  const parsed = chart => new DOMParser().parseFromString(svgOf(chart), "image/svg+xml");
  result.unsaved = charts.filter(c => c.spans && (parsed(c).querySelector("parsererror") || /NaN|undefined/.test(svgOf(c)))).map(c => c.plot.title);
  result.svg = time ? [...parsed(time).querySelectorAll("text")].map(t => t.textContent) : [];
  dispatchEvent(new Event("beforeprint"));
  await drawn();
  const sections = [...document.querySelectorAll("details")];
  result.printed = { theme: root.dataset.theme, open: sections.every(details => details.open), widest: Math.max(...charts.map(c => c.u.width)) };
  dispatchEvent(new Event("afterprint"));
  result.requests = performance.getEntriesByType("resource").map(e => e.name);
  result.errors = errors;
  return result;
}
if (options.has("selftest")) drawn().then(selftest).catch(e => ({ errors: [...errors, String(e)] })).then(result => {
  const pre = document.createElement("pre");
  pre.id = "selftest";
  pre.textContent = JSON.stringify(result);
  document.body.append(pre);
});
