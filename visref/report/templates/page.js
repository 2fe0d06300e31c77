// What the page's parts share: where the reader is, and how packed data is unpacked.
const page = {
  // By a run's id its frame browser, its list and its view in three dimensions, as far as it has them.
  browsers: new Map(),
  lists: new Map(),
  flights: new Map(),
  number: new Intl.NumberFormat("en", { maximumSignificantDigits: 6 }),

  make(tag, attributes = {}, ...children) {
    const element = document.createElement(tag);
    for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
    element.append(...children);
    return element;
  },

  async bytes(text) {
    const packed = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
    const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate-raw"));
    return new Response(stream).arrayBuffer();
  },
  async unpacked(element) {
    return JSON.parse(new TextDecoder().decode(await page.bytes(element.textContent.trim())));
  },

  // A place is a link: #run=run0&culler=frustum&frame=91&view=left&object=door. What is missing is
  // as it stands, or the first there is.
  place() {
    const text = location.hash.slice(1);
    return text.includes("=") ? Object.fromEntries(new URLSearchParams(text)) : null;
  },
  link(place) {
    const told = Object.entries(place).filter(([, value]) => value !== undefined && value !== "");
    return `#${new URLSearchParams(told)}`;
  },
  // Goes there, which the back button undoes.
  go(place) {
    const link = page.link(place);
    if (link === location.hash) page.follow();
    else location.hash = link;
  },
  // Says where the reader is, without a step of its own to go back.
  note(place) {
    if (page.quiet) return;
    history.replaceState(null, "", page.link(place));
  },
  follow() {
    const place = page.place();
    if (!place) return;
    const run = place.run || "run0";
    page.quiet = true;
    const found = page.lists.get(run)?.follow(place);
    const culler = place.culler ?? found?.culler;
    const frame = place.frame ?? found?.frame;
    if (frame !== undefined) {
      const view = place.view ?? found?.view ?? "";
      page.browsers.get(run)?.goTo(culler, Number(frame), view);
      page.flights.get(run)?.goTo(culler, Number(frame), view, found);
    }
    page.quiet = false;
    if (found) found.show();
    else if (frame !== undefined) {
      page.browsers.get(run)?.root.scrollIntoView({ block: "start" });
    }
  },
};
