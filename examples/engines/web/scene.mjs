/* What every engine here asks of a GLB's own JSON: the nodes by name, and colours to tell them apart. */

export class Nodes {
  constructor(glb) {
    const view = new DataView(glb);
    const json = new Uint8Array(glb, 20, view.getUint32(12, true));
    this.document = JSON.parse(new TextDecoder().decode(json));
    this.nodes = this.document.nodes ?? [];
    const names = this.nodes.map((node) => node.name ?? "");
    this.named = !names.includes("") && new Set(names).size === names.length;
  }

  /** The one node of that name. */
  index(name) {
    const found = this.nodes.flatMap((node, index) => (node.name === name ? [index] : []));
    if (found.length !== 1) throw new Error(`${found.length} nodes of the scene are called '${name}'`);
    return found[0];
  }
}

/** Red, green and blue of 0 to 1, another for each node and none of them black: pictures are item buffers. */
export function colourOf(node) {
  const number = Math.imul(node + 1, 0x9e3779) & 0xffffff;
  return [number >> 16, (number >> 8) & 255, number & 255].map((part) => part / 255);
}
