/* Babylon.js: the scene culls by its frustum, and with --occlusion=optimistic|strict by occlusion queries
 * too, one per mesh, which the graphics card answers late: a mesh is left out in the frames after the one in
 * whose picture its box had no sample. What was drawn, each mesh's `onAfterRenderObservable` tells, which is not
 * notified where a mesh is held to be occluded.
 *
 * --occluders=N: the N largest meshes (0) are drawn first, without queries, in a rendering group of their own;
 * so the documentation says to do. --accurate: the queries' target is ANY_SAMPLES_PASSED instead of its conservative variant.
 * --rounds=N: each of the path's frames is drawn N times (1), and what the last round drew is recorded. */
import { babylonName } from "recorder";
import { colourOf } from "/engines/web/scene.mjs";

async function library(file) {
  await new Promise((loaded, failed) => {
    const script = Object.assign(document.createElement("script"), { src: `/engines/node_modules/${file}` });
    script.onload = loaded;
    script.onerror = () => failed(new Error(`cannot load ${file}`));
    document.head.append(script);
  });
}
await library("babylonjs/babylon.js");
await library("babylonjs-loaders/babylonjs.loaders.min.js");
const { BABYLON } = globalThis;

/** Pictures that are drawn before the first that is recorded. */
const WARMING = 10;
const TYPES = { optimistic: "OCCLUSION_TYPE_OPTIMISTIC", strict: "OCCLUSION_TYPE_STRICT" };

export class Engine {
  static async open(canvas, glb, nodes, options) {
    const engine = new BABYLON.Engine(canvas, false, { preserveDrawingBuffer: true });
    const scene = new BABYLON.Scene(engine);
    scene.clearColor = new BABYLON.Color4(0, 0, 0, 1);
    // A mesh of its own for each node: what is asked and drawn by instances is the first one's.
    const pluginOptions = { gltf: { createInstances: false } };
    await BABYLON.AppendSceneAsync(new File([glb], "scene.glb"), scene, { pluginOptions });
    const made = new Engine(engine, scene, nodes, options);
    await scene.whenReadyAsync();
    return made;
  }

  constructor(engine, scene, nodes, options) {
    this.engine = engine;
    this.scene = scene;
    this.nodes = nodes;
    this.rounds = Number(options.rounds ?? 1);
    scene.animationGroups.forEach((group) => group.stop());
    this.groups = scene.animationGroups;
    this.camera = new BABYLON.FreeCamera("camera", BABYLON.Vector3.Zero(), scene);
    scene.activeCamera = this.camera;
    this.placed = new Map();
    const size = (mesh) => mesh.getBoundingInfo().boundingSphere.radiusWorld;
    const bySize = scene.meshes.filter((mesh) => mesh.getTotalVertices() > 0).sort((a, b) => size(b) - size(a));
    const occluders = new Set(bySize.slice(0, Number(options.occluders ?? 0)));
    scene.setRenderingAutoClearDepthStencil(1, false);
    for (const mesh of scene.meshes) {
      if (mesh.getTotalVertices() === 0) continue;
      const material = new BABYLON.StandardMaterial("flat", scene);
      material.disableLighting = true;
      material.emissiveColor = new BABYLON.Color3(...colourOf(this.#node(mesh)));
      material.backFaceCulling = options.oneSided && (mesh.material?.backFaceCulling ?? true);
      material.sideOrientation = mesh.material?.sideOrientation ?? material.sideOrientation;
      mesh.material = material;
      const node = this.#node(mesh);
      mesh.onAfterRenderObservable.add(() => this.drawn.push(node));
      if (options["no-culling"]) mesh.alwaysSelectAsActiveMesh = true;
      if (options.occlusion && !occluders.has(mesh)) {
        mesh.renderingGroupId = occluders.size > 0 ? 1 : 0;
        mesh.occlusionType = BABYLON.AbstractMesh[TYPES[options.occlusion]];
        const accurate = options.accurate ? "ACCURATE" : "CONSERVATIVE";
        mesh.occlusionQueryAlgorithmType = BABYLON.AbstractMesh[`OCCLUSION_ALGORITHM_TYPE_${accurate}`];
      }
    }
  }

  #node(mesh) {
    return this.nodes.index(babylonName(mesh));
  }

  pose(frame) {
    if (Object.values(frame.levels ?? {}).some((level) => level > 0)) throw new Error("levels are not tried");
    for (const [mesh, place] of this.placed) place(mesh);
    this.placed.clear();
    if (frame.time_s !== undefined && this.groups.length) this.#animate(frame.animation, frame.time_s);
    for (const [name, rows] of Object.entries(frame.world_from_object ?? {})) this.#place(this.#mesh(name), rows);
    for (const name of frame.absent ?? []) {
      const mesh = this.#mesh(name);
      mesh.setEnabled(false);
      this.placed.set(mesh, () => mesh.setEnabled(true));
    }
  }

  #mesh(name) {
    return this.scene.getMeshByName(name) ?? this.scene.getTransformNodeByName(name);
  }

  /** Under the loader's root, which turns glTF's world into a left-handed one. */
  #place(mesh, rows) {
    const { position, scaling } = mesh;
    const rest = [position.clone(), mesh.rotationQuaternion?.clone() ?? null, scaling.clone()];
    this.placed.set(mesh, () => ([mesh.position, mesh.rotationQuaternion, mesh.scaling] = rest));
    const matrix = BABYLON.Matrix.FromArray(rows.flat()).transpose();
    const turn = new BABYLON.Quaternion();
    const [size, at] = [new BABYLON.Vector3(), new BABYLON.Vector3()];
    matrix.decompose(size, turn, at);
    [mesh.position, mesh.rotationQuaternion, mesh.scaling] = [at, turn, size];
  }

  /** Key frames are numbered by 60 a second. */
  #animate(name, time) {
    const group = name === undefined ? this.groups[0] : this.groups.find((one) => one.name === name);
    group.start(false);
    group.goToFrame(Math.min(time * group.targetedAnimations[0].animation.framePerSecond, group.to));
    group.pause();
  }

  look(view) {
    const { camera } = this;
    if (view.shift_x_px || view.shift_y_px) throw new Error("lens shifts are not tried");
    const [up, back, eye] = [1, 2, 3].map((column) => {
      const [x, y, z] = [0, 1, 2].map((row) => view.world_from_camera[row][column]);
      return new BABYLON.Vector3(-x, y, z); // the loader negates x
    });
    camera.position = eye;
    camera.upVector = up;
    camera.setTarget(eye.subtract(back));
    camera.minZ = view.near;
    camera.maxZ = view.far ?? 0; // 0 is endless
    const [half, aspect] = [view.ymag, view.width / view.height];
    camera.mode = half === undefined ? BABYLON.Camera.PERSPECTIVE_CAMERA : BABYLON.Camera.ORTHOGRAPHIC_CAMERA;
    if (half === undefined) camera.fov = view.yfov;
    else [camera.orthoTop, camera.orthoBottom, camera.orthoRight, camera.orthoLeft] = [half, -half, half * aspect, -half * aspect];
    this.engine.setSize(view.width, view.height);
  }

  async draw() {
    // Before shaders are compiled a query's box has no samples either: that is no matter of culling.
    for (let round = this.drawn ? 0 : -WARMING; round < this.rounds; round++) {
      await new Promise(requestAnimationFrame); // queries are answered between frames, as in any page
      this.drawn = [];
      this.engine.beginFrame();
      this.scene.render();
      this.engine.endFrame();
    }
    return this.drawn;
  }

  tell(r, view, name) {
    r.babylonCamera(this.camera, name);
  }

  close() {
    this.engine.dispose();
  }
}
