"use strict";
// A table of which one page is in the document, sorted by any column.

const ROWS = 100;

/** An element with text and attributes. */
function element(name, text = "", attributes = {}) {
  const made = document.createElement(name);
  made.textContent = text;
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  return made;
}

/** A state in its colour. */
function stateText(state) {
  return element("span", state, { class: state.replace(" ", "-") });
}

function number(value, digits) {
  return value === null ? "" : value.toFixed(digits);
}

function order(a, b) {
  if (a === null || b === null) return (a === null) - (b === null);
  return typeof a === "string" ? a.localeCompare(b, "en", { numeric: true }) : a - b;
}

class PagedTable {
  /**
   * place: an empty element; columns: {name, title, number, value(row), cell(row)}, of which `cell` gives text or an
   * element; changed(): called when sorting or page is another.
   */
  constructor(place, columns, sort, down, changed = () => {}) {
    Object.assign(this, { columns, sort, down, changed, page: 0, rows: [] });
    this.table = element("table");
    const wide = element("div", "", { class: "wide" });
    wide.append(this.table);
    const bar = element("nav", "", { class: "bar", "aria-label": "pages of the table" });
    this.before = element("button", "previous", { type: "button" });
    this.after = element("button", "next", { type: "button" });
    this.shown = element("span", "", { class: "dim", role: "status" });
    bar.append(this.before, this.after, this.shown);
    place.append(wide, bar);
    this.before.onclick = () => this.turn(-1);
    this.after.onclick = () => this.turn(1);
  }

  turn(by) {
    this.page += by;
    this.draw();
    this.changed();
  }

  by(name) {
    this.down = this.sort === name ? !this.down : false;
    this.sort = name;
    this.page = 0;
    this.show(this.rows);
    this.changed();
  }

  /** Shows rows, from the page that is set. */
  show(rows) {
    const column = this.columns.find((c) => c.name === this.sort) || this.columns[0];
    const sign = this.down ? -1 : 1;
    const keys = rows.map((row) => [column.value(row), row]);
    // Empty cells come last either way.
    keys.sort(([a], [b]) => (a === null || b === null ? order(a, b) : sign * order(a, b)));
    this.rows = keys.map(([, row]) => row);
    this.draw();
  }

  draw() {
    const pages = Math.max(1, Math.ceil(this.rows.length / ROWS));
    this.page = Math.min(Math.max(this.page, 0), pages - 1);
    const first = this.page * ROWS;
    const rows = this.rows.slice(first, first + ROWS);
    const head = element("tr");
    for (const column of this.columns) {
      const sorted = column.name === this.sort ? (this.down ? "descending" : "ascending") : "none";
      const cell = element("th", "", { scope: "col", "aria-sort": sorted });
      if (column.number) cell.className = "number";
      const mark = { ascending: " ▲", descending: " ▼", none: "" }[sorted];
      const button = element("button", column.title + mark, { type: "button" });
      button.onclick = () => this.by(column.name);
      cell.append(button);
      head.append(cell);
    }
    const body = element("tbody");
    for (const row of rows) {
      const line = element("tr");
      for (const column of this.columns) {
        const cell = element("td", "", column.number ? { class: "number" } : {});
        cell.append(column.cell(row));
        line.append(cell);
      }
      body.append(line);
    }
    const top = element("thead");
    top.append(head);
    this.table.replaceChildren(top, body);
    this.before.disabled = this.page === 0;
    this.after.disabled = this.page >= pages - 1;
    const last = first + rows.length;
    this.shown.textContent = rows.length ? `${first + 1} to ${last} of ${this.rows.length}` : "none";
  }
}
