"use strict";
// Errors are kept for whoever opens the page without a console.
const errors = [];
addEventListener("error", e => errors.push(String(e.message)));

const ROWS = 600, FIRST_DELAY = 500, LAST_DELAY = 5000;
const byId = id => document.getElementById(id);
const css = name => getComputedStyle(document.documentElement).getPropertyValue("--" + name).trim();
const text = v => v === null || v === undefined ? "–" : String(Number(v.toPrecision(5))).replace("-", "−");
const make = (tag, parent, className = "") => {
  const made = document.createElement(tag);
  made.className = className;
  parent.append(made);
  return made;
};

let head = null, rows = [], charts = [], received = 0;

// ---- plots: the band of two standard deviations, and in it the values from least to largest

function chart(parent, series, bands, unit) {
  const size = () => ({ width: Math.max(parent.clientWidth - 2, 60), height: 200 });
  const axis = extra => ({ stroke: css("soft"), grid: { stroke: css("grid"), width: 1 }, ticks: { show: false }, ...extra });
  const plot = new uPlot({
    ...size(), series: [{}, ...series.map(s => ({ points: { show: false }, ...s }))], bands, legend: { show: false }, cursor: { drag: { x: false, y: false } },
    scales: { x: { time: false } },
    axes: [axis({ values: (u, ticks) => ticks.map(t => `${Number(t.toPrecision(6))} s`) }), axis({ size: 64, label: unit, labelSize: 18 })],
  }, series.map(() => []).concat([[]]), parent);
  new ResizeObserver(() => plot.setSize(size())).observe(parent);
  return plot;
}

function build() {
  byId("machine").textContent = head.machine || "loadtwin";
  charts.forEach(c => c.plot.destroy());
  charts = [];
  const loads = byId("loads"), colour = css("accent");
  loads.replaceChildren();
  head.loads.forEach((load, i) => {
    const card = make("div", loads, "load");
    make("h2", card).textContent = load.name;
    const value = make("span", card, "value"), std = make("span", card, "std"), fault = make("div", card);
    const line = { stroke: colour, width: 1, spanGaps: false }, edge = { stroke: "transparent", width: 0 };
    const bands = [{ series: [1, 2], fill: colour + "30" }, { series: [3, 4], fill: colour + "90" }];
    const plot = chart(make("div", card), [edge, edge, line, line], bands, load.unit);
    const columns = () => {
      const of = pick => rows.map(r => { const l = r.loads[i]; return l && l.least !== null ? pick(l) : null; });
      return [of(l => l.most + 2 * (l.std ?? 0)), of(l => l.least - 2 * (l.std ?? 0)), of(l => l.most), of(l => l.least)];
    };
    const show = row => {
      const l = row.loads[i];
      if (!l) return;
      value.textContent = l.most === null ? "–" : `${text((l.most + l.least) / 2)} ${load.unit}`;
      std.textContent = l.std === null ? "" : `± ${text(2 * l.std)} (2σ)`;
      faultIn(fault, l);
    };
    charts.push({ plot, columns, show });
  });
  const nis = byId("nis");
  nis.replaceChildren();
  const body = document.querySelector("#sensors tbody");
  body.replaceChildren();
  if (!head.sensors.length) return;
  const hue = i => `hsl(${(210 + 360 * i / head.sensors.length) % 360} 60% 50%)`;
  const plot = chart(nis, head.sensors.map((_, i) => ({ stroke: hue(i), width: 1 })), [], "NIS");
  const lines = head.sensors.map((name, i) => {
    const line = make("tr", body), label = make("td", line);
    label.textContent = name;
    label.style.borderLeft = `4px solid ${hue(i)}`;
    label.style.paddingLeft = "8px";
    return [make("td", line), make("td", line)];
  });
  charts.push({
    plot,
    columns: () => head.sensors.map((_, i) => rows.map(r => r.sensors[i]?.most ?? null)),
    show: row => row.sensors.forEach((s, i) => {
      if (!lines[i]) return;
      lines[i][0].textContent = text(s.most);
      faultIn(lines[i][1], s);
    }),
  });
}

function faultIn(element, { fault, cause }) {
  const good = fault === "none", isSilent = fault === "";
  element.className = good ? "good" : "bad";
  element.textContent = isSilent ? "no data" : good ? "valid" : `${fault.replaceAll("_", " ")}: ${cause}`;
}

const BITS = {
  identical: ["good", "bits identical"], different: ["bad", "bits differ"], incomplete: ["bad", "bits incomplete"],
  nothing: ["", "no raw samples to compare"], other_model: ["bad", "another model runs"],
};

function draw() {
  if (!head || !rows.length) return;
  const x = rows.map(r => r.t), last = rows[rows.length - 1];
  for (const c of charts) {
    c.plot.setData([x, ...c.columns()]);
    c.show(last);
  }
  const state = byId("state");
  // The status is the last one that came; it says nothing of a machine that is silent.
  const isSilent = last.loads.length > 0 && last.loads.every(load => load.fault === "");
  state.textContent = isSilent ? "no frames" : last.status ? last.status.state : "";
  const bits = byId("bits"), [className, words] = BITS[last.verdict] ?? ["", ""];
  bits.className = "tag " + className;
  bits.textContent = words;
  byId("counts").replaceChildren(...last.counts.map(([name, count]) => {
    const pair = document.createElement("div");
    make("dt", pair).textContent = name;
    make("dd", pair).textContent = count;
    return pair;
  }));
  byId("note").textContent = last.note ?? "";
}

// ---- connection

let delay = FIRST_DELAY, waiting = false;
function connect() {
  const socket = new WebSocket(`ws://${location.host}/socket`);
  const link = byId("link");
  socket.onopen = () => { delay = FIRST_DELAY; rows = []; link.className = "tag good"; link.textContent = "connected"; };
  socket.onmessage = ({ data }) => {
    const message = JSON.parse(data);
    if (message.head) { head = message.head; build(); return; }
    received++;
    rows.push(message);
    if (rows.length > ROWS) rows.shift();
    if (!waiting) { waiting = true; requestAnimationFrame(() => { waiting = false; draw(); }); }
  };
  socket.onclose = () => {
    link.className = "tag bad";
    link.textContent = "not connected";
    byId("bits").textContent = byId("state").textContent = "";
    for (const value of document.querySelectorAll(".load .value, .load .std")) value.textContent = "";
    for (const good of document.querySelectorAll(".load .good, #sensors .good")) { good.className = "bad"; good.textContent = "no data"; }
    setTimeout(connect, delay);
    delay = Math.min(2 * delay, LAST_DELAY);
  };
}
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => { if (head) { build(); draw(); } });
connect();
