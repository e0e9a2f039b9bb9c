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
  seen.tabIndex = 0;
  seen.addEventListener("pointerdown", show(reference.src));
  seen.addEventListener("keydown", (event) => { if (event.key === "Enter") show(reference.src)(); });
  for (const end of ["keyup", "blur"]) seen.addEventListener(end, show(own));
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
  wipe.addEventListener("keydown", (event) => {
    const step = { ArrowLeft: -5, ArrowDown: -5, ArrowRight: 5, ArrowUp: 5 }[event.key];
    if (!step) return;
    const at = Math.min(Math.max(parseFloat(wipe.style.getPropertyValue("--at") || "50") + step, 0), 100);
    wipe.style.setProperty("--at", `${at}%`);
    wipe.setAttribute("aria-valuenow", at);
    event.preventDefault();
  });
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
heads.forEach((head) => {
  head.tabIndex = 0;
  head.addEventListener("keydown", (event) => { if (event.key === "Enter") head.click(); });
});
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

// Other axes: marks move, and the lines that hold for time and score alone go.
const svg = find("#chart"), area = { left: 56, right: 844, top: 16, bottom: 392 };
const homes = new Map(all(".mark").map((mark) => {
  const box = mark.querySelector(".shape").getBBox();
  return [mark, [box.x + box.width / 2, box.y + box.height / 2]];
}));
const usual = svg.querySelector(".axes").innerHTML;
const element = (name, attributes, text) => {
  const made = document.createElementNS("http://www.w3.org/2000/svg", name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  if (text !== undefined) made.textContent = text;
  return made;
};
const scale = (key, low, high) => {
  const log = ["ms", "samples", "rays", "relmse"].includes(key), form = (v) => (log ? Math.log(Math.max(v, 1e-6)) : v);
  const values = [...homes.keys()].map((mark) => form(points[mark.dataset.point][key]));
  const least = Math.min(...values), pad = 0.06 * (Math.max(...values) - least) || 0.5;
  const from = least - pad, to = Math.max(...values) + pad;
  const ticks = [0.1, 0.3, 0.5, 0.7, 0.9].map((t) => from + t * (to - from));
  return {
    place: (v) => low + (form(v) - from) / (to - from) * (high - low),
    ticks: ticks.map((t) => Number((log ? Math.exp(t) : t).toPrecision(3))),
  };
};
const axis = (name) => find(`#axis-${name}`);
const redraw = () => {
  const [x, y] = [axis("x"), axis("y")], home = x.value === "ms" && y.value === "score";
  const axes = svg.querySelector(".axes");
  for (const line of svg.querySelectorAll(".front, .whisker")) line.style.display = home ? "" : "none";
  if (home) {
    axes.innerHTML = usual;
    for (const mark of homes.keys()) mark.removeAttribute("transform");
    return;
  }
  const across = scale(x.value, area.left, area.right), up = scale(y.value, area.bottom, area.top);
  axes.replaceChildren();
  for (const tick of across.ticks) {
    axes.append(element("path", { d: `M${across.place(tick)} ${area.bottom}V${area.top}` }),
      element("text", { x: across.place(tick), y: area.bottom + 18, "text-anchor": "middle" }, tick));
  }
  for (const tick of up.ticks) {
    axes.append(element("path", { d: `M${area.left} ${up.place(tick)}H${area.right}` }),
      element("text", { x: area.left - 8, y: up.place(tick) + 4, "text-anchor": "end" }, tick));
  }
  const named = (select) => select.selectedOptions[0].textContent;
  axes.append(element("text", { x: 450, y: 432, "text-anchor": "middle" }, named(x)),
    element("text", { transform: "translate(12 204) rotate(-90)", "text-anchor": "middle" }, named(y)));
  for (const [mark, [left, top]] of homes) {
    const p = points[mark.dataset.point];
    mark.setAttribute("transform", `translate(${across.place(p[x.value]) - left} ${up.place(p[y.value]) - top})`);
  }
};
for (const name of ["x", "y"]) axis(name).addEventListener("change", redraw);

// The chart as a file of its own, with the page's styles and where it comes from.
const drawing = () => {
  const copy = svg.cloneNode(true);
  copy.setAttribute("width", 860);
  copy.setAttribute("height", 440);
  copy.prepend(element("desc", {}, all("dl dt").map((dt) => `${dt.textContent}: ${dt.nextElementSibling.textContent}`).join("\n")),
    element("style", {}, find("style").textContent + "svg { background: var(--paper); }"));
  return new XMLSerializer().serializeToString(copy);
};
const save = (blob, name) => {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(blob);
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 1000);
};
find("#save-svg").addEventListener("click", () => save(new Blob([drawing()], { type: "image/svg+xml" }), "trade.svg"));
find("#save-png").addEventListener("click", () => {
  const image = new Image();
  image.onload = () => {
    const canvas = document.createElement("canvas");
    [canvas.width, canvas.height] = [1720, 880];
    canvas.getContext("2d").drawImage(image, 0, 0, 1720, 880);
    canvas.toBlob((blob) => save(blob, "trade.png"));
  };
  image.src = "data:image/svg+xml;charset=utf-8," + encodeURIComponent(drawing());
});
