// What is wrong with how a page looks at its present size: a list of texts. Evaluated in the page.
(() => {
  const found = [], width = document.documentElement.clientWidth;
  const wide = Math.max(document.documentElement.scrollWidth, document.body.scrollWidth);
  // Not `innerWidth`: a telephone shows a page that is too wide smaller.
  if (wide > width) {
    const wider = [...document.querySelectorAll("body *")].filter(e => e.getBoundingClientRect().right > width + 1);
    found.push(`${wide} of ${width} pixels wide: ${wider.slice(0, 4).map(e => `${e.tagName}.${e.className}`).join(", ")}`);
  }

  // Text on the page, as rectangles; what a table or a plot scrolls or cuts off is no part of it.
  const texts = [], walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  for (let node = walker.nextNode(); node; node = walker.nextNode()) {
    const element = node.parentElement, text = node.textContent.trim();
    if (!text || element.closest("script, style, .readout, .cursor, #selftest") || !element.checkVisibility({ visibilityProperty: true })) continue;
    const range = document.createRange(), frame = element.closest(".table")?.getBoundingClientRect();
    range.selectNodeContents(node);
    for (const { left, top, right, bottom } of range.getClientRects()) {
      const rectangle = { left, top, right: Math.min(right, frame?.right ?? Infinity), bottom, text: text.slice(0, 40) };
      if (rectangle.right - left > 1 && bottom - top > 1) texts.push(rectangle);
    }
    for (let e = element; e !== document.body; e = e.parentElement) {
      if (getComputedStyle(e).overflowX === "hidden" && e.scrollWidth > e.clientWidth + 1) found.push(`cut off: ${text.slice(0, 40)}`);
    }
  }
  for (const t of texts) if (t.left < -1 || t.right > width + 1) found.push(`outside of the page: ${t.text}`);
  texts.sort((a, b) => a.top - b.top);
  texts.forEach((a, i) => {
    for (let k = i + 1; k < texts.length && texts[k].top < a.bottom - 3; k++) {
      const b = texts[k], across = Math.min(a.right, b.right) - Math.max(a.left, b.left);
      if (across > 3 && Math.min(a.bottom, b.bottom) - b.top > 3) found.push(`one on the other: ${a.text} | ${b.text}`);
    }
  });

  // Numbers at the axes of plots, which are drawn.
  const plots = typeof charts === "undefined" ? [] : charts.filter(c => c.u);
  for (const { u, plot } of plots) {
    u.ctx.save();
    u.ctx.font = `${11 * devicePixelRatio}px system-ui, sans-serif`;
    u.axes.forEach((axis, side) => {
      const at = (axis._splits ?? []).map((v, i) => ({ text: axis._values[i], at: u.valToPos(v, side ? "y" : "x") })).filter(t => t.text);
      const wide = t => u.ctx.measureText(t.text).width / devicePixelRatio;
      if (side) for (const t of at) if (wide(t) > axis._size - 9) found.push(`${plot.title}: ${t.text} is cut off at the axis`);
      if (!side) at.slice(1).forEach((t, i) => { if (t.at - at[i].at < (wide(t) + wide(at[i])) / 2 + 1) found.push(`${plot.title}: ${at[i].text} and ${t.text} are one on the other`); });
    });
    u.ctx.restore();
  }
  return [...new Set(found)].slice(0, 12);
})()
