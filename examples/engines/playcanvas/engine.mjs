/* PlayCanvas: a camera culls by its frustum (`frustumCulling`, the default), a mesh instance at a time. What
 * was drawn are the lists of the layer that are left for that camera (`getCulledInstances`). */
import * as pc from "playcanvas";
import { colourOf } from "/engines/web/scene.mjs";

export class Engine {
  static async open(canvas, glb, nodes, options) {
    const device = await pc.createGraphicsDevice(canvas, { deviceTypes: ["webgl2"], antialias: false });
    const app = new pc.AppBase(canvas);
    const setup = new pc.AppOptions();
    setup.graphicsDevice = device;
    setup.componentSystems = [pc.RenderComponentSystem, pc.CameraComponentSystem, pc.AnimComponentSystem];
    setup.resourceHandlers = [pc.ContainerHandler, pc.TextureHandler];
    app.init(setup);
    app.autoRender = false;
    app.start();
    const url = URL.createObjectURL(new Blob([glb]));
    const asset = new pc.Asset("scene", "container", { url, filename: "scene.glb" });
    await new Promise((loaded, failed) => {
      asset.ready(loaded);
      asset.on("error", failed);
      app.assets.add(asset);
      app.assets.load(asset);
    });
    return new Engine(app, asset.resource, nodes, options);
  }

  constructor(app, container, nodes, options) {
    this.app = app;
    this.nodes = nodes;
    this.options = options;
    this.root = container.instantiateRenderEntity();
    app.root.addChild(this.root);
    this.node = new Map();
    this.placed = [];
    for (const render of this.root.findComponents("render")) {
      const node = this.nodes.index(render.entity.name);
      for (const instance of render.meshInstances) {
        const material = new pc.StandardMaterial();
        material.useLighting = false;
        material.useFog = false;
        material.useTonemap = false;
        material.diffuse = new pc.Color(0, 0, 0);
        material.emissive = new pc.Color(...colourOf(node));
        material.cull = options.oneSided ? instance.material.cull : pc.CULLFACE_NONE;
        material.update();
        instance.material = material;
        if (options["no-culling"]) instance.cull = false;
        this.node.set(instance, node);
      }
    }
    this.eye = new pc.Entity("eye");
    this.eye.addComponent("camera", { frustumCulling: true, clearColor: new pc.Color(0, 0, 0), gammaCorrection: pc.GAMMA_NONE, toneMapping: pc.TONEMAP_NONE });
    app.root.addChild(this.eye);
    app.scene.ambientLight = new pc.Color(0, 0, 0);
  }

  pose(frame) {
    if (frame.time_s !== undefined && this.nodes.document.animations) throw new Error("animations are not tried");
    for (const undo of this.placed.splice(0)) undo();
    for (const [name, rows] of Object.entries(frame.world_from_object ?? {})) {
      const one = this.root.findByName(name);
      const rest = [one.getLocalPosition().clone(), one.getLocalRotation().clone(), one.getLocalScale().clone()];
      const set = (place, turn, size) => { one.setLocalPosition(place); one.setLocalRotation(turn); one.setLocalScale(size); };
      this.placed.push(() => set(...rest));
      const world = matrixOf(rows);
      const local = new pc.Mat4().mul2(one.parent.getWorldTransform().clone().invert(), world);
      set(local.getTranslation(), new pc.Quat().setFromMat4(local), local.getScale());
    }
    for (const name of frame.absent ?? []) {
      const one = this.root.findByName(name);
      one.enabled = false;
      this.placed.push(() => { one.enabled = true; });
    }
  }

  look(view) {
    const { camera } = this.eye;
    const device = this.app.graphicsDevice;
    device.setResolution(view.width, view.height);
    if (view.far === null || view.far === undefined) throw new Error("PlayCanvas has no endless far plane");
    if (view.shift_x_px || view.shift_y_px) throw new Error("lens shifts are not tried");
    camera.nearClip = view.near;
    camera.farClip = view.far;
    camera.aspectRatioMode = pc.ASPECT_MANUAL;
    camera.aspectRatio = view.width / view.height;
    camera.projection = view.ymag === undefined ? pc.PROJECTION_PERSPECTIVE : pc.PROJECTION_ORTHOGRAPHIC;
    if (view.ymag === undefined) camera.fov = (view.yfov * 180) / Math.PI;
    else camera.orthoHeight = view.ymag;
    const pose = matrixOf(view.world_from_camera);
    this.eye.setPosition(pose.getTranslation());
    this.eye.setRotation(new pc.Quat().setFromMat4(pose));
  }

  async draw() {
    this.app.render();
    const layer = this.app.scene.layers.getLayerById(pc.LAYERID_WORLD);
    const { opaque, transparent } = layer.getCulledInstances(this.eye.camera.camera);
    return [...opaque, ...transparent].flatMap((one) => (this.node.has(one) ? [this.node.get(one)] : []));
  }

  tell(r, view, name) {
    const { camera } = this.eye;
    r.camera("camera_from_world", "column_major", camera.viewMatrix.data, name);
    r.field("near", camera.nearClip, name);
    r.field("far", camera.farClip, name);
    if (camera.projection === pc.PROJECTION_PERSPECTIVE) r.field("yfov", (camera.fov * Math.PI) / 180, name);
    else r.field("ymag", camera.orthoHeight, name);
  }

  close() {
    this.app.destroy();
  }
}

function matrixOf(rows) {
  const matrix = new pc.Mat4();
  matrix.data.set(rows[0].flatMap((_, column) => rows.map((row) => row[column])));
  return matrix;
}
