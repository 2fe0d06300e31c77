// Freeze and fly: the scene in three dimensions, a frame's culling frozen in it.
for (const root of document.querySelectorAll(".flight")) {
  const run = root.dataset.run;
  const find = (name) => root.querySelector(`[data-of="${name}"]`);
  const [stage, slider, picker, rest] = ["stage", "frame", "culler", "rest"].map(find);
  const STATES = ["rest", "visible", "superfluous", "missed", "aged"];
  const [REST, VISIBLE, SUPERFLUOUS, MISSED, AGED] = STATES.keys();
  let view = null;
  let waiting = null;

  const texts = async () => {
    const { beside } = root.dataset;
    if (!beside) return { three: find("three").textContent, scene: find("scene").textContent };
    await new Promise((resolve, reject) => {
      const script = page.make("script", { src: beside });
      script.addEventListener("load", resolve);
      script.addEventListener("error", () => reject(new Error(`${beside} is not beside this page.`)));
      document.head.append(script);
    });
    return globalThis.visrefScene3d;
  };
  const start = () => {
    waiting ??= (async () => {
      if (!document.createElement("canvas").getContext("webgl2")) throw new Error("This browser has no WebGL.");
      const { three, scene } = await texts();
      // The library is a plain script, which puts THREE among the page's globals.
      new Function(new TextDecoder().decode(await page.bytes(three.trim()))).call(globalThis);
      find("whole").hidden = false;
      view = fly(globalThis.THREE, read(await page.bytes(scene.trim())));
      find("told").hidden = true;
      root.classList.add("ready");
    })().catch((error) => {
      find("whole").hidden = true;
      find("told").hidden = false;
      find("told").textContent = `The view in three dimensions cannot start. ${error.message}`;
    });
    return waiting;
  };

  const read = (buffer) => {
    const length = new DataView(buffer).getUint32(0, true);
    const data = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, length)));
    const sum = (list) => list.reduce((all, one) => all + one, 0);
    const corners = 3 * sum(data.triangles);
    const numbers = 3 * sum(data.vertices);
    let at = 4 + length;
    data.index = new Int32Array(buffer, at, corners);
    data.packed = new Uint16Array(buffer, at += 4 * corners, numbers);
    data.bits = new Uint8Array(buffer, at + 2 * numbers);
    return data;
  };

  const fly = (THREE, data) => {
    const count = data.names.length;
    const vector = (list) => new THREE.Vector3(...list);
    const middle = vector(data.core[0]).add(vector(data.core[1])).multiplyScalar(0.5);
    const size = vector(data.core[1]).distanceTo(vector(data.core[0])) || 1;
    const place = (list) => vector(list).sub(middle);
    const css = (name) => new THREE.Color(getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim());

    const positions = new Float32Array(data.packed.length);
    const index = new Uint32Array(data.index.length);
    const firstVertex = [0];
    const firstCorner = [0];
    for (let object = 0, v = 0, c = 0; object < count; object += 1) {
      const offset = middle.toArray().map((one, axis) => data.low[object][axis] - one);
      for (const base = v, end = base + data.vertices[object]; v < end; v += 1) {
        for (let axis = 0; axis < 3; axis += 1) {
          positions[3 * v + axis] = offset[axis] + data.step[object][axis] * data.packed[3 * v + axis];
        }
      }
      for (const end = c + 3 * data.triangles[object]; c < end; c += 1) index[c] = firstVertex[object] + data.index[c];
      firstVertex.push(v);
      firstCorner.push(c);
    }

    const renderer = new THREE.WebGLRenderer({ antialias: true });
    stage.append(renderer.domElement);
    renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
    const world = new THREE.Scene();
    const light = new THREE.DirectionalLight(0xffffff, 0.6);
    world.add(new THREE.AmbientLight(0xffffff, 0.55), light, light.target);
    const attributes = {
      position: new THREE.BufferAttribute(positions, 3),
      color: new THREE.BufferAttribute(new Uint8Array(positions.length), 3, true),
    };
    const mesh = (options) => {
      const geometry = new THREE.BufferGeometry();
      for (const [name, value] of Object.entries(attributes)) geometry.setAttribute(name, value);
      const material = new THREE.MeshPhongMaterial({ vertexColors: true, flatShading: true, side: THREE.DoubleSide, shininess: 0, ...options });
      const made = new THREE.Mesh(geometry, material);
      made.frustumCulled = false;
      world.add(made);
      return made;
    };
    const solid = mesh({});
    const faint = mesh({ transparent: true, opacity: 0.1, depthWrite: false });
    const line = (options = {}) => {
      const made = new THREE.LineSegments(new THREE.BufferGeometry(), new THREE.LineBasicMaterial(options));
      made.frustumCulled = false;
      world.add(made);
      return made;
    };
    const frustum = line();
    const path = line({ transparent: true, opacity: 0.6 });
    // Through whatever stands before them; the ray thicker than a line can be.
    const ray = new THREE.Mesh(new THREE.BufferGeometry(), new THREE.MeshBasicMaterial({ depthTest: false }));
    ray.frustumCulled = false;
    world.add(ray);
    const box = line({ depthTest: false });
    ray.renderOrder = box.renderOrder = 1;
    const segments = (made, points) => made.geometry.setFromPoints(points);

    // Up is the axis of the world that the cameras' own up is nearest to.
    const ups = data.cells.reduce((sum, [, , one]) => sum.add(vector(one.U).normalize()), vector([0, 0, 0])).toArray();
    const axis = ups.map(Math.abs).indexOf(Math.max(...ups.map(Math.abs)));
    const up = vector([0, 1, 2].map((one) => (one === axis ? Math.sign(ups[axis]) || 1 : 0)));

    const free = new THREE.PerspectiveCamera(50, 1, size * 1e-4, size * 20);
    const eye = new THREE.Camera();
    const target = new THREE.Vector3();
    let through = false;
    let cell = 0;
    let culler = 0;
    let chosen = null;

    const point = (camera, x, y, depth) => {
      const a = 2 * (x + camera.shift[0]) + 1 - camera.size[0];
      const b = camera.size[1] - 2 * (y + camera.shift[1]) - 1;
      const across = vector(camera.R).multiplyScalar(a).add(vector(camera.U).multiplyScalar(b));
      return place(camera.e).addScaledVector(vector(camera.F), depth).addScaledVector(across, camera.flat ? 1 : depth);
    };
    const corners = (camera, depth) => [[0, 0], [1, 0], [1, 1], [0, 1]].map(([x, y]) =>
      point(camera, x * camera.size[0] - 0.5, y * camera.size[1] - 0.5, depth));

    const visibleIn = (wanted) => {
      const bytes = Math.ceil(count / 8);
      const found = new Uint8Array(bytes);
      for (let row = 0; row <= wanted; row += 1) {
        for (let byte = 0; byte < bytes; byte += 1) found[byte] ^= data.bits[row * bytes + byte];
      }
      return (object) => (found[object >> 3] >> (object & 7)) & 1;
    };
    const states = () => {
      const visible = visibleIn(cell);
      const found = Uint8Array.from({ length: count }, (_, object) => (visible(object) ? VISIBLE : REST));
      const its = data.cullers[culler];
      for (const object of its.superfluous[cell] ?? []) found[object] = SUPERFLUOUS;
      for (const [object, age] of its.missed[cell] ?? []) found[object] = age > 0 ? AGED : MISSED;
      return found;
    };
    const paint = () => {
      const found = states();
      const colours = [css("soft"), css("visible"), css("superfluous"), css("missed"), css("aged")]
        .map((one) => one.toArray().map((part) => Math.round(part * 255)));
      const counts = new Array(STATES.length).fill(0);
      const drawn = [];
      const others = [];
      for (let object = 0; object < count; object += 1) {
        counts[found[object]] += 1;
        // What is visible lies side by side: no two objects are of quite one brightness.
        const shade = found[object] === VISIBLE || found[object] === REST ? 0.74 + 0.26 * ((object * 0.618034) % 1) : 1;
        const colour = colours[found[object]].map((part) => Math.round(part * shade));
        for (let v = firstVertex[object]; v < firstVertex[object + 1]; v += 1) attributes.color.array.set(colour, 3 * v);
        const list = found[object] === REST ? others : drawn;
        for (let c = firstCorner[object]; c < firstCorner[object + 1]; c += 1) list.push(index[c]);
      }
      attributes.color.needsUpdate = true;
      solid.geometry.setIndex(new THREE.BufferAttribute(Uint32Array.from(drawn), 1));
      faint.geometry.setIndex(new THREE.BufferAttribute(Uint32Array.from(others), 1));
      STATES.forEach((name, state) => { root.querySelector(`[data-count="${name}"]`).textContent = page.number.format(counts[state]); });
      const more = data.cullers[culler].unlisted[cell];
      find("unlisted").textContent = more ? `, and ${page.number.format(more)} that are not listed (visref run --superfluous-rows lists all objects)` : "";
    };
    const lines = () => {
      const [, name, camera] = data.cells[cell];
      const far = Math.min(camera.far ?? Infinity, size * 0.6);
      const [near, back] = [corners(camera, camera.near), corners(camera, Math.max(far, camera.near * 1.01))];
      segments(frustum, near.flatMap((one, i) => [
        one, near[(i + 1) % 4], back[i], back[(i + 1) % 4], camera.flat ? one : place(camera.e), back[i]]));
      const eyes = data.cells.filter((one) => one[1] === name).map((one) => place(one[2].e));
      segments(path, eyes.slice(1).flatMap((one, i) => [eyes[i], one]));
      frustum.material.color = path.material.color = css("ink");
      ray.material.color = box.material.color = css("bad");
      ray.visible = box.visible = frustum.visible = !through;
      const here = chosen && chosen.cell === cell;
      box.visible = Boolean(chosen);
      ray.visible = Boolean(here && chosen.point && !through);
      world.background = css("tint");
    };
    const show = () => {
      const [frame, name] = data.cells[cell];
      const said = `Frame ${frame}${name ? `, ${name}` : ""} (${cell + 1} of ${data.cells.length})`;
      find("at").textContent = said;
      slider.value = String(cell);
      slider.setAttribute("aria-valuetext", said);
      for (const step of root.querySelectorAll(".step")) {
        const next = cell + Number(step.dataset.step);
        step.disabled = next < 0 || next >= data.cells.length;
      }
      picker.value = String(culler);
      paint();
      draw();
    };

    const look = (from, to) => {
      through = false;
      free.up.copy(up);
      free.position.copy(from);
      target.copy(to);
    };
    const aside = () => {
      const camera = data.cells[cell][2];
      const [from, ahead] = [place(camera.e), vector(camera.F)];
      const length = Math.min(size * 0.5, camera.far ?? Infinity);
      const across = vector(camera.R).normalize().multiplyScalar(length * 0.45);
      look(from.clone().addScaledVector(ahead, -length * 0.7).addScaledVector(up, length * 0.6).add(across),
        from.clone().addScaledVector(ahead, length * 0.35));
    };
    // The frame's own pose and projection, widened to the stage's shape.
    const ownEye = () => {
      const camera = data.cells[cell][2];
      const near = camera.flat ? camera.near : Math.max(camera.near, size * 1e-5);
      const far = Math.min(camera.far ?? Infinity, near + size * 20);
      const step = (one) => vector(one).length() * (camera.flat ? 1 : near);
      let [right, top] = [step(camera.R) * camera.size[0], step(camera.U) * camera.size[1]];
      const [x, y] = [2 * camera.shift[0] * step(camera.R), -2 * camera.shift[1] * step(camera.U)];
      const shape = stage.clientWidth / stage.clientHeight;
      if (right / top < shape) right = top * shape; else top = right / shape;
      eye.projectionMatrix[camera.flat ? "makeOrthographic" : "makePerspective"](x - right, x + right, y + top, y - top, near, far);
      eye.projectionMatrixInverse.copy(eye.projectionMatrix).invert();
      eye.position.copy(place(camera.e));
      eye.quaternion.setFromRotationMatrix(new THREE.Matrix4().makeBasis(
        vector(camera.R).normalize(), vector(camera.U).normalize(), vector(camera.F).negate()));
      return eye;
    };
    const draw = () => {
      const [width, height] = [stage.clientWidth, stage.clientHeight];
      if (!width || !height) return;
      renderer.setSize(width, height, false);
      faint.visible = rest.checked;
      lines();
      find("through").setAttribute("aria-pressed", String(through));
      free.aspect = width / height;
      free.updateProjectionMatrix();
      free.lookAt(target);
      const camera = through ? ownEye() : free;
      camera.updateMatrixWorld();
      light.position.copy(camera.position).addScaledVector(up, size * 0.05);
      light.target.position.copy(camera.position).add(new THREE.Vector3(0, 0, -size * 0.15).applyQuaternion(camera.quaternion));
      light.target.updateMatrixWorld();
      renderer.render(world, camera);
    };

    // From the frame's own eye the flight goes on where it is.
    const leave = () => {
      if (!through) return;
      const camera = data.cells[cell][2];
      look(place(camera.e), place(camera.e).addScaledVector(vector(camera.F), size * 0.1));
    };
    const turn = (x, y) => {
      leave();
      const arm = free.position.clone().sub(target).applyAxisAngle(up, -x);
      const side = new THREE.Vector3().crossVectors(up, arm).normalize();
      const turned = arm.clone().applyAxisAngle(side, -y);
      // Not over the pole.
      if (Math.abs(turned.clone().normalize().dot(up)) < 0.995) arm.copy(turned);
      free.position.copy(target).add(arm);
    };
    const shift = (right, high, ahead) => {
      leave();
      const on = target.clone().sub(free.position).normalize();
      const by = new THREE.Vector3().crossVectors(on, up).normalize().multiplyScalar(right)
        .addScaledVector(up, high).addScaledVector(on, ahead);
      free.position.add(by);
      target.add(by);
    };
    const nearer = (factor) => {
      leave();
      free.position.sub(target).multiplyScalar(factor).add(target);
    };
    const setThrough = () => { if (through) aside(); else through = true; draw(); };

    const FLY = { w: [0, 0, 1], s: [0, 0, -1], a: [-1, 0, 0], d: [1, 0, 0], q: [0, -1, 0], e: [0, 1, 0] };
    const TURN = { arrowleft: [-1, 0], arrowright: [1, 0], arrowup: [0, 1], arrowdown: [0, -1] };
    const held = new Set();
    let last = 0;
    const tick = (now) => {
      const seconds = Math.min(0.1, (now - last) / 1000);
      last = now;
      for (const key of held) {
        if (FLY[key]) shift(...FLY[key].map((one) => one * seconds * size * 0.2));
        else turn(...TURN[key].map((one) => one * seconds * 1.5));
      }
      draw();
      if (held.size) requestAnimationFrame(tick);
    };
    stage.addEventListener("keydown", (event) => {
      const key = event.key.toLowerCase();
      if (event.ctrlKey || event.metaKey || event.altKey) return;
      if (FLY[key] || TURN[key]) {
        if (!held.size) { last = performance.now(); requestAnimationFrame(tick); }
        held.add(key);
      } else if (key === "+" || key === "-") { nearer(key === "+" ? 0.85 : 1 / 0.85); draw(); }
      else if (key === "c") setThrough();
      else return;
      event.preventDefault();
    });
    stage.addEventListener("keyup", (event) => held.delete(event.key.toLowerCase()));
    stage.addEventListener("blur", () => held.clear());
    stage.addEventListener("pointerdown", (event) => { stage.focus({ preventScroll: true }); stage.setPointerCapture(event.pointerId); });
    stage.addEventListener("pointermove", (event) => {
      if (!event.buttons) return;
      if (event.shiftKey || event.buttons & 2) {
        const scale = free.position.distanceTo(target) / stage.clientHeight;
        shift(-event.movementX * scale, event.movementY * scale, 0);
      } else turn(event.movementX * 0.006, event.movementY * 0.006);
      draw();
    });
    stage.addEventListener("contextmenu", (event) => event.preventDefault());
    stage.addEventListener("wheel", (event) => {
      if (document.activeElement !== stage) return;
      event.preventDefault();
      nearer(Math.exp(Math.sign(event.deltaY) * 0.12));
      draw();
    }, { passive: false });

    data.cullers.forEach((one, number) => picker.append(page.make("option", { value: String(number) }, one.shown)));
    slider.max = String(data.cells.length - 1);
    const at = (wanted) => { cell = Math.min(Math.max(wanted, 0), data.cells.length - 1); show(); };
    slider.addEventListener("input", () => at(Number(slider.value)));
    for (const step of root.querySelectorAll(".step")) step.addEventListener("click", () => at(cell + Number(step.dataset.step)));
    picker.addEventListener("change", () => { culler = Number(picker.value); show(); });
    rest.addEventListener("change", draw);
    find("through").addEventListener("click", setThrough);
    find("aside").addEventListener("click", () => { aside(); draw(); });
    new ResizeObserver(() => draw()).observe(stage);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", show);

    const mark = (found) => {
      const object = found.object;
      const camera = data.cells[cell][2];
      const bounds = new THREE.Box3();
      for (let v = firstVertex[object]; v < firstVertex[object + 1]; v += 1) bounds.expandByPoint(new THREE.Vector3().fromArray(positions, 3 * v));
      if (bounds.isEmpty()) bounds.setFromPoints([place(camera.e)]);
      const corner = (bits) => new THREE.Vector3(...["x", "y", "z"].map((one, i) => bounds[bits >> i & 1 ? "max" : "min"][one]));
      segments(box, [0, 1, 2, 3, 4, 5, 6, 7].flatMap((one) => [1, 2, 4].filter((bit) => !(one & bit)).flatMap((bit) => [corner(one), corner(one | bit)])));
      // Its witness is of its worst frame; in another there is no ray to show.
      const [frame, name] = data.cells[cell];
      const seen = !found.hidden && found.x >= 0 && found.frame === frame && found.view === name;
      const hit = seen ? point(camera, found.x, found.y, found.depth) : bounds.getCenter(new THREE.Vector3());
      const from = camera.flat && seen ? point(camera, found.x, found.y, camera.near) : place(camera.e);
      const arm = hit.clone().sub(from);
      ray.geometry.dispose();
      ray.geometry = new THREE.CylinderGeometry(arm.length() * 0.003, arm.length() * 0.003, arm.length(), 8);
      ray.position.copy(from).addScaledVector(arm, 0.5);
      ray.quaternion.setFromUnitVectors(new THREE.Vector3(0, 1, 0), arm.clone().normalize());
      chosen = { cell, point: seen };
      const { objects, named } = data.moves;
      const moves = !objects ? "" : named.includes(object) ? " It moves, and stands here as at rest."
        : objects > named.length ? " If it moves, it stands here as at rest." : "";
      find("chosen").textContent = `Marked: ${data.names[object]}${seen ? `, with the ray of its witness at pixel (${found.x}, ${found.y})` : found.hidden ? "" : `; its witness is of frame ${found.frame}`}.${moves}`;
      const side = new THREE.Vector3().crossVectors(arm, up).normalize().multiplyScalar(arm.length() * 0.5);
      look(from.clone().addScaledVector(arm, -0.3).addScaledVector(up, arm.length() * 0.4).add(side), from.clone().addScaledVector(arm, 0.6));
    };
    const goTo = (name, frame, view_, found) => {
      const named = data.cullers.findIndex((one) => one.name === name);
      if (named >= 0) culler = named;
      const here = data.cells.findIndex((one) => one[0] === frame && (one[1] === view_ || !view_));
      if (here >= 0) cell = here;
      if (found) mark(found); else if (!through) aside();
      show();
    };
    // It opens where most was missed.
    let most = -1;
    data.cullers.forEach((one, number) => {
      for (const [place_, list] of Object.entries(one.missed)) {
        if (list.length > most) [most, culler, cell] = [list.length, number, Number(place_)];
      }
    });
    aside();
    show();
    return { goTo };
  };

  page.flights.set(run, {
    goTo: (...where) => start().then(() => view?.goTo(...where)),
  });
  const watch = new IntersectionObserver((seen) => {
    if (seen.some((one) => one.isIntersecting)) { watch.disconnect(); start(); }
  }, { rootMargin: "300px" });
  watch.observe(root);
}
