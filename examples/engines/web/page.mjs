/* The page in which an engine draws. An engine is a class with
 *
 *     static async open(canvas, glb, nodes, options)   one scene, from the bytes of a GLB
 *     pose(frame)      objects stand as a path's frame says
 *     look(view)       the camera is that of a view, and the image has its size
 *     async draw()     draws, and gives the glTF nodes of what was in the draw list
 *     tell(recorder, view, name)   the engine's own camera, by the recorder
 *     close() */
import { Recorder } from "recorder";
import { Nodes } from "./scene.mjs";

const answer = async (what, body) => {
  const got = await fetch(`/${what}`, body === undefined ? {} : { method: "POST", body });
  if (!got.ok) throw new Error(await got.text());
  return got;
};

function viewsOf(top, frame) {
  const views = Object.entries(frame.views ?? { "": {} });
  return views.map(([name, fields]) => [frame.views ? name : null, { ...top, ...frame, ...fields }]);
}

/** By name where all nodes have names of their own, and else by number. */
function tellDrawn(r, nodes, drawn, view) {
  if (nodes.named) r.visible(drawn.map((node) => nodes.nodes[node].name), view);
  else r.visibleNodes(drawn, view);
}

async function record(Engine, number, options) {
  const { frames, ...top } = await (await answer(`path/${number}`)).json();
  const glb = await (await answer(`scene/${number}`)).arrayBuffer();
  const canvas = document.createElement("canvas");
  document.body.replaceChildren(canvas);
  const nodes = new Nodes(glb);
  const engine = await Engine.open(canvas, glb, nodes, options);
  const [[, first]] = viewsOf(top, frames[0]);
  const r = new Recorder(null, first.width, first.height);
  if (top.animation !== undefined) r.text("animation", top.animation);
  for (const [index, frame] of frames.entries()) {
    if (options["level-0"]) delete frame.levels;
    if (frame.time_s === undefined && top.fps) frame.time_s = index / top.fps;
    engine.pose({ ...top, ...frame });
    r.beginFrame(index);
    if (frame.time_s !== undefined) r.time(frame.time_s);
    if (frame.cut) r.cut();
    for (const [name, matrix] of Object.entries(frame.world_from_object ?? {})) r.pose(name, "row_major", matrix.flat());
    for (const name of frame.absent ?? []) r.absent(name);
    for (const [name, view] of viewsOf(top, frame)) {
      if (view.clip_plane) throw new Error("clip planes are not tried");
      engine.look(view);
      const drawn = await engine.draw();
      tellDrawn(r, nodes, [...new Set(drawn)].sort((a, b) => a - b), name);
      if (frame.views) for (const size of ["width", "height"]) r.field(size, view[size], name);
      else if (top.width === undefined) for (const size of ["width", "height"]) r.field(size, view[size]);
      engine.tell(r, view, name);
      if (options.pictures) {
        const file = [String(index).padStart(3, "0"), ...(name ? [name] : [])].join("-");
        const picture = await (await fetch(canvas.toDataURL("image/png"))).blob();
        await answer(`picture/${number}/${file}`, picture);
      }
    }
    r.endFrame();
  }
  engine.close();
  await answer(`recording/${number}`, await r.close().text());
}

const { count, options } = await (await answer("todo")).json();
try {
  const { Engine } = await import(`/engines/${location.search.slice(1)}/engine.mjs`);
  for (let number = 0; number < count; number++) {
    try {
      await record(Engine, number, options);
    } catch (problem) {
      await answer(`problem/${number}`, String(problem));
    }
  }
} catch (problem) {
  await answer("problem/0", String(problem));
}
await answer("end", "");
