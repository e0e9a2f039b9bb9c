"use strict";
const find = (what) => document.querySelector(what);
const all = (what) => [...document.querySelectorAll(what)];
const points = JSON.parse(find("#data").textContent);
const reference = find("#reference");

// Pressing on a picture shows the reference in its place.
for (const seen of all(".seen")) {
  const img = seen.querySelector("img");
  const own = img.src;
  const show = (source) => () => { img.src = source; };
  if (!reference) continue;
  seen.addEventListener("pointerdown", show(reference.src));
  for (const end of ["pointerup", "pointerleave", "pointercancel"]) seen.addEventListener(end, show(own));
}

// A point's numbers and main settings, as text.
const numbers = (p) =>
  `${p.ms.toFixed(1)} ms, score ${p.score.toFixed(2)}, ${p.psnr.toFixed(1)} dB, FLIP ${p.flip.toFixed(4)}, flicker ${p.flicker.toFixed(4)}`;
const settings = (p) => {
  const { foveation, trace, reconstruction, stereo } = p.config;
  if (!foveation) return JSON.stringify(p.config).replace(/[{}"]/g, " ").trim();
  const share = typeof foveation.samples === "number" && foveation.samples <= 1
    ? `${(100 * foveation.samples).toPrecision(2)} % of the pixels` : `samples: ${foveation.samples}`;
  return `${share}, ${trace.rays} rays, ${trace.bounces} bounces, ${trace.edge_rays} edge rays, law ${foveation.law.name}, `
    + `${reconstruction.method} (k ${reconstruction.k}, ${reconstruction.weights}), ${stereo}`;
};
const told = (element, p) => {
  const name = document.createElement("b");
  name.textContent = p.name;
  element.replaceChildren(name, numbers(p), document.createElement("br"), settings(p));
};

// The viewer: a point's picture over the reference.
const closer = find("#closer"), walk = find("#walk"), wipe = find(".wipe");
const stops = walk.dataset.stops.split(",").filter(Boolean).map(Number);
const pair = (index) => all(`figure[data-point="${index}"] img`);
const choose = (index) => {
  const images = pair(index);
  told(find("#facts"), points[index]);
  find("#config").textContent = JSON.stringify(points[index].config, null, 2);
  find(".panes").hidden = images.length < 2;
  if (images.length >= 2) [wipe.querySelector(".test").src, find(".error img").src] = images.map((i) => i.src);
  all(".mark.chosen").forEach((mark) => mark.classList.remove("chosen"));
  find(`.mark[data-point="${index}"]`)?.classList.add("chosen");
  // The slider stands at the point, or at the one of the front that takes nearest to its time.
  const far = (stop) => Math.abs(Math.log(points[stop].ms / points[index].ms));
  const nearest = stops.reduce((best, stop, at) => (far(stop) < far(stops[best]) ? at : best), 0);
  walk.value = stops.includes(index) ? stops.indexOf(index) : nearest;
};
if (reference) {
  closer.hidden = false;
  find(".wipe .truth").src = reference.src;
  walk.addEventListener("input", () => choose(stops[walk.value]));
  const move = (event) => {
    const box = wipe.getBoundingClientRect();
    const at = Math.min(Math.max((event.clientX - box.left) / box.width, 0), 1);
    wipe.style.setProperty("--at", `${(100 * at).toFixed(1)}%`);
  };
  wipe.addEventListener("pointermove", move);
  wipe.addEventListener("pointerdown", move);
  choose(0);
}

// A point of the chart tells its settings, is shown in the viewer, and opens its row.
const tip = find("#tip"), chart = find(".chart");
for (const mark of all(".mark")) {
  const index = Number(mark.dataset.point);
  const tell = () => {
    told(tip, points[index]);
    tip.hidden = false;
    const box = chart.getBoundingClientRect(), at = mark.querySelector(".shape").getBoundingClientRect();
    const left = at.left - box.left + (at.left - box.left > box.width / 2 ? -tip.offsetWidth - 8 : at.width + 8);
    tip.style.left = `${Math.max(0, Math.min(left, box.width - tip.offsetWidth))}px`;
    tip.style.top = `${Math.max(0, at.top - box.top - tip.offsetHeight / 2)}px`;
  };
  mark.addEventListener("pointerenter", tell);
  mark.addEventListener("focus", tell);
  for (const end of ["pointerleave", "blur"]) mark.addEventListener(end, () => { tip.hidden = true; });
  mark.addEventListener("click", (event) => {
    const row = document.getElementById("p" + index);
    if (row) row.querySelector("details").open = true;
    // The page stays where it is: what was pressed is shown just below.
    if (reference) event.preventDefault();
    choose(index);
  });
}

// A click on a heading sorts all points by it.
const table = find("#points");
const heads = [...table.tHead.rows[0].cells];
heads.forEach((head, column) => head.addEventListener("click", () => {
  const rows = [...table.tBodies[0].rows];
  const key = (row) => {
    const text = row.cells[column].textContent.trim();
    return text !== "" && isFinite(text) ? Number(text) : text;
  };
  const order = (a, b) => (key(a) < key(b) ? -1 : key(a) > key(b) ? 1 : 0);
  const up = head.dataset.up !== "yes";
  heads.forEach((other) => delete other.dataset.up);
  if (up) head.dataset.up = "yes";
  rows.sort((a, b) => (up ? order(a, b) : order(b, a)));
  table.tBodies[0].append(...rows);
}));
