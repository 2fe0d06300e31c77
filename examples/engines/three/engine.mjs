/* three.js: WebGLRenderer culls by its frustum, meshes whose `frustumCulled` is true (the default). What
 * was drawn, `onBeforeRender` tells, which is called for what is left behind all culling.
 *
 * --recompute: each frame asks for the bounding spheres of skinned and instanced meshes anew, as the
 * documentation advises where these move. */
import * as THREE from "three";
import { GLTFLoader } from "three/addons/loaders/GLTFLoader.js";
import { threeNode } from "recorder";
import { colourOf } from "/engines/web/scene.mjs";

THREE.ColorManagement.enabled = false;

export class Engine {
  static async open(canvas, glb, nodes, options) {
    const gltf = await new GLTFLoader().parseAsync(glb, "");
    return new Engine(canvas, nodes, gltf, options);
  }

  constructor(canvas, nodes, gltf, options) {
    this.options = options;
    this.nodes = nodes;
    this.scene = gltf.scene;
    this.renderer = new THREE.WebGLRenderer({ canvas, antialias: false });
    this.renderer.outputColorSpace = THREE.LinearSRGBColorSpace;
    this.drawn = [];
    this.meshes = [];
    this.byNode = new Map();
    gltf.scene.traverse((one) => {
      const node = gltf.parser.associations.get(one)?.nodes;
      if (node !== undefined && !this.byNode.has(node)) this.byNode.set(node, one);
      if (one.isMesh) this.#prepare(one, threeNode(gltf, one));
    });
    this.rest = new Map([...this.byNode.values()].map((one) => [one, one.matrix.clone()]));
    this.mixer = new THREE.AnimationMixer(gltf.scene);
    this.clips = gltf.animations;
  }

  /** Flat colours, for the pictures; no culling looks at them. */
  #prepare(mesh, node) {
    const side = this.options.oneSided ? mesh.material.side : THREE.DoubleSide;
    mesh.material = new THREE.MeshBasicMaterial({ color: new THREE.Color(...colourOf(node)), side });
    mesh.onBeforeRender = () => this.drawn.push(node);
    if (this.options["no-culling"]) mesh.frustumCulled = false;
    this.meshes.push(mesh);
  }

  pose(frame) {
    if (Object.values(frame.levels ?? {}).some((level) => level > 0)) throw new Error("three.js reads no MSFT_lod");
    for (const [one, matrix] of this.rest) {
      one.visible = true;
      if (!one.matrixAutoUpdate) matrix.decompose(one.position, one.quaternion, one.scale);
      one.matrixAutoUpdate = true;
    }
    if (frame.time_s !== undefined && this.clips.length) this.#animate(frame.animation, frame.time_s);
    this.scene.updateMatrixWorld(true);
    for (const [name, rows] of Object.entries(frame.world_from_object ?? {})) {
      const one = this.byNode.get(this.nodes.index(name));
      one.matrixAutoUpdate = false;
      one.matrix.copy(one.parent.matrixWorld).invert().multiply(new THREE.Matrix4().set(...rows.flat()));
      one.matrixWorldNeedsUpdate = true;
    }
    for (const name of frame.absent ?? []) this.byNode.get(this.nodes.index(name)).visible = false;
    this.scene.updateMatrixWorld(true);
    if (this.options.recompute) {
      for (const mesh of this.meshes) if (mesh.isSkinnedMesh || mesh.isInstancedMesh) mesh.computeBoundingSphere();
    }
  }

  /** Behind its last key frame an animation stands still. */
  #animate(name, time) {
    const clip = name === undefined ? this.clips[0] : this.clips.find((one) => one.name === name);
    const action = this.mixer.clipAction(clip);
    action.setLoop(THREE.LoopOnce, 1);
    action.clampWhenFinished = true;
    action.reset().play();
    this.mixer.setTime(time);
  }

  look(view) {
    const { width, height, near, far, ymag } = view;
    if (far === null || far === undefined) throw new Error("three.js has no endless far plane");
    const aspect = width / height;
    this.camera = ymag === undefined
      ? new THREE.PerspectiveCamera(THREE.MathUtils.radToDeg(view.yfov), aspect, near, far)
      : new THREE.OrthographicCamera(-ymag * aspect, ymag * aspect, ymag, -ymag, near, far);
    const [x, y] = [view.shift_x_px ?? 0, view.shift_y_px ?? 0];
    if (x || y) this.camera.setViewOffset(width, height, x, y, width, height);
    const { position, quaternion, scale } = this.camera;
    new THREE.Matrix4().set(...view.world_from_camera.flat()).decompose(position, quaternion, scale);
    this.renderer.setSize(width, height, false);
  }

  async draw() {
    this.drawn = [];
    this.renderer.render(this.scene, this.camera);
    return this.drawn;
  }

  tell(r, view, name) {
    r.threeCamera(this.camera, name);
  }

  close() {
    this.renderer.dispose();
    this.renderer.forceContextLoss();
  }
}
