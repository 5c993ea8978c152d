"use strict";
// A plot as a file: picture (PNG, SVG) or data (CSV), of what is in view.

const MARGIN = { top: 34, bottom: 30 };

function fileName(chart, end) {
  return (chart.plot.title.replace(/[^\p{L}\p{N}]+/gu, "-").replace(/^-|-$/g, "") || "plot") + end;
}
function download(content, type, name) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(new Blob([content], { type }));
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 1000);
}
// The series that are in view; a band has its upper edge only.
const shownSeries = ({ u, plot }) => plot.series.map((s, i) => ({ ...s, i })).filter(s => u.series[s.i + 1].show && s.mark !== "lower");

// Entries of the legend: bands and shaded times have the colour that they are drawn in.
function legendOf(chart) {
  const entries = shownSeries(chart).map(s => {
    const colour = colours[chart.colours[s.i]], isBand = s.mark === "upper";
    return { label: s.label, colour: isBand ? colour + "38" : colour, high: isBand ? 10 : 4 };
  });
  if (chart.spans.length) entries.push({ label: chart.plot.shaded.label, colour: colours.limit + "30", high: 10 });
  return entries;
}

// Names of the columns: the edges of a band are those of the series before it.
function columnNames({ series, y }) {
  let line = "";
  return series.map(s => {
    if (s.mark === "upper" || s.mark === "lower") return `${line} ${s.label.replace("±", "+")}`;
    line = s.label;
    return s.label;
  }).map(name => name.trim() + (y.unit ? ` [${y.unit}]` : ""));
}
// Rows of samples, of a scatter plot or of a curve; where samples are drawn by the least and the greatest
// of several, a row for these with both.
function csvOf(chart) {
  const { u, plot, data } = chart, { min, max } = u.scales.x, x = data[0];
  const cell = text => /[",\n]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text;
  const names = columnNames(plot), columns = data.slice(1), inView = i => x[i] >= min && x[i] <= max;
  const flag = plot.shaded ? timeColumn(plot.shaded.column) : null, flagName = flag ? [plot.shaded.label] : [];
  const lines = [];
  if (plot.own || view.perBucket <= 1) {
    const named = plot.names.length > 0;
    lines.push([...(named ? ["name"] : []), label(plot.x), ...names, ...flagName]);
    x.forEach((at, i) => {
      if (inView(i)) lines.push([...(named ? [cell(plot.names[i])] : []), at, ...columns.map(c => c[i] ?? ""), ...(flag ? [flag[i] ?? ""] : [])]);
    });
  } else {
    const of = `${plot.x.quantity} [${plot.x.unit}]`;
    lines.push([`${of} from`, `${of} to`, ...names.flatMap(name => [`${name} least`, `${name} greatest`]), ...flagName]);
    let row = 0;
    for (const count of timeBuckets()) {
      const rows = Array.from({ length: count }, (_, k) => row + k);
      row += count;
      if (!inView(rows[0]) && !inView(rows.at(-1))) continue;
      const known = c => rows.map(i => c[i]).filter(v => v !== null);
      const ends = c => known(c).length ? [Math.min(...known(c)), Math.max(...known(c))] : ["", ""];
      lines.push([x[rows[0]], x[rows.at(-1)], ...columns.flatMap(ends), ...(flag ? [Math.max(0, ...known(flag))] : [])]);
    }
  }
  return lines.map((cells, i) => (i ? cells : cells.map(cell)).join(",")).join("\n") + "\n";
}

function pngOf(chart) {
  const { u, plot } = chart, px = devicePixelRatio, picture = u.ctx.canvas, canvas = document.createElement("canvas");
  canvas.width = picture.width;
  canvas.height = picture.height + (MARGIN.top + MARGIN.bottom) * px;
  const ctx = canvas.getContext("2d");
  ctx.fillStyle = colours.card;
  ctx.fillRect(0, 0, canvas.width, canvas.height);
  ctx.drawImage(picture, 0, MARGIN.top * px);
  ctx.textBaseline = "middle";
  ctx.fillStyle = colours.text;
  ctx.font = `600 ${13 * px}px system-ui, sans-serif`;
  ctx.fillText(plot.title, 8 * px, MARGIN.top / 2 * px);
  ctx.font = `${12 * px}px system-ui, sans-serif`;
  let x = 58 * px;
  for (const s of legendOf(chart)) {
    const y = canvas.height - MARGIN.bottom / 2 * px;
    ctx.fillStyle = s.colour;
    ctx.fillRect(x, y - s.high / 2 * px, 14 * px, s.high * px);
    ctx.fillStyle = colours.text;
    ctx.fillText(s.label, x + 20 * px, y);
    x += ctx.measureText(s.label).width + 44 * px;
  }
  return canvas;
}

function svgOf(chart) {
  const { u, plot, data } = chart, { min, max } = u.scales.x, px = devicePixelRatio;
  const [left, top, wide, high] = [u.bbox.left / px, u.bbox.top / px + MARGIN.top, u.bbox.width / px, u.bbox.height / px];
  const [width, height] = [u.width, u.height + MARGIN.top + MARGIN.bottom];
  const escape = text => String(text).replace(/[&<>"]/g, c => `&#${c.charCodeAt(0)};`);
  const [right, bottom] = [left + wide, top + high];
  const X = v => (left + u.valToPos(v, "x")).toFixed(2), Y = v => (top + u.valToPos(v, "y")).toFixed(2);
  const write = (x, y, text, more = "") => `<text x="${x}" y="${y}" ${more}>${escape(text)}</text>`;
  const out = [`<svg xmlns="http://www.w3.org/2000/svg" width="${width}" height="${height}" viewBox="0 0 ${width} ${height}" font-family="system-ui, sans-serif" font-size="11" fill="${colours.text}">`,
    `<rect width="100%" height="100%" fill="${colours.card}"/>`, write(8, MARGIN.top / 2 + 4, plot.title, 'font-size="13" font-weight="600"')];
  u.axes.forEach((axis, side) => axis._splits.forEach((v, i) => {
    const text = axis._values[i];
    if (text === null || text === undefined || text === "") return;
    const [x, y] = side ? [left, Y(v)] : [X(v), top];
    out.push(`<path d="M${x} ${y}${side ? `H${right}` : `V${bottom}`}" stroke="${colours.grid}"/>`,
      side ? write(left - 6, y, text, 'text-anchor="end" dominant-baseline="middle"') : write(x, bottom + 16, text, 'text-anchor="middle"'));
  }));
  // What is outside of an inner picture is cut off.
  out.push(`<svg x="${left}" y="${top}" width="${wide}" height="${high}" viewBox="${left} ${top} ${wide} ${high}" fill="none">`);
  for (const [from, to] of chart.spans) out.push(`<rect x="${X(from)}" y="${top}" width="${Math.max(X(to) - X(from), 0.5)}" height="${high}" fill="${colours.limit}" fill-opacity="0.19"/>`);
  const rows = data[0].map((x, i) => i).filter(i => data[0][i] >= min && data[0][i] <= max);
  const line = (column, all = rows) => {
    let pen = "M";
    return all.map(i => column[i] === null ? (pen = "M", "") : [pen + X(data[0][i]) + " " + Y(column[i]), pen = "L"][0]).join("");
  };
  for (const s of shownSeries(chart)) {
    const column = data[s.i + 1], colour = colours[chart.colours[s.i]];
    const known = rows.filter(i => column[i] !== null);
    if (s.mark === "points") out.push(...known.map(i => `<circle cx="${X(data[0][i])}" cy="${Y(column[i])}" r="2.5" fill="${colour}" fill-opacity="0.6"/>`));
    else if (s.mark === "bars") out.push(...known.map(i => `<path d="M${X(data[0][i])} ${Y(0)}V${Y(column[i])}" stroke="${colour}" stroke-width="${Math.max(0.75 * wide / rows.length, 1).toFixed(2)}"/>`));
    else if (s.mark === "upper") {
      const lower = data[s.i + 2], both = known.filter(i => lower[i] !== null);
      if (both.length) out.push(`<path d="${line(column, both)}${line(lower, both.toReversed()).replace("M", "L")}Z" fill="${colour}" fill-opacity="0.22"/>`);
    } else out.push(`<path d="${line(column)}" stroke="${colour}" stroke-width="1.3"/>`);
  }
  for (const { value } of plot.limits) out.push(`<path d="M${left} ${Y(value)}H${right}" stroke="${colours.limit}" stroke-width="1.6" stroke-dasharray="7 4"/>`);
  out.push("</svg>");
  for (const { name, x, y } of placedNames(chart, name => 6.2 * name.length)) out.push(write((left + x).toFixed(2), (top + y + 4).toFixed(2), name));
  out.push(`<rect x="${left}" y="${top}" width="${wide}" height="${high}" fill="none" stroke="${colours.line}"/>`);
  for (const { value, label } of plot.limits) out.push(write(right - 4, Number(Y(value)) - 5, label, `text-anchor="end" fill="${colours.limit}"`));
  const [prefix] = chart.prefix, unit = plot.y.unit && prefix + plot.y.unit, [xPrefix] = chart.xPrefix;
  out.push(write(left + wide / 2, bottom + 36, label({ ...plot.x, unit: plot.x.unit && xPrefix + plot.x.unit }), 'text-anchor="middle" font-size="12"'),
    write(0, 0, label({ ...plot.y, unit }), `transform="translate(14 ${top + high / 2}) rotate(-90)" text-anchor="middle" font-size="12"`));
  let x = left;
  for (const s of legendOf(chart)) {
    const y = height - MARGIN.bottom / 2;
    out.push(`<rect x="${x}" y="${y - s.high / 2}" width="14" height="${s.high}" fill="${s.colour}"/>`, write(x + 20, y + 4, s.label, 'font-size="12"'));
    x += 44 + 7 * s.label.length;
  }
  return out.join("\n") + "\n</svg>\n";
}

const SAVED = {
  PNG: chart => pngOf(chart).toBlob(blob => download(blob, "image/png", fileName(chart, ".png"))),
  SVG: chart => download(svgOf(chart), "image/svg+xml", fileName(chart, ".svg")),
  CSV: chart => download(csvOf(chart), "text/csv", fileName(chart, ".csv")),
};
function addSaving(chart) {
  const group = document.createElement("span");
  group.className = "save";
  for (const [kind, save] of Object.entries(SAVED)) {
    const button = document.createElement("button");
    button.textContent = kind;
    button.title = `Save what is in view as ${kind}`;
    button.setAttribute("aria-label", `${chart.plot.title}: save as ${kind}`);
    button.addEventListener("click", () => save(chart));
    group.append(button);
  }
  chart.figure.querySelector("figcaption").append(group);
}
