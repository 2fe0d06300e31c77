"use strict";
(() => {
  // The frame browser: one frame and one culler at a time. Without it the page shows them all.
  const browsers = new Map();
  for (const root of document.querySelectorAll(".browser")) {
    const articles = [...root.querySelectorAll(".frame")];
    const tabs = [...root.querySelectorAll(".tabs button")].filter(
      (tab) => root.querySelector(`.own[data-culler="${tab.dataset.culler}"]`));
    const slider = root.querySelector("input");
    const output = root.querySelector("output");
    let culler = null;
    let frame = null;

    const framesOf = (id) => articles
      .filter((article) => article.querySelector(`.own[data-culler="${id}"]`))
      .map((article) => Number(article.dataset.frame));
    const nearest = (frames, wanted) => frames.reduce(
      (best, one) => (Math.abs(one - wanted) < Math.abs(best - wanted) ? one : best));

    const show = (wantedCuller, wantedFrame) => {
      culler = wantedCuller;
      const frames = framesOf(culler);
      frame = nearest(frames, wantedFrame);
      for (const article of articles) article.hidden = Number(article.dataset.frame) !== frame;
      for (const own of root.querySelectorAll(".own")) own.hidden = own.dataset.culler !== culler;
      for (const tab of tabs) tab.setAttribute("aria-pressed", String(tab.dataset.culler === culler));
      slider.max = String(frames.length - 1);
      slider.value = String(frames.indexOf(frame));
      output.textContent = `Frame ${frame} (${frames.indexOf(frame) + 1} of ${frames.length})`;
      for (const step of root.querySelectorAll(".step")) {
        const next = frames.indexOf(frame) + Number(step.dataset.step);
        step.disabled = next < 0 || next >= frames.length;
      }
    };

    for (const tab of root.querySelectorAll(".tabs button")) {
      if (!tabs.includes(tab)) tab.remove();
      tab.addEventListener("click", () => show(tab.dataset.culler, frame));
    }
    slider.addEventListener("input", () => show(culler, framesOf(culler)[Number(slider.value)]));
    for (const step of root.querySelectorAll(".step")) {
      step.addEventListener("click", () => {
        const frames = framesOf(culler);
        show(culler, frames[frames.indexOf(frame) + Number(step.dataset.step)]);
      });
    }
    // A picture of few samples is enlarged: show the samples as squares.
    for (const image of root.querySelectorAll("img")) {
      const mark = () => image.classList.toggle("small", image.naturalWidth < 400);
      if (image.complete) mark(); else image.addEventListener("load", mark);
    }
    for (const zoom of root.querySelectorAll(".zoom")) {
      zoom.addEventListener("click", () => zoom.parentElement.classList.toggle("wide"));
    }
    if (!tabs.length) continue;
    root.classList.add("live");
    root.querySelector(".controls").hidden = false;
    show(root.dataset.startCuller, Number(root.dataset.startFrame));
    browsers.set(root.id, {
      show,
      nearest: (wanted) => show(culler, wanted),
      culler: (name) => tabs.find((tab) => tab.dataset.cullerName === name),
    });
  }

  // Links from a loss to its frame.
  for (const link of document.querySelectorAll("[data-go-frame]")) {
    link.addEventListener("click", () => {
      const browser = browsers.get(link.getAttribute("href").slice(1).replace("-frames", "-browser"));
      const tab = browser && browser.culler(link.dataset.goCuller);
      if (tab) browser.show(tab.dataset.culler, Number(link.dataset.goFrame));
    });
  }

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
      head.textContent = `Frame ${plot.frames[index]}`;
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
      const browser = browsers.get(`${figure.parentElement.dataset.run}-browser`);
      if (browser) browser.nearest(plot.frames[indexAt(event)]);
    });
  }

  // Copying a command.
  for (const button of document.querySelectorAll(".copy")) {
    if (!navigator.clipboard) continue;
    button.hidden = false;
    button.addEventListener("click", async () => {
      await navigator.clipboard.writeText(button.previousElementSibling.textContent);
      button.textContent = "Copied";
    });
  }
})();
