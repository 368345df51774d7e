// The 3D view: translucent walls drawn from far to near, nothing but a 2D canvas.
{
const canvas = document.getElementById("scene");
const data = JSON.parse(document.getElementById("scene-data").textContent);
const brush = canvas.getContext("2d");
const hidden = new Set();
const FIRST = { yaw: -0.45, pitch: 0.75, zoom: 1, x: 0, y: 0 };
const view = { ...FIRST };
const PIECE = 24; // vertices of a path that are drawn, and sorted, as one

const triples = (flat) => Array.from({ length: flat.length / 3 }, (_, i) => flat.slice(3 * i, 3 * i + 3).map((v) => v / 1000));
const clamp = (value, low, high) => Math.min(Math.max(value, low), high);

const things = []; // {layer, look, points, closed, middle, significant}
const add = (kind, layer, look, points, significant) => {
  const middle = [0, 1, 2].map((k) => points.reduce((sum, p) => sum + p[k], 0) / points.length);
  things.push({ kind, layer, look, points, middle, significant, screen: points.map(() => [0, 0]), depth: 0 });
};
for (const [layer, look, significant, ...mm] of data.walls) {
  const [x0, y0, x1, y1, z0, z1] = mm.map((v) => v / 1000);
  add("wall", layer, look, [[x0, y0, z0], [x1, y1, z0], [x1, y1, z1], [x0, y0, z1]], significant);
}
for (const [layer, pieces] of Object.entries(data.paths)) {
  for (const points of pieces.map(triples)) {
    for (let i = 0; i < points.length - 1; i += PIECE) add("path", layer, layer, points.slice(i, i + PIECE + 1));
  }
}
for (const point of triples(data.keyframes)) add("dot", "keyframes", "keyframe", [point]);
const floors = data.floors.map(([matched, flat]) => ({
  matched,
  points: Array.from({ length: flat.length / 2 }, (_, i) => [flat[2 * i] / 1000, flat[2 * i + 1] / 1000, 0]),
}));
// The camera stands three radii from what it looks at and zooms by its lens: nothing is ever behind it.
const extent = things.filter((thing) => !["odometry", "lost"].includes(thing.layer)).flatMap((thing) => thing.points);
const radius = extent.reduce((far, point) => Math.max(far, Math.hypot(...point)), 2);
const AWAY = 3 * radius;
const camera = ({ yaw, pitch, x: atX, y: atY }) => {
  const [ca, sa, cp, sp] = [Math.cos(yaw), Math.sin(yaw), Math.cos(pitch), Math.sin(pitch)];
  return ([x, y, z], out) => {
    const across = ca * (x - atX) + sa * (y - atY);
    const along = ca * (y - atY) - sa * (x - atX);
    const depth = Math.max(AWAY + along * cp - z * sp, AWAY / 50);
    out[0] = across / depth;
    out[1] = -(along * sp + z * cp) / depth;
    return depth;
  };
};
// half the width and height of the whole scene in the initial view, at zoom 1
const half = [0, 0];
const atFirst = camera(FIRST);
for (const point of extent) {
  const out = [0, 0];
  atFirst(point, out);
  half.forEach((most, k) => { half[k] = Math.max(most, Math.abs(out[k])); });
}
const MARGIN = 0.94;
const lens = () => view.zoom * MARGIN * Math.min(canvas.width / half[0], canvas.height / half[1]) / 2;
let project, pixel = 1;
const aim = () => {
  const [see, scale, middleX, middleY] = [camera(view), lens(), canvas.width / 2, canvas.height / 2];
  project = (point, out) => {
    const depth = see(point, out);
    out[0] = middleX + out[0] * scale;
    out[1] = middleY + out[1] * scale;
    return depth;
  };
};

const trace = (screen, closed) => {
  brush.beginPath();
  for (const [x, y] of screen) brush.lineTo(x, y);
  if (closed) brush.closePath();
};
// its points run anticlockwise (on a screen, y down) seen from the room that the wall faces
const faces = ([[ax, ay], [bx, by], [cx, cy], [dx, dy]]) => (cx - ax) * (dy - by) - (dx - bx) * (cy - ay) > 0;
const paint = (thing, colors) => {
  const color = brush.strokeStyle = brush.fillStyle = colors[thing.look];
  if (!color) return;
  const bim = thing.layer === "bim-walls";
  if (thing.kind === "dot") {
    brush.globalAlpha = 1;
    brush.fillRect(thing.screen[0][0] - 1.4 * pixel, thing.screen[0][1] - 1.4 * pixel, 2.8 * pixel, 2.8 * pixel);
    return;
  }
  trace(thing.screen, thing.kind === "wall");
  brush.setLineDash(thing.layer === "odometry" ? [5 * pixel, 4 * pixel] : thing.layer === "truth" ? [pixel, 4 * pixel] : []);
  if (thing.kind === "wall") {
    brush.globalAlpha = faces(thing.screen) ? (bim ? 0.5 : 0.6) : (bim ? 0.1 : 0.06);
    brush.fill();
    brush.globalAlpha = bim ? 0.8 : 0.9;
    brush.lineWidth = (thing.significant ? 2.2 : bim ? 0.7 : 0.9) * pixel;
  } else {
    brush.globalAlpha = 1;
    brush.lineWidth = (["trajectory", "lost"].includes(thing.layer) ? 2 : 1.3) * pixel;
  }
  brush.stroke();
};

const draw = () => {
  waiting = false;
  const colors = currentColors();
  pixel = window.devicePixelRatio || 1;
  const [width, height] = [Math.round(canvas.clientWidth * pixel), Math.round(canvas.clientHeight * pixel)];
  if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
  brush.clearRect(0, 0, width, height);
  brush.lineJoin = "round";
  aim();
  brush.setLineDash([]);
  brush.globalAlpha = 1;
  for (const { matched, points } of floors) {
    trace(points.map((p) => { const out = [0, 0]; project(p, out); return out; }), true);
    brush.fillStyle = colors[matched ? "rooms-matched" : "rooms"];
    brush.fill();
  }
  const shown = things.filter((thing) => !hidden.has(thing.layer));
  for (const thing of shown) {
    thing.points.forEach((point, i) => project(point, thing.screen[i]));
    thing.depth = project(thing.middle, [0, 0]) - (thing.layer === "bim-walls" ? 0 : 0.1); // before the plan's, where they lie in it
  }
  shown.sort((a, b) => b.depth - a.depth);
  for (const thing of shown) paint(thing, colors);
  canvas.dataset.view = [view.yaw, view.pitch, view.zoom, view.x, view.y].map((v) => v.toFixed(4)).join(" ");
};
let waiting = false;
const redraw = () => { if (!waiting) { waiting = true; requestAnimationFrame(draw); } };
const currentColors = () => {
  const style = getComputedStyle(canvas);
  const names = ["bim-walls", "walls-matched", "walls-unmatched", "anchors-withdrawn", "odometry", "trajectory", "lost", "truth", "keyframe",
    "rooms", "rooms-matched", "band-back-3", "band-back-2", "band-back-1", "band-as-planned", "band-into-1", "band-into-2", "band-into-3"];
  return Object.fromEntries(names.map((name) => [name, style.getPropertyValue("--" + name).trim()]));
};

const turn = (dx, dy) => {
  view.yaw -= dx * 0.008;
  view.pitch = clamp(view.pitch + dy * 0.008, 0.06, Math.PI / 2);
};
const move = (dx, dy) => {
  const metres = AWAY * pixel / lens(); // that a pixel of the page stands for, where the camera looks
  const [across, along] = [-dx * metres, dy * metres / Math.max(Math.sin(view.pitch), 0.3)];
  const [c, s] = [Math.cos(view.yaw), Math.sin(view.yaw)];
  view.x = clamp(view.x + c * across - s * along, -radius, radius);
  view.y = clamp(view.y + s * across + c * along, -radius, radius);
};
const zoom = (factor) => { view.zoom = clamp(view.zoom * factor, 0.4, 40); };

const held = new Map(); // pointers that are down
canvas.addEventListener("pointerdown", (event) => {
  canvas.setPointerCapture(event.pointerId);
  held.set(event.pointerId, [event.clientX, event.clientY]);
});
canvas.addEventListener("pointermove", (event) => {
  const before = held.get(event.pointerId);
  if (!before) return;
  const now = [event.clientX, event.clientY];
  const [dx, dy] = [now[0] - before[0], now[1] - before[1]];
  const other = [...held].find(([id]) => id !== event.pointerId)?.[1];
  if (other) {
    zoom(Math.hypot(now[0] - other[0], now[1] - other[1]) / Math.max(Math.hypot(before[0] - other[0], before[1] - other[1]), 1));
    move(dx / 2, dy / 2);
  } else if (event.shiftKey || event.buttons & 6) move(dx, dy);
  else turn(dx, dy);
  held.set(event.pointerId, now);
  redraw();
});
for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, (event) => held.delete(event.pointerId));
canvas.addEventListener("contextmenu", (event) => event.preventDefault());
canvas.addEventListener("wheel", (event) => {
  if (!meantForDrawing(event)) return;
  event.preventDefault();
  zoom(Math.exp(-event.deltaY * 0.0015));
  redraw();
}, { passive: false });
canvas.addEventListener("dblclick", () => { Object.assign(view, FIRST); redraw(); });
const KEYS = {
  ArrowLeft: () => turn(15, 0), ArrowRight: () => turn(-15, 0), ArrowUp: () => turn(0, 15), ArrowDown: () => turn(0, -15),
  "+": () => zoom(1.2), "-": () => zoom(1 / 1.2),
};
canvas.addEventListener("keydown", (event) => {
  if (!KEYS[event.key]) return;
  event.preventDefault();
  KEYS[event.key]();
  redraw();
});
for (const box of document.querySelectorAll("[data-solid]")) {
  box.addEventListener("change", () => { hidden[box.checked ? "delete" : "add"](box.dataset.solid); redraw(); });
}
new ResizeObserver(draw).observe(canvas); // at once: a printer does not wait for the next frame
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", redraw);
}
