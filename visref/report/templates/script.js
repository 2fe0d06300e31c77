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
    let article = null;

    const articlesOf = (id) => articles
      .filter((one) => one.querySelector(`.own[data-culler="${id}"]`));
    // The nearest frame, and of that the wanted view, else its first.
    const nearest = (list, frame, view) => {
      const off = (one) => Math.abs(Number(one.dataset.frame) - frame);
      const other = (one) => Number(one.dataset.view !== view);
      return list.reduce((best, one) => (
        off(one) < off(best) || (off(one) === off(best) && other(one) < other(best)) ? one : best));
    };

    const show = (wantedCuller, frame, view) => {
      culler = wantedCuller;
      const list = articlesOf(culler);
      article = nearest(list, frame, view);
      for (const one of articles) one.hidden = one !== article;
      for (const own of root.querySelectorAll(".own")) own.hidden = own.dataset.culler !== culler;
      for (const tab of tabs) tab.setAttribute("aria-pressed", String(tab.dataset.culler === culler));
      const place = list.indexOf(article);
      slider.max = String(list.length - 1);
      slider.value = String(place);
      output.textContent = `${article.dataset.title} (${place + 1} of ${list.length})`;
      for (const step of root.querySelectorAll(".step")) {
        const next = place + Number(step.dataset.step);
        step.disabled = next < 0 || next >= list.length;
      }
    };
    const at = (one) => show(culler, Number(one.dataset.frame), one.dataset.view);

    for (const tab of root.querySelectorAll(".tabs button")) {
      if (!tabs.includes(tab)) tab.remove();
      tab.addEventListener("click", () => show(
        tab.dataset.culler, Number(article.dataset.frame), article.dataset.view));
    }
    slider.addEventListener("input", () => at(articlesOf(culler)[Number(slider.value)]));
    for (const step of root.querySelectorAll(".step")) {
      step.addEventListener("click", () => {
        const list = articlesOf(culler);
        at(list[list.indexOf(article) + Number(step.dataset.step)]);
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
    show(root.dataset.startCuller, Number(root.dataset.startFrame), root.dataset.startView);
    browsers.set(root.id, {
      show,
      nearest: (wanted) => show(culler, wanted, article.dataset.view),
      culler: (name) => tabs.find((tab) => tab.dataset.cullerName === name),
    });
  }

  // Links from a loss to its frame.
  for (const link of document.querySelectorAll("[data-go-frame]")) {
    link.addEventListener("click", () => {
      const browser = browsers.get(link.getAttribute("href").slice(1).replace("-frames", "-browser"));
      const tab = browser && browser.culler(link.dataset.goCuller);
      if (tab) {
        browser.show(tab.dataset.culler, Number(link.dataset.goFrame), link.dataset.goView);
      }
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
