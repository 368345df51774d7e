// Verdicts at any tolerance, in the table of elements and the plans.

// As `judged` in sgslam/as_built/elements/likelihoods.py; metres.
function judged(offset, sigma, doubt, tolerance) {
  const off = Math.abs(offset);
  const margin = tolerance - off;
  if ((doubt && margin < 0) || (sigma > tolerance && off < tolerance + sigma)) return ["uncertain", "not conclusive"];
  const kept = Math.abs(margin) <= 2 * sigma ? "not conclusive" : margin > 0 ? "within" : "outside";
  return [margin < 0 ? "moved" : "as planned", kept];
}

// Judges the rows by tolerances in mm, by class; `marks` are what stands for them in the plans, by their ids.
function judgeRows(rows, marks, limits, ofVerdict, ofTolerance) {
  for (const row of rows) {
    const { kind, offset, sigma, doubt } = row.dataset;
    if (!kind) continue;
    const [verdict, kept] = judged(Number(offset), Number(sigma), doubt !== undefined, limits[kind] / 1000);
    const cell = row.cells[ofVerdict];
    if (row.dataset.of === verdict && row.cells[ofTolerance].textContent === kept) continue; // a change costs a layout
    row.cells[ofTolerance].textContent = kept;
    const before = cell.className;
    row.dataset.of = cell.textContent = verdict;
    cell.className = "verdict-" + verdict.replace(" ", "-");
    cell.dataset.sort = document.querySelector(`.${cell.className}.tile`).dataset.rank;
    for (const mark of marks.get(row.dataset.id)) {
      mark.classList.toggle("significant", verdict === "moved" && Math.abs(offset) > 2 * sigma);
      if (!mark.classList.replace(before, cell.className)) continue; // a mapped wall
      const [name, , ...reason] = mark.firstElementChild.textContent.split("\n");
      mark.firstElementChild.textContent = [name, verdict, ...reason].join("\n");
    }
  }
  const texts = ["wall", "slab", "opening"].map((kind) => `${kind} ${limits[kind]} mm`);
  document.getElementById("tolerances").textContent = texts.join(", ");
}
