// Shows a frame's figures under the pointer, and enlarges pictures. The page is complete without it.
"use strict";
(() => {
  const report = JSON.parse(document.getElementById("report").textContent);
  const plot = { left: 58, right: 546, top: 14, bottom: 200 };
  const value = (frame, key) => {
    const parts = [frame, frame.full_detail, frame.culling].filter(Boolean);
    const part = parts.find((p) => key in p);
    return part ? part[key] : null;
  };
  const text = (v) => (v === null || v === undefined ? "not measured" : v.toLocaleString(undefined, { maximumFractionDigits: 3 }));

  const tip = document.createElement("div");
  tip.id = "tip";
  tip.hidden = true;
  document.body.append(tip);

  for (const svg of document.querySelectorAll("svg[data-keys]")) {
    const keys = svg.dataset.keys.split(" ");
    const low = Number(svg.dataset.low);
    const high = Number(svg.dataset.high);
    const cursor = document.createElementNS(svg.namespaceURI, "line");
    cursor.setAttribute("class", "cursor");
    cursor.setAttribute("y1", plot.top);
    cursor.setAttribute("y2", plot.bottom);
    const clear = () => { cursor.remove(); tip.hidden = true; };
    svg.addEventListener("pointerleave", clear);
    svg.addEventListener("pointermove", (event) => {
      const box = svg.getBoundingClientRect();
      const x = ((event.clientX - box.left) / box.width) * svg.viewBox.baseVal.width;
      if (x < plot.left - 8 || x > plot.right + 8) return clear();
      const at = low + ((x - plot.left) / (plot.right - plot.left)) * (high - low);
      const near = report.frames.reduce((a, b) => (Math.abs(b.frame - at) < Math.abs(a.frame - at) ? b : a));
      const place = plot.left + ((near.frame - low) / (high - low)) * (plot.right - plot.left);
      cursor.setAttribute("x1", place);
      cursor.setAttribute("x2", place);
      svg.append(cursor);
      tip.textContent = [`frame ${near.frame}`, ...keys.map((key) => `${key}  ${text(value(near, key))}`)].join("\n");
      tip.hidden = false;
      tip.style.left = `${Math.min(event.clientX + 16, innerWidth - tip.offsetWidth - 8)}px`;
      tip.style.top = `${Math.min(event.clientY + 16, innerHeight - tip.offsetHeight - 8)}px`;
    });
  }

  for (const button of document.querySelectorAll(".zoom")) {
    button.addEventListener("click", () => button.closest("figure").classList.toggle("large"));
  }
})();
