export type Form = "world_from_camera" | "camera_from_world" | "clip_from_world";
export type Order = "row_major" | "column_major";
/** A view's name; null in a frame whose one view has none. */
export type View = string | null;

export class RecordingError extends Error {}

/** What three.js's cameras have. */
export interface ThreeCamera {
  matrixWorld: { elements: ArrayLike<number> };
  projectionMatrix: { elements: ArrayLike<number> };
  near: number;
  far: number;
}

/** What Babylon.js's cameras have. */
export interface BabylonCamera {
  getScene(): { useRightHandedSystem: boolean };
  getViewMatrix(): { m: ArrayLike<number> };
  getProjectionMatrix(): { m: ArrayLike<number> };
  minZ: number;
  maxZ: number;
}

/** What three.js's GLTFLoader gives. */
export interface ThreeGltf {
  parser: { associations: { get(object: any): { nodes?: number } | undefined } };
}

/** The glTF node of an object of three.js, for `visibleNodes`; undefined: it is of no file. */
export function threeNode(gltf: ThreeGltf, object: unknown): number | undefined;
/** The glTF node's name of a mesh of Babylon.js, for `visible`. */
export function babylonName(mesh: { name: string; parent?: { name: string } | null }): string;

export class Recorder {
  /** `file`: a path in node; null keeps the text for `close` or `download`. Sizes are in pixels. */
  constructor(file: string | null | undefined, width: number, height: number);
  /** What went wrong first, or null; `close` throws it. */
  problem: string | null;
  /** `number`: ascending; gaps are allowed. */
  beginFrame(number: number): void;
  time(seconds: number): void;
  /** The camera has jumped. */
  cut(): void;
  camera(form: Form, order: Order, matrix: ArrayLike<number>, view?: View): void;
  threeCamera(camera: ThreeCamera, view?: View): void;
  babylonCamera(camera: BabylonCamera, view?: View): void;
  /** "near", "far" (Infinity: endless), "yfov" (vertical, radians) or "ymag" (half the view's
   * height), "fps", "shift_x_px", "shift_y_px"; "width", "height" of another size. Before the first frame: of all frames. */
  field(name: string, value: number, view?: View): void;
  /** "units", "clip_depth" ("-1..1", "0..1", "1..0"), "clip_y" ("down"). */
  text(name: string, text: string): void;
  /** Before the first frame. */
  group(name: string, objects: Iterable<string>): void;
  /** Ids and names, of objects or groups; [] says that nothing was drawn. */
  visible(drawn: Iterable<number | string>, view?: View): void;
  /** The same by glTF node index. */
  visibleNodes(nodes: Iterable<number | undefined>, view?: View): void;
  absent(name: string): void;
  /** world_from_object of an object, or what moves a whole group. */
  pose(name: string, order: Order, matrix: ArrayLike<number>): void;
  level(group: string, level: number): void;
  /** The box that was tested, in world space. */
  bounds(name: string, least: ArrayLike<number>, greatest: ArrayLike<number>): void;
  stat(name: string, count: number): void;
  statMs(phase: string, ms: number): void;
  endFrame(): void;
  /** What is written is not to be lost in a crash. */
  flush(): void;
  /** Throws RecordingError if anything went wrong. A Blob, where there is no file. */
  close(): Blob | null;
  /** In a page: close, and hand the recording to the user. */
  download(name?: string): void;
}
