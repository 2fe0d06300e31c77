/* Writes what an engine saw and drew as a visref recording, one line per frame, for
 * `visref check SCENE --recording FILE`. For a page (<script src>: globalThis.visref), for require, and
 * for import (visref_recorder.mjs beside this file). In node it writes a file; in a page it keeps the
 * text, and gives a Blob or downloads it.
 *
 * Within a frame the calls come in any order; what is said before the first frame is said of all. What
 * first goes wrong (a number that is not finite, a name that is no Unicode, a full disk, a call out of
 * place) is kept, nothing is written after it, and close() throws it: the engine draws on undisturbed.
 * `view` is null in a frame whose one view has no name. Cameras: README.md beside this file. */
(function () {
  "use strict";

  const FORMS = ["world_from_camera", "camera_from_world", "clip_from_world"];
  const ORDERS = ["row_major", "column_major"];
  const BUFFER = 1 << 16; // characters
  // A matrix of an engine that computes in float32 is as square as this.
  const FLOAT32 = 1e-6;

  class RecordingError extends Error {}

  /** JSON, with the sign of -0 kept. A Map is an object whose members keep their order. */
  function json(value) {
    if (Object.is(value, -0)) return "-0.0";
    if (Array.isArray(value)) return `[${value.map(json).join(",")}]`;
    if (!(value instanceof Map)) return JSON.stringify(value);
    return `{${[...value].map(([name, one]) => `${JSON.stringify(name)}:${json(one)}`).join(",")}}`;
  }

  class Recorder {
    #file = null; // a descriptor, in node
    #fs = null;
    #text = "";
    #kept = [];
    #number = -1;
    #open = true;
    #frame;
    #sets;
    #size;
    problem = null;

    /** @param file a path in node; null: keep the text. Sizes are in pixels. */
    constructor(file, width, height) {
      this.#start(new Map([["format", "visref-recording"], ["version", 1]]));
      this.#frame.set("width", width).set("height", height);
      this.#size = { width, height };
      if (file === null || file === undefined) return;
      try {
        this.#fs = globalThis.process.getBuiltinModule?.("fs") ?? module.require("fs");
        this.#file = this.#fs.openSync(file, "w");
      } catch (error) {
        this.#fail(`cannot open the file: ${error.message}`);
      }
    }

    /** @param number ascending; gaps are allowed */
    beginFrame(number) {
      if (this.#number < 0) this.#write();
      else if (this.#open) this.#fail("it has no end");
      if (!Number.isSafeInteger(number)) this.#fail("a frame's number is an integer");
      if (number <= this.#number) this.#fail("the next must have a higher number");
      this.#number = number;
      this.#open = true;
      this.#start(new Map([["frame", number]]));
    }

    time(seconds) {
      if (this.#may(true)) this.#frame.set("time_s", this.#real(seconds));
    }

    /** The camera has jumped. */
    cut() {
      if (this.#may(true)) this.#frame.set("cut", true);
    }

    /** `form`: one of FORMS. `order`: "row_major" or "column_major" of 16 numbers. */
    camera(form, order, matrix, view = null) {
      if (!this.#may(true)) return;
      const fields = this.#view(view);
      if (!FORMS.includes(form)) this.#fail(`a camera cannot be a ${form}`);
      if (FORMS.some((known) => fields.has(known))) this.#fail("a second camera");
      fields.set(form, this.#matrix(order, matrix));
    }

    /** "near", "far" (Infinity: endless), "yfov" (vertical, radians) or "ymag" (half the view's
     * height), "fps", "shift_x_px", "shift_y_px"; "width", "height" of another size. */
    field(name, value, view = null) {
      if (this.#may()) this.#view(view).set(name, value === Infinity ? null : this.#real(value));
    }

    /** "units": a file of meshlets or batches, which `visible` then lists. Of clip_from_world,
     * "clip_depth": "-1..1" (OpenGL), "0..1", or "1..0" (reversed), and "clip_y": "down" (Vulkan). */
    text(name, text) {
      if (this.#may()) this.#frame.set(name, this.#name(text));
    }

    /** Objects, by name or path, that the engine knows by one name. */
    group(name, objects) {
      this.#part(false, "groups", name, () => Array.from(objects, (one) => this.#name(one)));
    }

    /** Ids and names, of objects or groups; [] says that nothing was drawn. */
    visible(drawn, view = null) {
      if (!this.#may(true)) return;
      const set = this.#set("visible", view);
      for (const one of drawn) set.push(typeof one === "string" ? this.#name(one) : this.#whole(one));
    }

    /** The same by glTF node index. */
    visibleNodes(nodes, view = null) {
      if (!this.#may(true)) return;
      const set = this.#set("visible_nodes", view);
      for (const node of nodes) set.push(this.#whole(node));
    }

    absent(name) {
      if (!this.#may(true)) return;
      if (!this.#frame.has("absent")) this.#frame.set("absent", []);
      this.#frame.get("absent").push(this.#name(name));
    }

    /** `matrix`: world_from_object of an object, or what moves a whole group. */
    pose(name, order, matrix) {
      this.#part(true, "world_from_object", name, () => this.#matrix(order, matrix));
    }

    level(group, level) {
      this.#part(true, "levels", group, () => this.#whole(level));
    }

    /** The box that was tested, in world space. */
    bounds(name, least, greatest) {
      const corner = (point) => Array.from(point, (one) => this.#real(one));
      this.#part(true, "bounds", name, () => [corner(least), corner(greatest)]);
    }

    stat(name, count) {
      this.#part(true, "stats", name, () => this.#whole(count));
    }

    statMs(phase, ms) {
      if (!this.#may(true)) return;
      if (!this.#frame.has("stats")) this.#frame.set("stats", new Map());
      const stats = this.#frame.get("stats");
      if (!stats.has("ms")) stats.set("ms", new Map());
      stats.get("ms").set(this.#name(phase), this.#real(ms));
    }

    endFrame() {
      if (!this.#may(true)) return;
      this.#open = false;
      const frame = this.#frame;
      const views = frame.get("views");
      const seen = (fields) => FORMS.some((form) => fields.has(form) || frame.has(form));
      if (![...(views?.values() ?? [frame])].every(seen)) this.#fail("no camera");
      const keys = ["visible", "visible_nodes"].filter((key) => this.#sets[key].size > 0);
      const sets = this.#sets[keys[0] ?? "visible"];
      const joint = sets.size === 0 || sets.has(null);
      if (keys.length > 1 || (joint && sets.size > 1)) this.#fail("what is visible is given in two ways");
      const byView = [...(views?.keys() ?? [])].map((view) => [view, sets.get(view) ?? []]);
      frame.set(keys[0] ?? "visible", joint ? sets.get(null) ?? [] : new Map(byView));
      this.#write();
    }

    /** What is written is not to be lost in a crash. */
    flush() {
      if (this.#file === null) return;
      try {
        const bytes = new TextEncoder().encode(this.#text);
        this.#text = "";
        for (let at = 0; at < bytes.length; ) at += this.#fs.writeSync(this.#file, bytes, at);
      } catch (error) {
        this.#fail(`cannot write: ${error.message}`);
      }
    }

    /** Throws if anything went wrong. The recording as a Blob, where it is not a file. */
    close() {
      if (this.#number < 0) this.#write();
      else if (this.#open) this.#fail("it has no end");
      this.flush();
      if (this.#file !== null) this.#fs.closeSync(this.#file);
      this.#file = null;
      if (this.problem !== null) throw new RecordingError(this.problem);
      return this.#fs ? null : new Blob([...this.#kept, this.#text], { type: "application/jsonl" });
    }

    /** In a page: close, and hand the recording to the user as a download. */
    download(name = "recording.jsonl") {
      const link = document.createElement("a");
      link.href = URL.createObjectURL(this.close());
      link.download = name;
      link.click();
      setTimeout(() => URL.revokeObjectURL(link.href), 60000);
    }

    /** A three.js camera, after it was drawn with. Axes and units are glTF's. */
    threeCamera(camera, view = null) {
      this.camera("world_from_camera", "column_major", camera.matrixWorld.elements, view);
      this.#projection(camera.projectionMatrix.elements, camera.near, camera.far, view);
    }

    /** A Babylon.js camera. In a left-handed scene the glTF loader has negated x; looked at along +Z. */
    babylonCamera(camera, view = null) {
      const left = !camera.getScene().useRightHandedSystem;
      const matrix = camera.getViewMatrix().m;
      const flipped = Array.from(matrix, (one, i) => ((i % 4 === 2) !== i < 4 ? -one : one));
      this.camera("camera_from_world", "column_major", left ? flipped : matrix, view);
      const p = Array.from(camera.getProjectionMatrix().m);
      // A left-handed projection has its off-centre terms for +Z.
      if (left && p[11] === 1) for (const i of [8, 9, 11]) p[i] = -p[i];
      this.#projection(p, camera.minZ, camera.maxZ === 0 ? Infinity : camera.maxZ, view);
    }

    /** Field of view and lens shift of a column-major clip_from_camera of the OpenGL kind. */
    #projection(p, near, far, view) {
      if (!this.#may()) return;
      const size = (name) => this.#view(view).get(name) ?? this.#frame.get(name) ?? this.#size[name];
      const [w, h] = [size("width"), size("height")];
      if (Math.abs((p[0] * w) / (p[5] * h) - 1) > FLOAT32) this.#fail("the camera's aspect is not the view's");
      const perspective = p[15] === 0;
      this.field("near", near, view);
      this.field("far", far, view);
      if (perspective) this.field("yfov", 2 * Math.atan(1 / p[5]), view);
      else this.field("ymag", 1 / p[5], view);
      const [x, y] = perspective ? [p[8], p[9]] : [-p[12], -p[13]];
      if (x !== 0) this.field("shift_x_px", (x * w) / 2, view);
      if (y !== 0) this.field("shift_y_px", (-y * h) / 2, view);
    }

    #start(frame) {
      this.#frame = frame;
      this.#sets = { visible: new Map(), visible_nodes: new Map() };
    }

    /** `inFrame`: whether the call belongs into a frame, or before all; undefined: both. */
    #may(inFrame) {
      if (!this.#open || (inFrame ?? this.#number >= 0) !== this.#number >= 0) this.#fail("a call out of place");
      return this.problem === null;
    }

    #view(view) {
      if (view === null) return this.#frame;
      if (!this.#frame.has("views")) this.#frame.set("views", new Map());
      const views = this.#frame.get("views");
      if (!views.has(view)) views.set(this.#name(view), new Map());
      return views.get(view);
    }

    #set(key, view) {
      this.#view(view);
      if (!this.#sets[key].has(view)) this.#sets[key].set(view, []);
      return this.#sets[key].get(view);
    }

    #part(inFrame, part, name, value) {
      if (!this.#may(inFrame)) return;
      if (!this.#frame.has(part)) this.#frame.set(part, new Map());
      this.#frame.get(part).set(this.#name(name), value());
    }

    #name(name) {
      if (typeof name !== "string" || /\p{Cs}/u.test(name)) this.#fail(`a name is no Unicode: ${name}`);
      return name;
    }

    #real(value) {
      if (!Number.isFinite(value)) this.#fail("a number is not finite");
      return value;
    }

    #whole(value) {
      if (!Number.isSafeInteger(value)) this.#fail("an id, a level or a count is an integer");
      return value;
    }

    #matrix(order, m) {
      if (m.length !== 16 || !ORDERS.includes(order)) this.#fail("a matrix is 16 numbers and their order");
      const at = order === "row_major" ? (i, k) => m[4 * i + k] : (i, k) => m[4 * k + i];
      return [0, 1, 2, 3].map((i) => [0, 1, 2, 3].map((k) => this.#real(at(i, k))));
    }

    #write() {
      if (this.problem !== null) return;
      this.#text += `${json(this.#frame)}\n`;
      if (this.#text.length < BUFFER) return;
      if (this.#fs) this.flush();
      else this.#kept.push(new Blob([this.#text])), (this.#text = "");
    }

    #fail(problem) {
      this.problem ??= (this.#number >= 0 ? `frame ${this.#number}: ` : "") + problem;
    }
  }

  const visref = { Recorder, RecordingError };
  if (typeof module === "object" && module.exports) module.exports = visref;
  globalThis.visref = visref;
})();
