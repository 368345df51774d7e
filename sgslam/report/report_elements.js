// The table of elements: sorting, searching, and the outlines in the plans that its rows stand for.
if (document.getElementById("elements")) {
const table = document.getElementById("elements");
const rows = [...table.tBodies[0].rows];
const texts = new Map(rows.map((row) => [row, (row.textContent + " " + row.title).toLowerCase()]));
const search = document.getElementById("element-search");
const tiles = [...document.querySelectorAll("[data-verdict]")];

const filter = () => {
  const words = search.value.toLowerCase().split(/\s+/).filter(Boolean);
  const verdict = tiles.find((tile) => tile.ariaPressed === "true")?.dataset.verdict;
  let shown = 0;
  for (const row of rows) {
    row.hidden = Boolean(verdict && row.dataset.of !== verdict) || !words.every((word) => texts.get(row).includes(word));
    shown += !row.hidden;
  }
  document.getElementById("element-count").textContent = `${shown} of ${rows.length}`;
};
search.addEventListener("input", filter);
for (const tile of tiles) {
  tile.addEventListener("click", () => {
    const pressed = tile.ariaPressed !== "true";
    for (const other of tiles) other.ariaPressed = String(pressed && other === tile);
    filter();
    document.getElementById("elements-card").scrollIntoView({ block: "nearest" });
  });
}

const collator = new Intl.Collator(undefined, { numeric: true });
const value = (row, column) => {
  const cell = row.cells[column];
  return "sort" in cell.dataset ? Number(cell.dataset.sort) : cell.textContent === "–" ? null : cell.textContent;
};
const compare = (a, b) => typeof a === "number" && typeof b === "number" ? a - b : collator.compare(a, b);
const heads = [...table.tHead.rows[0].cells];
for (const [column, head] of heads.entries()) {
  head.firstElementChild.addEventListener("click", () => {
    const up = head.ariaSort !== "ascending";
    for (const other of heads) other.ariaSort = other === head ? (up ? "ascending" : "descending") : "none";
    rows.sort((one, two) => {
      const [a, b] = [value(one, column), value(two, column)];
      if (a === null || b === null) return (a === null) - (b === null); // without a value: last, either way
      return up ? compare(a, b) : compare(b, a);
    });
    table.tBodies[0].append(...rows);
  });
}

const outlines = new Map([...document.querySelectorAll(".plan [data-element]")].map((o) => [o.dataset.element, o]));
const rowOf = new Map(rows.map((row) => [row.dataset.id, row]));
const choose = (row) => {
  for (const other of rows) other.classList.toggle("chosen", other === row);
  for (const [id, outline] of outlines) outline.classList.toggle("chosen", id === row.dataset.id);
};
for (const row of rows) {
  const outline = outlines.get(row.dataset.id);
  if (!outline) continue;
  row.addEventListener("pointerenter", () => outline.classList.add("shown"));
  row.addEventListener("pointerleave", () => outline.classList.remove("shown"));
  row.querySelector("button").addEventListener("click", () => {
    choose(row);
    outline.closest(".plan").scrollIntoView({ block: "center" });
  });
}
for (const plan of document.querySelectorAll(".plan")) {
  let from = [0, 0];
  plan.addEventListener("pointerdown", (event) => { from = [event.clientX, event.clientY]; });
  plan.addEventListener("click", (event) => { // its target is the plan, which has captured the pointer
    if (Math.hypot(event.clientX - from[0], event.clientY - from[1]) > 4) return; // the plan was dragged
    const under = document.elementsFromPoint(event.clientX, event.clientY);
    const row = rowOf.get(under.find((element) => element.dataset.element)?.dataset.element);
    if (!row) return;
    if (row.hidden) {
      search.value = "";
      for (const tile of tiles) tile.ariaPressed = "false";
      filter();
    }
    choose(row);
    row.scrollIntoView({ block: "center" });
  });
}
}
