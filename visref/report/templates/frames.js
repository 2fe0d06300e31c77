// The frame browser: one frame and one culler at a time. Without it the page shows them all.
for (const root of document.querySelectorAll(".browser")) {
  const run = root.dataset.run;
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
    const said = `${article.dataset.title} (${place + 1} of ${list.length})`;
    output.textContent = said;
    slider.setAttribute("aria-valuetext", said);
    for (const step of root.querySelectorAll(".step")) {
      const next = place + Number(step.dataset.step);
      step.disabled = next < 0 || next >= list.length;
    }
    for (const image of article.querySelectorAll("img[data-src]")) {
      image.src = image.dataset.src;
    }
  };
  const named = (name) => tabs.find((tab) => tab.dataset.cullerName === name);
  const nameOf = (id) => tabs.find((tab) => tab.dataset.culler === id)?.dataset.cullerName;
  const turn = (id, frame, view) => {
    show(id, frame, view);
    page.note({ run, culler: nameOf(id), frame: article.dataset.frame, view: article.dataset.view });
  };
  const at = (one) => turn(culler, Number(one.dataset.frame), one.dataset.view);

  for (const tab of root.querySelectorAll(".tabs button")) {
    if (!tabs.includes(tab)) tab.remove();
    tab.addEventListener("click", () => turn(
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
    zoom.addEventListener("click", () => {
      const wide = zoom.parentElement.classList.toggle("wide");
      zoom.setAttribute("aria-expanded", String(wide));
    });
  }
  // Whose the part of a picture is that the pointer is at.
  for (const one of articles) {
    const element = one.querySelector(".owners");
    if (!element) continue;
    const said = one.querySelector(".under");
    let owners = null;
    const unpack = () => (owners ??= page.unpacked(element).then((found) => {
      const cells = new Uint32Array(found.width * found.height);
      let at = 0;
      for (let i = 0; i < found.runs.length; i += 2) cells.fill(found.runs[i + 1], at, at += found.runs[i]);
      return { ...found, cells };
    }));
    const name = async (event) => {
      if (!(event.target instanceof HTMLImageElement)) return;
      const box = event.target.getBoundingClientRect();
      const x = (event.clientX - box.left) / box.width;
      const y = (event.clientY - box.top) / box.height;
      const map = await unpack();
      const column = Math.min(map.width - 1, Math.max(0, Math.floor(x * map.width)));
      const row = Math.min(map.height - 1, Math.max(0, Math.floor(y * map.height)));
      said.textContent = `At the pointer: ${map.names[map.cells[row * map.width + column]]}`;
    };
    one.addEventListener("pointermove", name);
    one.addEventListener("pointerdown", name);
  }
  if (!tabs.length) continue;
  root.classList.add("live");
  root.querySelector(".controls").hidden = false;
  show(root.dataset.startCuller, Number(root.dataset.startFrame), root.dataset.startView);
  page.browsers.set(run, {
    root,
    goTo: (name, frame, view) => show(named(name)?.dataset.culler ?? culler, frame, view),
    nearest: (wanted) => turn(culler, wanted, article.dataset.view),
    // Of the frames that have a culler's pictures the one nearest to this.
    around: (name, wanted) => {
      const list = named(name) ? articlesOf(named(name).dataset.culler) : [];
      const one = list.length ? nearest(list, wanted, "") : null;
      return one && { frame: Number(one.dataset.frame), view: one.dataset.view };
    },
    // The scene in a frame and view, which hangs on no culler.
    scene: (frame, view) => articles.find((one) =>
      Number(one.dataset.frame) === frame && one.dataset.view === view)
      ?.querySelector("figure.picture:not(.own) img"),
    // The pictures of a frame, view and culler, where the page has them.
    pictures: (name, frame, view) => {
      const id = named(name)?.dataset.culler;
      const found = articles.find((one) =>
        Number(one.dataset.frame) === frame && one.dataset.view === view);
      return found && found.querySelector(`.own[data-culler="${id}"]`) ? found : null;
    },
  });
}
