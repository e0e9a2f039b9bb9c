"use strict";
// Pressing on a picture shows the reference in its place.
const reference = document.getElementById("reference");
for (const seen of document.querySelectorAll(".seen")) {
  const img = seen.querySelector("img");
  const own = img.src;
  const show = (source) => () => { img.src = source; };
  if (!reference) continue;
  seen.addEventListener("pointerdown", show(reference.src));
  for (const end of ["pointerup", "pointerleave", "pointercancel"]) seen.addEventListener(end, show(own));
}
// A point of the chart opens its row.
for (const mark of document.querySelectorAll(".mark")) {
  mark.addEventListener("click", () => {
    const row = document.getElementById("p" + mark.dataset.point);
    if (row) row.querySelector("details").open = true;
  });
}
// A click on a heading sorts all points by it.
const table = document.getElementById("points");
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
