// Plots: the pointer reads out a frame's numbers; a click goes to the nearest pictured frame.
for (const figure of document.querySelectorAll(".plot")) {
  const plot = JSON.parse(figure.dataset.plot);
  const svg = figure.querySelector("svg");
  const cursor = svg.querySelector(".cursor");
  const readout = figure.querySelector(".readout");
  const first = plot.frames[0];
  const span = plot.frames[plot.frames.length - 1] - first;
  const xOf = (frame) => plot.left + (span ? (frame - first) / span : 0.5) * (plot.right - plot.left);
  const format = new Intl.NumberFormat("en", { maximumSignificantDigits: 6 });
  const indexAt = (event) => {
    const box = svg.getBoundingClientRect();
    const x = (event.clientX - box.left) / box.width * svg.viewBox.baseVal.width;
    return plot.frames.reduce((best, frame, index) =>
      (Math.abs(xOf(frame) - x) < Math.abs(xOf(plot.frames[best]) - x) ? index : best), 0);
  };
  const line = (label, style, value) => {
    const row = document.createElement("p");
    const ns = "http://www.w3.org/2000/svg";
    const swatch = document.createElementNS(ns, "svg");
    swatch.setAttribute("class", "swatch");
    swatch.setAttribute("viewBox", "0 0 22 8");
    const mark = document.createElementNS(ns, style < 0 ? "rect" : "line");
    const shape = style < 0 ? { class: "area", width: 22, height: 8 }
      : { class: `line s${style % 16}`, x1: 1, x2: 21, y1: 4, y2: 4 };
    for (const [name, text] of Object.entries(shape)) mark.setAttribute(name, text);
    swatch.append(mark);
    const name = document.createElement("code");
    name.textContent = label;
    const number = document.createElement("b");
    number.textContent = format.format(value);
    row.append(swatch, name, number);
    return row;
  };
  svg.addEventListener("pointermove", (event) => {
    const index = indexAt(event);
    const x = xOf(plot.frames[index]);
    cursor.classList.add("on");
    cursor.setAttribute("x1", x);
    cursor.setAttribute("x2", x);
    const head = document.createElement("p");
    head.textContent = `${plot.along[0].toUpperCase()}${plot.along.slice(1)} ${plot.frames[index]}`;
    readout.replaceChildren(head, ...plot.lines
      .filter((one) => one.values[index] !== null)
      .map((one) => line(one.label, one.style, one.values[index])));
    const left = x < (plot.left + plot.right) / 2;
    readout.style.left = left ? "auto" : "12%";
    readout.style.right = left ? "0" : "auto";
    readout.hidden = false;
  });
  svg.addEventListener("pointerleave", () => {
    readout.hidden = true;
    cursor.classList.remove("on");
  });
  svg.addEventListener("click", (event) => {
    if (plot.along !== "frame") return;
    page.browsers.get(figure.parentElement.dataset.run)?.nearest(plot.frames[indexAt(event)]);
  });
}
