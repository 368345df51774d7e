// The table of elements: searching, sorting, tolerances, and the outlines in the plans that its rows stand for. What is
// chosen is in the address, so that a link shows what its sender saw.
if (document.getElementById("elements")) {
const table = document.getElementById("elements");
const rows = [...table.tBodies[0].rows];
const [search, slider] = ["element-search", "tolerance"].map((id) => document.getElementById(id));
const tiles = [...document.querySelectorAll("[data-verdict]")];
const presets = [...document.querySelectorAll(".tolerance button")];
const heads = [...table.tHead.rows[0].cells];
const names = heads.map((head) => head.textContent);
const marks = new Map(rows.map((row) => [row.dataset.id, []])); // what stands for an element in the plans, by its id
for (const mark of document.querySelectorAll(".plan [data-element]")) marks.get(mark.dataset.element)?.push(mark);

const chosen = () => Object.fromEntries(new URLSearchParams(location.hash.slice(1)));
const choose = (parts) => {
  const all = Object.entries({ ...chosen(), ...parts }).filter(([, text]) => text);
  history.replaceState(null, "", "#" + new URLSearchParams(all));
  show();
};

const filter = (words, verdict) => {
  let shown = 0;
  for (const row of rows) {
    const text = (row.textContent + " " + row.title).toLowerCase();
    row.hidden = Boolean(verdict && row.dataset.of !== verdict) || !words.every((word) => text.includes(word));
    shown += !row.hidden;
  }
  document.getElementById("element-count").textContent = `${shown} of ${rows.length}`;
};

const collator = new Intl.Collator(undefined, { numeric: true });
const value = (row, column) => {
  const cell = row.cells[column];
  return "sort" in cell.dataset ? Number(cell.dataset.sort) : cell.textContent === "–" ? null : cell.textContent;
};
const compare = (a, b) => typeof a === "number" && typeof b === "number" ? a - b : collator.compare(a, b);
const sort = (column, up) => {
  const before = [...rows];
  rows.sort((one, two) => {
    const [a, b] = [value(one, column), value(two, column)];
    if (a === null || b === null) return (a === null) - (b === null); // without a value: last, either way
    return up ? compare(a, b) : compare(b, a);
  });
  if (rows.some((row, k) => row !== before[k])) table.tBodies[0].append(...rows);
};

const show = () => {
  const { search: words = "", verdict, sort: by, order, ...limits } = { ...presets[0].dataset, ...chosen() };
  judgeRows(rows, marks, limits, names.indexOf("Verdict"), names.indexOf("Tolerance"));
  search.value = words;
  slider.value = limits.wall;
  for (const tile of tiles) {
    const name = tile.dataset.verdict;
    tile.ariaPressed = String(name === verdict);
    tile.firstElementChild.textContent = rows.filter((row) => row.dataset.of === name).length.toLocaleString("en");
  }
  filter(words.toLowerCase().split(/\s+/).filter(Boolean), verdict);
  for (const head of heads) head.ariaSort = head.textContent === by ? order : "none";
  if (names.includes(by)) sort(names.indexOf(by), order === "ascending");
};
search.addEventListener("input", () => choose({ search: search.value }));
slider.addEventListener("input", () => {
  choose(Object.fromEntries(Object.keys(presets[0].dataset).map((kind) => [kind, slider.value])));
});
for (const preset of presets) preset.addEventListener("click", () => choose(preset.dataset));
for (const tile of tiles) {
  tile.addEventListener("click", () => {
    choose({ verdict: tile.ariaPressed === "true" ? "" : tile.dataset.verdict });
    document.getElementById("elements-card").scrollIntoView({ block: "nearest" });
  });
}
for (const head of heads) {
  head.firstElementChild.addEventListener("click", () => {
    choose({ sort: head.textContent, order: head.ariaSort === "ascending" ? "descending" : "ascending" });
  });
}
addEventListener("hashchange", show);
show();

const rowOf = new Map(rows.map((row) => [row.dataset.id, row]));
const outlineOf = (row) => marks.get(row.dataset.id).find((mark) => mark.localName === "polygon");
const point = (row) => {
  for (const other of rows) {
    other.classList.toggle("chosen", other === row);
    outlineOf(other)?.classList.toggle("chosen", other === row);
  }
};
for (const row of rows) {
  const outline = outlineOf(row);
  if (!outline) continue;
  row.addEventListener("pointerenter", () => outline.classList.add("shown"));
  row.addEventListener("pointerleave", () => outline.classList.remove("shown"));
  row.querySelector("button").addEventListener("click", () => {
    point(row);
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
    if (row.hidden) choose({ search: "", verdict: "" });
    point(row);
    row.scrollIntoView({ block: "center" });
  });
}
}
