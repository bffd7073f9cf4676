"use strict";
(() => {
  const all = (selector, where = document) => [...where.querySelectorAll(selector)];

  // texts of points: one box beside the pointer, or beside the point that was tapped
  const tip = document.createElement("div");
  tip.id = "tip";
  tip.hidden = true;
  tip.setAttribute("role", "tooltip");
  document.body.append(tip);
  let shown = null;
  const hide = () => { if (shown) shown.classList.remove("near"); shown = null; tip.hidden = true; };
  for (const point of all("svg .row")) {
    const title = point.querySelector("title");
    if (!title) continue;
    point.dataset.text = title.textContent;
    title.remove();
  }
  const show = (point) => {
    if (point === shown) return;
    hide();
    shown = point;
    point.classList.add("near");
    tip.textContent = point.dataset.text;
    tip.hidden = false;
    const box = point.getBoundingClientRect(), own = tip.getBoundingClientRect();
    const left = Math.min(Math.max(8, box.left + box.width / 2 - own.width / 2), innerWidth - own.width - 8);
    const top = box.top - own.height - 10;
    tip.style.left = left + "px";
    tip.style.top = (top < 8 ? box.bottom + 10 : top) + "px";
  };
  const nearest = (svg, x, y) => {
    let best = null, least = 26;
    for (const point of all(".row[data-text]", svg)) {
      const box = point.getBoundingClientRect();
      if (!box.width) continue;
      const far = Math.hypot(box.left + box.width / 2 - x, box.top + box.height / 2 - y);
      if (far < least) { least = far; best = point; }
    }
    return best;
  };
  for (const svg of all("figure svg")) {
    const look = (event) => { const point = nearest(svg, event.clientX, event.clientY); if (point) show(point); else hide(); };
    svg.addEventListener("pointermove", look);
    svg.addEventListener("click", look);
    svg.addEventListener("pointerleave", hide);
  }
  addEventListener("scroll", hide, { passive: true });
  addEventListener("keydown", (event) => { if (event.key === "Escape") hide(); });

  // tables wider than the screen: a hint above them, for as long as they are
  const hinted = () => {
    for (const box of all(".scroll")) {
      const cut = box.scrollWidth > box.clientWidth + 1, above = box.previousElementSibling;
      const hint = above && above.classList.contains("hint") ? above : null;
      if (hint) hint.hidden = !cut;
      if (hint || !cut) continue;
      const words = document.createElement("p");
      words.className = "hint";
      words.textContent = "more columns: scroll sideways \u2192";
      box.tabIndex = 0;
      box.before(words);
    }
  };
  for (const details of all("details")) details.addEventListener("toggle", hinted);
  addEventListener("resize", hinted);
  hinted();

  // tables that a click on a heading sorts; numbers stand in data-value, or at the beginning of a cell
  const value = (row, place) => {
    const cell = row.cells[place];
    const text = cell.dataset.value ?? cell.textContent.trim();
    const number = parseFloat(text);
    return Number.isNaN(number) ? text.toLowerCase() : number;
  };
  const order = (a, b) => (typeof a === typeof b ? (a < b ? -1 : a > b ? 1 : 0) : typeof a === "number" ? -1 : 1);
  for (const table of all("table.sortable")) {
    const heads = all("thead th", table);
    heads.forEach((head, place) => {
      head.setAttribute("aria-sort", "none");
      head.tabIndex = 0;
      const sort = () => {
        const down = head.getAttribute("aria-sort") === "ascending";
        heads.forEach((other) => other.setAttribute("aria-sort", "none"));
        head.setAttribute("aria-sort", down ? "descending" : "ascending");
        const rows = [...table.tBodies[0].rows].sort((a, b) => order(value(a, place), value(b, place)) * (down ? -1 : 1));
        table.tBodies[0].append(...rows);
      };
      head.addEventListener("click", sort);
      head.addEventListener("keydown", (event) => { if (event.key === "Enter") sort(); });
    });
  }
})();
