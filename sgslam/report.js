const plan = document.getElementById("plan");
const view = plan.viewBox.baseVal;
const home = [view.x, view.y, view.width, view.height];
const show = (x, y, width, height) => plan.setAttribute("viewBox", [x, y, width, height].join(" "));
const here = (event) => new DOMPoint(event.clientX, event.clientY).matrixTransform(plan.getScreenCTM().inverse());

plan.addEventListener("wheel", (event) => {
  event.preventDefault();
  const wanted = view.width * Math.exp(event.deltaY * 0.0015);
  const factor = Math.min(Math.max(wanted, home[2] / 200), home[2] * 4) / view.width;
  const at = here(event);
  show(at.x + (view.x - at.x) * factor, at.y + (view.y - at.y) * factor, view.width * factor, view.height * factor);
}, { passive: false });

let held = null;
plan.addEventListener("pointerdown", (event) => {
  held = here(event);
  plan.setPointerCapture(event.pointerId);
});
plan.addEventListener("pointermove", (event) => {
  if (!held) return;
  const at = here(event);
  show(view.x + held.x - at.x, view.y + held.y - at.y, view.width, view.height);
});
for (const end of ["pointerup", "pointercancel"]) plan.addEventListener(end, () => { held = null; });
plan.addEventListener("dblclick", () => show(...home));

for (const box of document.querySelectorAll("[data-layer]")) {
  box.addEventListener("change", () => {
    for (const group of plan.querySelectorAll(".layer-" + box.dataset.layer)) group.style.display = box.checked ? "" : "none";
  });
}
