/* Writes what an engine saw and drew as a visref recording, one line per frame, for
 * `visref check SCENE --recording FILE`. For a page (<script src>: globalThis.visref), for require, and
 * for import (visref_recorder.mjs beside this file). In node it writes a file; in a page it keeps the
 * text, and gives a Blob or downloads it.
 *
 * Within a frame the calls come in any order; what is said before the first frame is said of all. What
 * first goes wrong (a number that is not finite, a name that is no Unicode, a full disk, a call out of
 * place) is kept, nothing is written after it but at the end a line that tells it, and close() throws it:
 * the engine draws on undisturbed. `view` is null in a frame whose one view has no name. Cameras, names of
 * engines: README.md beside this file. */
(function () {
  "use strict";

  const FORMS = ["world_from_camera", "camera_from_world", "clip_from_world"];
  const ORDERS = ["row_major", "column_major"];
  const BUFFER = 1 << 16; // characters

  class RecordingError extends Error {}

  /** JSON, with the sign of -0 kept. A Map is an object whose members keep their order. */
  function json(value) {
    if (Object.is(value, -0)) return "-0.0";
    if (Array.isArray(value)) return `[${value.map(json).join(",")}]`;
    if (!(value instanceof Map)) return JSON.stringify(value);
    return `{${[...value].map(([name, one]) => `${JSON.stringify(name)}:${json(one)}`).join(",")}}`;
  }

  /** A Map's member, made where there is none. */
  function member(of, name, made) {
    if (!of.has(name)) of.set(name, made);
    return of.get(name);
  }

  class Recorder {
    #file = null; // a descriptor, in node
    #fs = null;
    #full = false; // the file takes no more
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

    time(seconds) { if (this.#may(true)) this.#frame.set("time_s", this.#real(seconds)); }

    /** The camera has jumped. */
    cut() { if (this.#may(true)) this.#frame.set("cut", true); }

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
    text(name, text) { if (this.#may()) this.#frame.set(name, this.#name(text)); }

    /** Objects, by name or path, that the engine knows by one name. */
    group(name, objects) {
      this.#part(false, "groups", name, () => this.#list("group", objects, (one) => this.#name(one)));
    }

    /** Ids and names, of objects or groups; [] says that nothing was drawn. */
    visible(drawn, view = null) {
      const entry = (one) => (typeof one === "string" ? this.#name(one) : this.#whole(one, "visible", "ids"));
      this.#drawn("visible", drawn, view, "visible", entry);
    }

    /** The same by glTF node index. */
    visibleNodes(nodes, view = null) {
      const entry = (one) => this.#whole(one, "visibleNodes", "node indices");
      this.#drawn("visible_nodes", nodes, view, "visibleNodes", entry);
    }

    absent(name) { if (this.#may(true)) member(this.#frame, "absent", []).push(this.#name(name)); }

    /** `matrix`: world_from_object of an object, or what moves a whole group. */
    pose(name, order, matrix) { this.#part(true, "world_from_object", name, () => this.#matrix(order, matrix)); }
    stat(name, count) { this.#part(true, "stats", name, () => this.#whole(count, "stat", "counts")); }
    level(group, level) { this.#part(true, "levels", group, () => this.#whole(level, "level", "levels")); }

    /** The box that was tested, in world space. */
    bounds(name, least, greatest) {
      const corner = (point) => Array.from(point ?? [NaN], (one) => this.#real(one));
      this.#part(true, "bounds", name, () => [corner(least), corner(greatest)]);
    }

    statMs(phase, ms) {
      if (!this.#may(true)) return;
      member(member(this.#frame, "stats", new Map()), "ms", new Map()).set(this.#name(phase), this.#real(ms));
    }

    endFrame() {
      if (!this.#may(true)) return;
      this.#open = false;
      const [frame, views] = [this.#frame, this.#frame.get("views")];
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
      if (this.#file === null || this.#full) return;
      try {
        const bytes = new TextEncoder().encode(this.#text);
        this.#text = "";
        for (let at = 0; at < bytes.length; ) at += this.#fs.writeSync(this.#file, bytes, at);
      } catch (error) {
        this.#fail(`cannot write: ${error.message}`);
        this.#full = true;
      }
    }

    /** Throws if anything went wrong. The recording as a Blob, where it is not a file. */
    close() {
      if (this.#number < 0) this.#write();
      else if (this.#open) this.#fail("it has no end");
      // The last line of a recording that ends too early. Half of a surrogate pair may be in what it tells.
      const told = this.problem?.replace(/\p{Cs}/gu, "\ufffd");
      if (told !== undefined) this.#text += `${json(new Map([["stopped", told]]))}\n`;
      this.flush();
      if (this.#file !== null) this.#fs.closeSync(this.#file);
      this.#file = null;
      if (this.problem !== null) throw new RecordingError(this.problem);
      return this.#fs ? null : new Blob([...this.#kept, this.#text], { type: "application/jsonl" });
    }

    /** In a page: close, and hand the recording to the user as a download. */
    download(name = "recording.jsonl") {
      const href = URL.createObjectURL(this.close());
      Object.assign(document.createElement("a"), { href, download: name }).click();
      setTimeout(() => URL.revokeObjectURL(href), 60000);
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

    /** Field of view and lens shift of a column-major clip_from_camera of the OpenGL kind. An aspect is
     * often that of a page's size, of which the view is the rounding: w' / h' with |w' - w| <= 1 and
     * |h' - h| <= 1, so that |aspect h - w| = |aspect (h - h') + w' - w| <= aspect + 1. Pixels of a
     * recording are square: it has the greatest field of view that is in the camera's both ways, and no
     * ray of it asks for what the camera did not see. */
    #projection(p, near, far, view) {
      if (!this.#may()) return;
      const size = (name) => this.#view(view).get(name) ?? this.#frame.get(name) ?? this.#size[name];
      const [w, h] = [size("width"), size("height")];
      const aspect = p[5] / p[0];
      if (!(Math.abs(aspect * h - w) <= aspect + 1)) {
        const [its, of] = [aspect, w / h].map((one) => Number(one.toPrecision(6)));
        this.#fail(`the camera's aspect is ${its}, but the view is ${w}x${h} (${of}): set camera.aspect = canvas.width` +
          " / canvas.height before rendering, or give Recorder the size that the aspect was made of");
      }
      const perspective = p[15] === 0;
      const closest = Math.max(p[5], (p[0] * w) / h);
      this.field("near", near, view);
      this.field("far", far, view);
      if (perspective) this.field("yfov", 2 * Math.atan(1 / closest), view);
      else this.field("ymag", 1 / closest, view);
      const [x, y] = perspective ? [p[8], p[9]] : [-p[12], -p[13]];
      const pixels = (h * closest) / 2; // to a tangent of 1, or a unit
      if (x !== 0) this.field("shift_x_px", (x / p[0]) * pixels, view);
      if (y !== 0) this.field("shift_y_px", (-y / p[5]) * pixels, view);
    }

    #start(frame) { [this.#frame, this.#sets] = [frame, { visible: new Map(), visible_nodes: new Map() }]; }
    /** `inFrame`: whether the call belongs into a frame, or before all; undefined: both. */
    #may(inFrame) {
      if (!this.#open || (inFrame ?? this.#number >= 0) !== this.#number >= 0) this.#fail("a call out of place");
      return this.problem === null;
    }

    #view(view) {
      if (view === null) return this.#frame;
      return member(member(this.#frame, "views", new Map()), this.#name(view), new Map());
    }

    #drawn(key, drawn, view, call, entry) {
      if (!this.#may(true)) return;
      this.#view(view);
      const set = member(this.#sets[key], view, []);
      for (const one of this.#list(call, drawn, entry)) set.push(one);
    }

    #list(call, list, entry) {
      if (typeof list === "object" && list?.[Symbol.iterator]) return Array.from(list, (one) => entry(one));
      return this.#fail(`${call} takes a list, and got ${String(list)}`, []);
    }

    #part(inFrame, part, name, value) {
      if (this.#may(inFrame)) member(this.#frame, part, new Map()).set(this.#name(name), value());
    }

    #name(name) {
      if (typeof name !== "string") return this.#fail(`a name is a text, and not ${String(name)}`);
      return /\p{Cs}/u.test(name) ? this.#fail(`a name is no Unicode: ${name}`) : name;
    }

    #real(value) { return Number.isFinite(value) ? value : this.#fail("a number is not finite"); }
    #whole(value, call, what) {
      const whole = Number.isSafeInteger(value) && value >= 0;
      return whole ? value : this.#fail(`${call} got ${String(value)}; ${what} are whole numbers`);
    }

    #matrix(order, m) {
      if (m?.length !== 16 || !ORDERS.includes(order)) return this.#fail("a matrix is 16 numbers and their order");
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

    #fail(problem, instead = 0) {
      this.problem ??= (this.#number >= 0 ? `frame ${this.#number}: ` : "") + problem;
      return instead;
    }
  }

  /** The glTF node of an object that three.js's GLTFLoader made: what `visibleNodes` takes. Names do not
   * last: three.js takes some characters out, and a mesh of several primitives has children. */
  function threeNode(gltf, object) {
    return object ? gltf.parser.associations.get(object)?.nodes ?? threeNode(gltf, object.parent) : undefined;
  }

  /** The glTF node's name of a mesh that Babylon.js loaded: several primitives are meshes below it. */
  function babylonName(mesh) {
    const of = /^(.*)_primitive\d+$/s.exec(mesh.name);
    return of && mesh.parent?.name === of[1] ? of[1] : mesh.name;
  }

  const visref = { Recorder, RecordingError, threeNode, babylonName };
  if (typeof module === "object" && module.exports) module.exports = visref;
  globalThis.visref = visref;
})();
