// Verdicts at any tolerance, in the table of elements, its counts, and the plans.

// As `judged` in sgslam/as_built/elements/likelihoods.py; metres.
function judged(offset, sigma, doubt, tolerance) {
  const off = Math.abs(offset);
  const margin = tolerance - off;
  if ((doubt && margin < 0) || (sigma > tolerance && off < tolerance + sigma)) return ["uncertain", "not conclusive"];
  const kept = Math.abs(margin) <= 2 * sigma ? "not conclusive" : margin > 0 ? "within" : "outside";
  return [margin < 0 ? "moved" : "as planned", kept];
}

// Judges the rows by tolerances in mm, by class; `marks` are what stands for them in the plans, by their ids.
function judgeRows(rows, marks, limits) {
  const tiles = [...document.querySelectorAll("[data-verdict]")];
  const columns = [...document.querySelectorAll("#elements th")].map((head) => head.textContent);
  const [ofVerdict, ofTolerance] = ["Verdict", "Tolerance"].map((name) => columns.indexOf(name));
  const counts = { within: 0, outside: 0, "not conclusive": 0 };
  for (const row of rows) {
    const { kind, offset, sigma, doubt } = row.dataset;
    if (kind) {
      const [verdict, kept] = judged(Number(offset), Number(sigma), doubt !== undefined, limits[kind] / 1000);
      const cell = row.cells[ofVerdict];
      row.dataset.of = cell.textContent = verdict;
      cell.className = "verdict-" + verdict.replace(" ", "-");
      cell.dataset.sort = tiles.findIndex((tile) => tile.dataset.verdict === verdict);
      row.cells[ofTolerance].textContent = kept;
      for (const mark of marks.get(row.dataset.id) ?? []) {
        if (mark.localName === "polygon") {
          mark.classList.remove(...[...mark.classList].filter((name) => name.startsWith("verdict-")));
          mark.classList.add(cell.className);
          const [name, , ...reason] = mark.firstElementChild.textContent.split("\n");
          mark.firstElementChild.textContent = [name, verdict, ...reason].join("\n");
        } else mark.classList.toggle("significant", verdict === "moved" && Math.abs(offset) > 2 * sigma);
      }
    }
    const kept = row.cells[ofTolerance].textContent;
    if (kept in counts) counts[kept] += 1;
  }
  for (const tile of tiles) {
    const own = rows.filter((row) => row.dataset.of === tile.dataset.verdict);
    tile.firstElementChild.textContent = own.length.toLocaleString("en");
  }
  document.getElementById("tolerances").textContent =
    Object.entries(limits).map(([kind, mm]) => `${kind} ${mm} mm`).join(", ");
  document.getElementById("tolerance-counts").textContent =
    Object.entries(counts).map(([kept, count]) => `${count} ${kept}`).join(", ");
}
