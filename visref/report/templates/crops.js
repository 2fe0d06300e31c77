// What lies around a lost sample: what ought to be seen over what was drawn, on one spot.
page.crop = (crop, lostName) => {
  const [width, height] = crop.size;
  const cells = (runs) => {
    const found = new Uint16Array(width * height);
    let at = 0;
    for (let i = 0; i < runs.length; i += 2) found.fill(runs[i + 1], at, at += runs[i]);
    return found;
  };
  const layers = { truth: cells(crop.truth), drawn: cells(crop.drawn) };
  const zoom = Math.max(1, Math.floor(384 / Math.max(width, height)));
  const missed = getComputedStyle(document.documentElement).getPropertyValue("--missed");
  const lost = layers.truth.map((look) => crop.looks[look][2]);
  const painted = (layer, what) => {
    const canvas = page.make("canvas", { width: width * zoom, height: height * zoom, class: what });
    const pen = canvas.getContext("2d");
    for (let cell = 0; cell < width * height; cell += 1) {
      const [colour, name] = crop.looks[layer[cell]];
      const x = cell % width;
      const y = (cell - x) / width;
      const gone = what === "truth" && lost[cell];
      pen.fillStyle = gone ? missed : colour || (name < 0 ? "#dfe9f3" : "#b9bec4");
      pen.fillRect(x * zoom, y * zoom, zoom, zoom);
      // The outline of what was lost stands in both.
      if (!lost[cell] || zoom < 3) continue;
      pen.fillStyle = "#8a2c00";
      if (x && !lost[cell - 1]) pen.fillRect(x * zoom, y * zoom, 1, zoom);
      if (x + 1 < width && !lost[cell + 1]) pen.fillRect((x + 1) * zoom - 1, y * zoom, 1, zoom);
      if (y && !lost[cell - width]) pen.fillRect(x * zoom, y * zoom, zoom, 1);
      if (y + 1 < height && !lost[cell + width]) pen.fillRect(x * zoom, (y + 1) * zoom - 1, zoom, 1);
    }
    return canvas;
  };
  const truth = painted(layers.truth, "truth");
  const drawn = painted(layers.drawn, "drawn");
  const stack = page.make("div", { class: "stack", role: "img" }, truth, drawn);
  stack.setAttribute("aria-label",
    `Around ${lostName}: what ought to be seen, with what was lost in vermilion, and over it what `
    + `was drawn. To be seen: ${named(layers.truth)}. Drawn: ${named(layers.drawn)}.`);
  const caption = page.make("figcaption");
  const said = page.make("output");
  const slider = page.make("input", {
    type: "range", min: "0", max: "100", value: "50", "aria-label": "Truth against drawn",
  });
  const blink = page.make("button", { type: "button", "aria-pressed": "false" }, "Blink");
  const wide = page.make("button", { type: "button", "aria-pressed": "false" }, "Zoom");
  let timer = 0;

  function named(layer) {
    const names = new Set([...new Set(layer)].map((look) => nameOf(look)));
    return [...names].slice(0, 6).join(", ");
  }
  function nameOf(look) {
    const [, name] = crop.looks[look];
    return name < 0 ? "background or others" : crop.names[name];
  }
  const set = (value) => {
    slider.value = String(value);
    // What was drawn lies over the truth, to the right of the slider.
    drawn.style.clipPath = `inset(0 0 0 ${value}%)`;
    stack.style.setProperty("--at", `${value}%`);
    slider.setAttribute("aria-valuetext", `${value} % truth, ${100 - value} % drawn`);
  };
  const stop = () => {
    clearInterval(timer);
    timer = 0;
    blink.setAttribute("aria-pressed", "false");
  };
  slider.addEventListener("input", () => { stop(); set(Number(slider.value)); });
  blink.addEventListener("click", () => {
    if (timer) { stop(); set(50); return; }
    let on = false;
    const turn = () => {
      if (!stack.isConnected) { stop(); return; }
      on = !on;
      set(on ? 100 : 0);
    };
    blink.setAttribute("aria-pressed", "true");
    timer = setInterval(turn, 600);
    turn();
  });
  const figure = page.make("figure", { class: "compare" });
  wide.addEventListener("click", () => {
    wide.setAttribute("aria-pressed", String(figure.classList.toggle("wide")));
  });
  const tell = (event) => {
    const box = stack.getBoundingClientRect();
    const x = Math.floor((event.clientX - box.left) / box.width * width);
    const y = Math.floor((event.clientY - box.top) / box.height * height);
    if (x < 0 || y < 0 || x >= width || y >= height) return;
    const cell = y * width + x;
    const [left, top, step] = crop.at;
    said.textContent = `pixel (${left + x * step}, ${top + y * step}): ${nameOf(layers.truth[cell])}`
      + `${lost[cell] ? ", lost" : ""}; drawn: ${nameOf(layers.drawn[cell])}`;
  };
  stack.addEventListener("pointermove", tell);
  stack.addEventListener("pointerdown", tell);
  caption.append(
    page.make("span", { class: "ends" }, page.make("span", {}, "what ought to be seen"), page.make("span", {}, "what was drawn")),
    slider, blink, wide, said);
  figure.append(stack, caption);
  // At first through the middle of what was lost, so that both sides show some of it.
  const columns = [...lost.keys()].filter((cell) => lost[cell]).map((cell) => cell % width);
  set(columns.length ? Math.round((Math.min(...columns) + Math.max(...columns) + 1) / 2 / width * 100) : 50);
  return figure;
};
