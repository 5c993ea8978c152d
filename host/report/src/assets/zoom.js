"use strict";
// Every sample of what is in view, from the page or from the file beside it, as `samples.rs` writes them.

// Above this many in view the rows of the whole are as fine.
const MOST_SAMPLES = 1 << 18;
// Rows of these in a plot; of more samples the least and the greatest of several are drawn.
const MOST_ROWS = 8192;
// Columns of chunks that are kept decoded: 32 MB.
const MOST_DECODED = 1024;

// ---- chunks

// Those in the page, or a promise of those beside it: lists of texts, the times first.
let chunks = null;
function loadedChunks() {
  return chunks ??= page.samples.file ? chunksBeside() : Promise.resolve(JSON.parse(document.getElementById("samples").textContent));
}
function chunksBeside() {
  const found = [], { file, id, spans } = page.samples;
  return new Promise((done, fail) => {
    globalThis.loadtwinSamples = chunk => {
      if (Array.isArray(chunk)) found.push(chunk);
      else if (chunk === id && found.length === spans.length) done(found);
      else fail(`${file} is of another run`);
    };
    const script = document.createElement("script");
    script.onload = () => fail(`${file} is not whole`);
    script.onerror = () => fail(`${file} is not beside this page, or the browser does not load it`);
    script.src = encodeURIComponent(file);
    document.head.append(script);
  });
}

// Bytes that were sorted by significance, as words of so many.
async function inflated(text, size) {
  const stream = new Blob([bytes(text)]).stream().pipeThrough(new DecompressionStream("deflate-raw"));
  const sorted = new Uint8Array(await new Response(stream).arrayBuffer()), count = sorted.length / size;
  const words = new Uint8Array(sorted.length);
  for (let byte = 0; byte < size; byte++) for (let i = 0; i < count; i++) words[i * size + byte] = sorted[byte * count + i];
  return words.buffer;
}
async function timesOf(text) {
  const words = new BigUint64Array(await inflated(text, 8));
  let step = 0n, last = 0n;
  words.forEach((w, i) => { step += w; last += step; words[i] = last; });
  return new Float64Array(words.buffer);
}
async function columnOf(text) {
  const words = new Int32Array(await inflated(text, 4));
  let last = 0;
  words.forEach((w, i) => words[i] = last = (last + w) | 0);
  return new Float32Array(words.buffer);
}
// Stored column `c` of chunk `k`; the times where `c` is -1.
const decoded = new Map();
async function decodedColumn(k, c) {
  const key = `${k} ${c}`, text = (await loadedChunks())[k][c + 1];
  const found = decoded.get(key) ?? (c < 0 ? timesOf(text) : columnOf(text));
  decoded.delete(key);
  decoded.set(key, found);
  if (decoded.size > MOST_DECODED) decoded.delete(decoded.keys().next().value);
  return found;
}
async function joined(from, to, c) {
  const parts = await Promise.all(Array.from({ length: to - from }, (_, i) => decodedColumn(from + i, c)));
  return parts.flatMap(part => Array.from(part));
}
// Column `c` of the page, from the stored ones.
async function sampleColumn(from, to, c) {
  const terms = await Promise.all(page.samples.columns[c].map(async ([stored, factor]) => [await joined(from, to, stored), factor]));
  const [[first, factor], ...others] = terms;
  return first.map((v, i) => {
    const sum = others.reduce((sum, [column, factor]) => sum + factor * column[i], factor * v);
    return Number.isNaN(sum) ? null : sum;
  });
}

// ---- what is drawn

// Least and greatest of each `count` values as they occur, and a gap where there is one: three rows, as few differ.
function bucketed(column, count) {
  const rows = [];
  for (let at = 0; at < column.length; at += count) {
    let low = -1, high = -1, gap = false;
    for (let i = at; i < Math.min(at + count, column.length); i++) {
      if (column[i] === null) gap = true;
      else { if (low < 0 || column[i] < column[low]) low = i; if (high < 0 || column[i] > column[high]) high = i; }
    }
    const [a, b] = low < 0 ? [null, null] : low <= high ? [column[low], column[high]] : [column[high], column[low]];
    rows.push(a, b, gap ? null : b);
  }
  return rows;
}
function bucketedTimes(x, count) {
  const rows = [];
  for (let at = 0; at < x.length; at += count) { const last = x[Math.min(at + count, x.length) - 1]; rows.push(x[at], last, last); }
  return rows;
}
// Columns that are drawn.
function drawnColumns() {
  const of = ({ plot }) => [...plot.columns, ...(plot.shaded ? [plot.shaded.column] : []), ...(plot.band ?? [])];
  return new Set(charts.filter(c => !c.plot.own).flatMap(of));
}
// Samples between `min` and `max`, with the rows of the page before and after them.
async function detail([min, max], from, to) {
  const x = await joined(from, to, -1);
  const first = Math.max(lowest(x, min) - 1, 0), end = Math.min(lowest(x, max) + 2, x.length);
  const count = Math.ceil((end - first) / MOST_ROWS), isRaw = count === 1;
  const reduced = isRaw ? column => column.slice(first, end) : column => bucketed(column.slice(first, end), 2 * count);
  const rows = isRaw ? x.slice(first, end) : bucketedTimes(x.slice(first, end), 2 * count);
  const all = whole.x, before = rowsWhile(last => last < rows[0]), after = rowsWhile((last, first) => first <= rows.at(-1));
  const columns = [];
  for (const c of drawnColumns()) {
    const column = whole.columns[c] ??= values(page.time.columns[c]);
    columns[c] = [...column.slice(0, before.rows), ...reduced(await sampleColumn(from, to, c)), ...column.slice(after.rows)];
  }
  return {
    x: [...all.slice(0, before.rows), ...rows, ...all.slice(after.rows)], columns, perBucket: isRaw ? 1 : 2 * count,
    buckets: [...whole.buckets.slice(0, before.buckets), ...(isRaw ? rows.map(() => 1) : Array(rows.length / 3).fill(3)), ...whole.buckets.slice(after.buckets)],
  };
}
// Buckets of the whole recording, and their rows, as long as their last and first times are so.
function rowsWhile(is) {
  const x = whole.x;
  let rows = 0, buckets = 0;
  for (const count of whole.buckets ??= Array.from(new Uint8Array(bytes(page.time.buckets)))) {
    if (!is(x[rows + count - 1], x[rows])) break;
    rows += count;
    buckets++;
  }
  return { rows, buckets };
}
// First index from which on `x` is not below `at`.
function lowest(x, at) {
  let low = 0, high = x.length;
  while (low < high) { const m = (low + high) >> 1; if (x[m] < at) low = m + 1; else high = m; }
  return low;
}

function setTime(next) {
  if (view === next) return;
  view = next;
  for (const chart of charts) {
    if (chart.plot.own) continue;
    const { u, group } = chart, [min, max] = group.range;
    setData(chart);
    u.batch(() => { u.setData(chart.data, false); u.setScale("x", { min, max }); });
    drawCursors(chart);
  }
  say();
}
function say(problem) {
  const place = document.getElementById("drawn"), count = view.perBucket;
  if (place) place.textContent = (count > 1 ? `Drawn as the least and the greatest of each ${count} samples.` : "Every sample in view is drawn.") + (problem ? ` ${problem}.` : "");
}

// Draws what is in view as finely as the samples allow.
let lastRefined = 0;
async function refine() {
  const group = groups.get("time"), { samples } = page;
  if (!samples || !group?.charts.length || page.time.perBucket <= 1) return;
  const turn = ++lastRefined, [min, max] = group.range;
  const inView = samples.spans.map(([first, last], k) => last >= min && first <= max ? k : -1).filter(k => k >= 0);
  const from = inView[0] ?? 0, to = (inView.at(-1) ?? -1) + 1;
  const count = samples.spans.slice(from, to).reduce((sum, [,, rows]) => sum + rows, 0);
  const isFiner = count > 0 && count <= MOST_SAMPLES && !isAll(group);
  try {
    const next = isFiner ? await detail([min, max], from, to) : whole;
    if (turn === lastRefined) setTime(next);
  } catch (problem) {
    if (turn === lastRefined) { setTime(whole); say(String(problem)); }
  }
}
const isAll = ({ range: [min, max], full: [low, high] }) => max - min > 0.98 * (high - low);
let waiting = null;
function refineSoon() {
  clearTimeout(waiting);
  const group = groups.get("time");
  // All is there at once; else who turns a wheel or drags has come to rest.
  waiting = setTimeout(refine, group?.range && isAll(group) ? 0 : 60);
}
