// The plan: zooming, moving, switches of its layers.

{
let lastScroll = -Infinity; // while the page is being scrolled, a wheel event is not meant for the plan
addEventListener("scroll", () => { lastScroll = performance.now(); }, { passive: true });
const plan = document.getElementById("plan");
const view = plan.viewBox.baseVal;
const home = [view.x, view.y, view.width, view.height];
const show = (x, y, width, height) => plan.setAttribute("viewBox", [x, y, width, height].join(" "));
const here = ([x, y]) => new DOMPoint(x, y).matrixTransform(plan.getScreenCTM().inverse());
const zoomAt = (point, factor) => {
  const at = here(point);
  const scale = Math.min(Math.max(view.width * factor, home[2] / 200), home[2] * 4) / view.width;
  show(at.x + (view.x - at.x) * scale, at.y + (view.y - at.y) * scale, view.width * scale, view.height * scale);
};

plan.addEventListener("wheel", (event) => {
  if (!event.ctrlKey && performance.now() - lastScroll < 400) return;
  event.preventDefault();
  zoomAt([event.clientX, event.clientY], Math.exp(event.deltaY * 0.0015));
}, { passive: false });

const held = new Map(); // pointers that are down, by their ids
plan.addEventListener("pointerdown", (event) => {
  held.set(event.pointerId, [event.clientX, event.clientY]);
  plan.setPointerCapture(event.pointerId);
});
plan.addEventListener("pointermove", (event) => {
  const before = held.get(event.pointerId);
  if (!before) return;
  const now = [event.clientX, event.clientY];
  const other = [...held].find(([id]) => id !== event.pointerId)?.[1];
  if (other) {
    const apart = ([x, y]) => Math.max(Math.hypot(x - other[0], y - other[1]), 1);
    zoomAt(other, apart(before) / apart(now));
  } else {
    const [from, to] = [here(before), here(now)];
    show(view.x + from.x - to.x, view.y + from.y - to.y, view.width, view.height);
  }
  held.set(event.pointerId, now);
});
for (const end of ["pointerup", "pointercancel"]) plan.addEventListener(end, (event) => held.delete(event.pointerId));
plan.addEventListener("dblclick", () => show(...home));

for (const box of document.querySelectorAll("[data-layer]")) {
  box.addEventListener("change", () => {
    const groups = document.querySelectorAll(".plan .layer-" + box.dataset.layer);
    for (const group of groups) group.style.display = box.checked ? "" : "none";
  });
}
}
