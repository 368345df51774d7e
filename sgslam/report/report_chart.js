// Pointing at the chart of errors: what they were at that time, and where in the plan.
if (document.getElementById("errors")) {
const chart = document.getElementById("errors");
const data = JSON.parse(document.getElementById("chart-data").textContent);
const cursor = document.getElementById("cursor");
const marker = document.getElementById("marker");
const readout = document.getElementById("readout");
const hint = readout.textContent;
const length = (metres) => (metres < 1 ? (metres * 100).toFixed(1) + " cm" : metres.toFixed(2) + " m");

chart.addEventListener("pointermove", (event) => {
  const x = new DOMPoint(event.clientX, event.clientY).matrixTransform(chart.getScreenCTM().inverse()).x;
  let i = data.x.findIndex((value) => value >= x);
  if (i < 0) i = data.x.length - 1;
  if (i > 0 && x - data.x[i - 1] < data.x[i] - x) i -= 1;
  cursor.setAttribute("x1", data.x[i]);
  cursor.setAttribute("x2", data.x[i]);
  marker.firstElementChild.setAttribute("points", [data.place[i], data.place[i]].join(" "));
  chart.classList.add("pointed");
  marker.classList.add("pointed");
  const errors = Object.entries(data.errors).map(([label, values]) => `${label}: ${length(values[i])}`);
  readout.textContent = [`After ${data.seconds[i].toFixed(1)} s`, ...errors].join("; ");
});
chart.addEventListener("pointerleave", () => {
  chart.classList.remove("pointed");
  marker.classList.remove("pointed");
  readout.textContent = hint;
});
}
