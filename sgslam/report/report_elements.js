// The table of elements: sorting, searching, tolerances, and the outlines in the plans that its rows stand for. What is
// chosen is in the address, so that a link shows what its sender saw.
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
const press = (verdict) => {
  for (const tile of tiles) tile.ariaPressed = String(tile.dataset.verdict === verdict);
  filter();
};
search.addEventListener("input", () => { filter(); remember(); });
for (const tile of tiles) {
  tile.addEventListener("click", () => {
    press(tile.ariaPressed === "true" ? "" : tile.dataset.verdict);
    remember();
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
const sortBy = (column, order) => {
  for (const [number, head] of heads.entries()) head.ariaSort = number === column ? order : "none";
  const up = order === "ascending";
  rows.sort((one, two) => {
    const [a, b] = [value(one, column), value(two, column)];
    if (a === null || b === null) return (a === null) - (b === null); // without a value: last, either way
    return up ? compare(a, b) : compare(b, a);
  });
  table.tBodies[0].append(...rows);
};
for (const [column, head] of heads.entries()) {
  head.firstElementChild.addEventListener("click", () => {
    sortBy(column, head.ariaSort === "ascending" ? "descending" : "ascending");
    remember();
  });
}

const marks = new Map(); // what stands for an element in the plans, by its id
for (const mark of document.querySelectorAll(".plan [data-element]")) {
  marks.set(mark.dataset.element, [...(marks.get(mark.dataset.element) ?? []), mark]);
}
const outlines = new Map([...marks].map(([id, own]) => [id, own.find((mark) => mark.localName === "polygon")]));
const rowOf = new Map(rows.map((row) => [row.dataset.id, row]));
const choose = (row) => {
  for (const other of rows) other.classList.toggle("chosen", other === row);
  for (const [id, outline] of outlines) outline?.classList.toggle("chosen", id === row.dataset.id);
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
      press("");
      remember();
    }
    choose(row);
    row.scrollIntoView({ block: "center" });
  });
}

const presets = [...document.querySelectorAll(".tolerance button")];
const [slider, of] = ["tolerance", "tolerance-of"].map((id) => document.getElementById(id));
let limits = { ...presets[0].dataset }; // mm by class
const judge = (chosen) => {
  limits = chosen;
  slider.value = limits[of.value || "wall"];
  judgeRows(rows, marks, limits);
  filter();
};
for (const preset of presets) preset.addEventListener("click", () => { judge({ ...preset.dataset }); remember(); });
of.addEventListener("change", () => judge(limits));
slider.addEventListener("input", () => {
  const kinds = of.value ? [of.value] : Object.keys(limits);
  judge({ ...limits, ...Object.fromEntries(kinds.map((kind) => [kind, slider.value])) });
  remember();
});

const remember = () => {
  const sorted = heads.findIndex((head) => head.ariaSort !== "none");
  const seen = { search: search.value, verdict: tiles.find((tile) => tile.ariaPressed === "true")?.dataset.verdict };
  if (sorted >= 0) Object.assign(seen, { sort: heads[sorted].textContent, order: heads[sorted].ariaSort });
  const own = Object.entries({ ...seen, ...limits }).filter(([name, text]) => text && text !== presets[0].dataset[name]);
  history.replaceState(null, "", "#" + new URLSearchParams(own));
};
const recall = () => {
  const { search: words = "", verdict = "", sort, order, ...chosen } = Object.fromEntries(new URLSearchParams(location.hash.slice(1)));
  search.value = words;
  press(verdict);
  judge(Object.fromEntries(Object.entries(presets[0].dataset).map(([kind, mm]) => [kind, Number(chosen[kind]) > 0 ? chosen[kind] : mm])));
  const column = heads.findIndex((head) => head.textContent === sort);
  if (column >= 0) sortBy(column, order);
};
addEventListener("hashchange", recall);
recall();
}
