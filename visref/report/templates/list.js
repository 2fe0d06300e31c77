// The list of all objects: only the rows that are in sight are in the page.
for (const root of document.querySelectorAll(".list")) {
  const run = root.dataset.run;
  const find = (name) => root.querySelector(`[data-of="${name}"]`);
  const scroller = find("grid");
  const space = find("space");
  const over = find("over");
  const about = find("about");
  const told = find("told");
  const fields = { search: find("search"), culler: find("culler"), cause: find("cause"), age: find("age"), samples: find("samples") };
  const AGES = { new: (age) => age === 0, young: (age) => age >= 1 && age <= 3, old: (age) => age > 3, right: (age) => age < 0 };
  let data = null;
  let waiting = null;
  let rows = [];
  let order = { by: "samples", up: false };
  let active = -1;
  let chosen = -1;

  const name = (row) => data.names[data.columns.name[row]];
  const VALUES = {
    name,
    culler: (row) => data.cullers[data.columns.culler[row]].shown,
    cause: (row) => data.causes[data.columns.cause[row]] ?? "",
    samples: (row) => data.columns.samples[row],
    frames: (row) => data.columns.frames[row],
    age: (row) => data.columns.age[row],
    frame: (row) => data.columns.frame[row],
  };
  const SHOWN = {
    ...VALUES,
    samples: (row) => page.number.format(VALUES.samples(row)),
    frames: (row) => page.number.format(VALUES.frames(row)),
    age: (row) => (VALUES.age(row) < 0 ? "–" : String(VALUES.age(row))),
    frame: (row) => `${VALUES.frame(row)}${viewOf(row) ? `, ${viewOf(row)}` : ""}`,
    cause: (row) => VALUES.cause(row) || "–",
  };
  const viewOf = (row) => data.views[data.columns.view[row]];

  const filter = () => {
    const words = fields.search.value.toLowerCase().split(/\s+/).filter(Boolean);
    const hits = data.lower.map((text) => words.every((word) => text.includes(word)));
    const culler = fields.culler.value === "" ? null : Number(fields.culler.value);
    const cause = fields.cause.value === "" ? null : Number(fields.cause.value);
    const aged = AGES[fields.age.value];
    const least = Number(fields.samples.value) || 0;
    const { columns } = data;
    rows = [];
    for (let row = 0; row < columns.object.length; row += 1) {
      if (culler !== null && columns.culler[row] !== culler) continue;
      if (cause !== null && columns.cause[row] !== cause) continue;
      if (columns.samples[row] < least) continue;
      if (aged && (columns.hidden[row] || !aged(columns.age[row]))) continue;
      const id = words.length === 1 && words[0] === String(columns.object[row]);
      if (words.length && !id && !hits[columns.name[row]]) continue;
      rows.push(row);
    }
    const value = VALUES[order.by];
    const rank = typeof value(0) === "string"
      ? (a, b) => data.text.compare(value(a), value(b)) : (a, b) => value(a) - value(b);
    const way = order.up ? 1 : -1;
    rows.sort((a, b) => way * rank(a, b) || a - b);
    for (const head of root.querySelectorAll("[role=columnheader]")) {
      head.setAttribute("aria-sort", head.dataset.by !== order.by ? "none" : order.up ? "ascending" : "descending");
    }
    const all = columns.object.length, noun = all === 1 ? "object" : "objects";
    told.textContent = rows.length === all
      ? `${page.number.format(all)} ${noun}` : `${page.number.format(rows.length)} of ${page.number.format(all)} ${noun}`;
    scroller.setAttribute("aria-rowcount", String(rows.length + 1));
    active = rows.indexOf(chosen);
    scroller.scrollTop = 0;
    draw();
  };

  const tall = () => parseFloat(getComputedStyle(scroller).getPropertyValue("--row")) || 34;
  const draw = () => {
    const height = tall();
    space.style.height = `${Math.max(1, rows.length) * height}px`;
    const first = Math.max(0, Math.floor(scroller.scrollTop / height) - 6);
    const last = Math.min(rows.length, Math.ceil((scroller.scrollTop + scroller.clientHeight) / height) + 6);
    const shown = [];
    for (let at = first; at < last; at += 1) shown.push(line(at, height));
    space.replaceChildren(...shown);
    if (!rows.length) {
      space.append(page.make("div", { role: "row", class: "none" },
        page.make("div", { role: "gridcell" }, "No object is like that.")));
    }
    const there = active >= first && active < last;
    if (there) scroller.setAttribute("aria-activedescendant", idOf(active));
    else scroller.removeAttribute("aria-activedescendant");
  };
  const idOf = (at) => `${run}-object-${at}`;
  const line = (at, height) => {
    const row = rows[at];
    const element = page.make("div", {
      role: "row", id: idOf(at), "aria-rowindex": String(at + 2), class: "row",
      "aria-selected": String(row === chosen), "data-at": String(at), "data-row": String(row),
      style: `top: ${at * height}px`,
    });
    if (at === active) element.classList.add("active");
    for (const [by, text] of Object.entries(SHOWN)) {
      element.append(page.make("div", { role: "gridcell", "data-by": by, title: by === "name" || by === "cause" ? text(row) : "" }, text(row)));
    }
    return element;
  };

  const move = (to) => {
    if (!rows.length) return;
    active = Math.min(Math.max(to, 0), rows.length - 1);
    const height = tall();
    const top = active * height;
    if (top < scroller.scrollTop) scroller.scrollTop = top;
    // The headings cover the first rows of what is in sight.
    const least = top + height + over.offsetHeight - scroller.clientHeight;
    if (least > scroller.scrollTop) scroller.scrollTop = least;
    draw();
  };
  const open = (at) => {
    if (at < 0 || at >= rows.length) return;
    page.go(placeOf(rows[at]));
  };
  const placeOf = (row) => ({
    run: run === "run0" ? undefined : run,
    frame: data.columns.frame[row],
    view: viewOf(row),
    culler: data.cullers[data.columns.culler[row]].name,
    // An object's name, where no other has it.
    object: data.twice[data.columns.name[row]] > 1 ? String(data.columns.object[row]) : name(row),
  });

  // One object in full.
  const tell = (row, wanted) => {
    const its = (column) => data.columns[column][row];
    const culler = data.cullers[its("culler")];
    const [frame, view] = [its("frame"), viewOf(row)];
    const where = `frame ${frame}${view ? `, view ${view}` : ""}`;
    const hidden = its("hidden") === 1;
    const facts = page.make("dl", { class: "told" });
    const say = (term, ...content) => facts.append(page.make("div", {},
      page.make("dt", {}, term), page.make("dd", {}, ...content)));
    say("culler", page.make("code", {}, culler.shown),
      hidden || culler.convicts ? ": a violation" : ": measured, not convicted");
    if (hidden) {
      say("found", data.whys[its("why")]);
    } else {
      const partly = its("partly");
      say("lost", `${page.number.format(its("samples"))} samples over ${page.number.format(its("frames"))} frame${its("frames") === 1 ? "" : "s"}`
        + (partly ? `, in ${page.number.format(partly)} of ${page.number.format(its("misses"))} cases partly` : ""));
      say("worst in", `${where}: ${page.number.format(its("pixels"))} of ${page.number.format(its("owned"))} samples that it owns there`);
      const why = data.whys[its("why")];
      say(why ? "behaves as if" : "cause", why || "none is known");
      say("age", its("age") < 0 ? "in view by right" : its("age") === 0 ? "0: it came into view in that frame" : `in view for ${its("age")} frame${its("age") === 1 ? "" : "s"}`);
      say("witness", `pixel (${its("x")}, ${its("y")}), depth ${its("depth")}, object ${its("object")}, triangle ${its("triangle")}`
        + (its("margin") < 0 ? "" : `; it holds for at least ${its("margin")} px around`));
      if (data.facts[its("facts")]) say("around it", data.facts[its("facts")]);
      const command = page.make("code", {}, `${data.command} --frame ${frame} --object ${its("object")}`);
      say("explain it", command);
    }
    const pictures = page.make("div", { class: "seen" });
    const crop = data.crops[its("crop")];
    if (crop) pictures.append(page.crop(crop, name(row)));
    // Of the frame that was asked for, else of its worst, else of another in which it is lost.
    const browser = page.browsers.get(run);
    const imageOf = (where) => where && [...(browser?.pictures(culler.name, ...where)?.querySelectorAll(".own.drawn") ?? [])]
      .find((one) => one.dataset.cullerName === culler.name)?.querySelector("img");
    const places = [wanted, its("pictured") < 0 ? null : data.pictures[its("pictured")].slice(0, 2)];
    const at = places.find((one) => imageOf(one));
    // Where no picture has what this culler drew, the scene as it ought to be seen.
    const scene = browser?.scene(frame, view);
    if (at) pictures.append(whole(imageOf(at), ...at, its, at[0] === frame && at[1] === view, row, at === wanted));
    else if (scene && !hidden) pictures.append(whole(scene, frame, view, its, true, row, false, true));
    else pictures.append(without(culler.name, frame, Boolean(crop), hidden));
    const head = page.make("h3", { tabindex: "-1" }, name(row));
    const link = page.make("a", { href: page.link(placeOf(row)), class: "permalink" }, "Link to this");
    about.replaceChildren(head, facts, pictures, link);
    about.hidden = false;
  };
  // What there is where no picture of the page shows it.
  const without = (culler, frame, cropped, hidden) => {
    const near = page.browsers.get(run)?.around(culler, frame);
    const said = page.make("p", { class: "more" }, cropped || hidden
      ? `Frame ${frame} has no picture of all of it on the page.`
      : "The page has no picture of it: the command draws one from the run folder.");
    if (near) {
      const off = Math.abs(near.frame - frame);
      const where = off ? `, ${page.number.format(off)} frame${off === 1 ? "" : "s"} ${near.frame < frame ? "before" : "after"}` : "";
      said.append(" Of the frames that have pictures, in which it need not be lost, the nearest is ", page.make("a", {
        href: page.link({ run: run === "run0" ? undefined : run, culler, frame: near.frame, view: near.view }),
      }, `frame ${near.frame}${near.view ? `, view ${near.view}` : ""}${where}`), ".");
    }
    return said;
  };
  // The frame's picture, with a mark at the sample.
  const whole = (image, frame, view, its, worst, row, asked, ought = false) => {
    const picture = page.make("img", { src: image.currentSrc || image.dataset.src || image.src, alt: `Frame ${frame}${view ? `, view ${view}` : ""}: ${ought ? "the scene as it ought to be seen" : "who was drawn"}${worst ? `, with a ring where ${name(row)} was lost` : ""}` });
    const stack = page.make("div", { class: "stack whole" }, picture);
    const size = data.sizes[`${frame} ${view}`] ?? data.sizes[""];
    if (worst && its("x") >= 0 && size) {
      const mark = page.make("i", { class: "mark", "aria-hidden": "true" });
      mark.style.left = `${(its("x") + 0.5) / size[0] * 100}%`;
      mark.style.top = `${(its("y") + 0.5) / size[1] * 100}%`;
      stack.append(mark);
    }
    const go = page.make("a", { href: page.link({ run: run === "run0" ? undefined : run, culler: data.cullers[its("culler")].name, frame, view }) }, `All pictures of frame ${frame}${view ? `, view ${view}` : ""}`);
    const note = ought ? " This is what ought to be seen, with the sample ringed; what was drawn has no picture on the page."
      : worst ? "" : asked ? ` Its worst frame is ${its("frame")}.`
      : " Its worst frame has no picture on the page; it is lost in this one too.";
    return page.make("figure", { class: "framed" }, stack, page.make("figcaption", {}, go, note));
  };

  const ready = () => {
    waiting ??= page.unpacked(find("data")).then((found) => {
      data = found;
      data.lower = data.names.map((text) => text.toLowerCase());
      data.text = new Intl.Collator("en", { numeric: true });
      data.twice = new Array(data.names.length).fill(0);
      const ids = new Map();
      data.columns.object.forEach((object, row) => {
        const key = data.columns.name[row];
        if (!ids.has(key)) ids.set(key, new Set());
        ids.get(key).add(object);
      });
      for (const [key, its] of ids) data.twice[key] = its.size;
      data.cullers.forEach((culler, number) => {
        if (data.columns.culler.includes(number)) {
          fields.culler.append(page.make("option", { value: String(number) }, culler.shown));
        }
      });
      data.causes.forEach((text, number) => {
        fields.cause.append(page.make("option", { value: String(number) }, text || "none known"));
      });
      find("whole").hidden = false;
      root.classList.add("ready");
      filter();
      page.follow();
    }).catch(() => {
      told.textContent = "This browser cannot unpack the list (it has no DecompressionStream); objects.parquet has it.";
    });
    return waiting;
  };
  const follow = (place) => {
    if (!data || place.object === undefined) return null;
    const { columns } = data;
    let best = -1;
    columns.object.forEach((object, row) => {
      if (name(row) !== place.object && String(object) !== place.object) return;
      if (place.culler !== undefined && data.cullers[columns.culler[row]].name !== place.culler) return;
      if (best < 0 || columns.samples[row] > columns.samples[best]) best = row;
    });
    if (best < 0) return null;
    chosen = best;
    tell(best, place.frame === undefined ? null : [Number(place.frame), place.view ?? viewOf(best)]);
    if (!rows.includes(best)) {
      for (const field of Object.values(fields)) field.value = "";
      filter();
    }
    move(rows.indexOf(best));
    const [x, y] = [columns.x[best], columns.y[best]];
    return {
      culler: data.cullers[columns.culler[best]].name, frame: columns.frame[best], view: viewOf(best),
      object: columns.object[best], hidden: columns.hidden[best] === 1, x, y, depth: columns.depth[best],
      show: () => {
        if (scroller.contains(document.activeElement)) about.scrollIntoView({ block: "nearest" });
        else { about.scrollIntoView({ block: "start" }); about.querySelector("h3").focus({ preventScroll: true }); }
      },
    };
  };

  let soon = 0;
  for (const field of Object.values(fields)) {
    field.addEventListener("input", () => { cancelAnimationFrame(soon); soon = requestAnimationFrame(filter); });
  }
  fields.search.addEventListener("keydown", (event) => {
    if (event.key === "ArrowDown") { event.preventDefault(); scroller.focus(); move(Math.max(active, 0)); }
    if (event.key === "Enter" && rows.length) open(Math.max(active, 0));
  });
  for (const button of root.querySelectorAll("[role=columnheader] button")) {
    button.addEventListener("click", () => {
      const { by } = button.parentElement.dataset;
      const text = by === "name" || by === "culler" || by === "cause" || by === "frame";
      order = { by, up: order.by === by ? !order.up : text };
      filter();
    });
  }
  scroller.addEventListener("scroll", () => requestAnimationFrame(draw));
  addEventListener("resize", () => { if (data) draw(); });
  scroller.addEventListener("click", (event) => {
    const row = event.target.closest(".row");
    if (row) { active = Number(row.dataset.at); open(active); }
  });
  scroller.addEventListener("keydown", (event) => {
    if (event.target !== scroller) return;
    const step = Math.max(1, Math.floor(scroller.clientHeight / tall()) - 1);
    const to = {
      ArrowDown: active + 1, ArrowUp: active - 1, PageDown: active + step, PageUp: active - step,
      Home: 0, End: rows.length - 1,
    }[event.key];
    if (to !== undefined) { event.preventDefault(); move(to); }
    if (event.key === "Enter" || event.key === " ") { event.preventDefault(); open(active); }
    if (event.key === "/") { event.preventDefault(); fields.search.focus(); }
  });
  page.lists.set(run, { follow, ready });
  ready();
}
