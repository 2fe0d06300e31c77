/* A web engine draws scenes along camera paths in headless Chromium, and records what it drew:
 *
 *     node web/record.mjs ENGINE SCENE.glb PATH.json RECORDING.jsonl [--NAME[=VALUE] ...]
 *     node web/record.mjs ENGINE --suite SUITE OUT [...]     every case of `visref conformance --write SUITE`
 *
 * ENGINE is a folder beside this one (three, babylonjs, playcanvas), whose engine.mjs says which options
 * it has; all have --no-culling, --pictures=DIR for a picture of every view, and --level-0, which passes over
 * the path's levels of detail. Chromium's WebGL is drawn by SwiftShader, on the CPU. Page and files are served on the loopback interface alone. */
import { spawn } from "node:child_process";
import { existsSync, mkdirSync, mkdtempSync, readFileSync, rmSync, writeFileSync } from "node:fs";
import { createServer } from "node:http";
import { tmpdir } from "node:os";
import { dirname, extname, join, normalize } from "node:path";
import { fileURLToPath } from "node:url";

const ENGINES = dirname(dirname(fileURLToPath(import.meta.url)));
const RECORDER = join(ENGINES, "..", "..", "recorders", "javascript");
const TYPES = { ".html": "text/html", ".js": "text/javascript", ".mjs": "text/javascript", ".json": "application/json" };
const FLAGS = [
  "--headless=new", "--no-sandbox", "--no-first-run", "--disable-quic", "--disable-background-networking",
  "--disable-component-update", "--disable-sync", "--disable-extensions", "--hide-scrollbars", "--mute-audio",
  "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist",
];

function fail(problem) {
  console.error(problem);
  process.exit(1);
}

/** What is to be recorded: files in, file out. */
function jobs(words, suite) {
  if (!suite) return [{ name: "", scene: words[0], path: words[1], recording: words[2] }];
  mkdirSync(words[1], { recursive: true });
  const { cases } = JSON.parse(readFileSync(join(words[0], "manifest.json"), "utf8"));
  return cases.map(({ name, scene, path }) => ({
    name, scene: join(words[0], scene), path: join(words[0], path), recording: join(words[1], `${name}.jsonl`),
  }));
}

function chromium() {
  const folders = (process.env.PATH ?? "").split(":");
  const names = ["chromium", "chromium-browser", "google-chrome"];
  const found = names.flatMap((name) => folders.map((folder) => join(folder, name))).find(existsSync);
  return found ?? fail("there is no Chromium");
}

const args = process.argv.slice(2);
const words = args.filter((one) => !one.startsWith("--"));
const engine = words.shift();
const options = Object.fromEntries(
  args.filter((one) => one.startsWith("--")).map((one) => [...one.slice(2).split("="), true].slice(0, 2)),
);
const suite = options.suite === true;
if (engine === undefined || words.length !== (suite ? 2 : 3)) fail("usage: record.mjs ENGINE SCENE PATH RECORDING");
if (!existsSync(join(ENGINES, "node_modules"))) fail("there are no engines; run: make engines");
options.oneSided = suite || process.env.VISREF_CULL_BACKFACES === "1";
const todo = jobs(words, suite);
const profile = mkdtempSync(join(tmpdir(), "visref-chromium-"));
let status = 0;

/** The page asks for "todo", for "scene/N" and "path/N"; and hands back "recording/N", "picture/N/NAME", a
 * "problem/N", and the "end". */
const ANSWERS = {
  todo: () => JSON.stringify({ count: todo.length, options }),
  scene: (number) => readFileSync(todo[number].scene),
  path: (number) => readFileSync(todo[number].path),
  recording: (number, body) => writeFileSync(todo[number].recording, body),
  picture: (number, body, name) => {
    mkdirSync(options.pictures, { recursive: true });
    writeFileSync(join(options.pictures, `${name}.png`), body);
  },
  problem: (number, body) => {
    console.error([todo[number]?.name, body].filter(Boolean).join(": "));
    if (!suite) status = 1;
  },
  log: (_, body) => console.log(String(body)),
  end: () => void setImmediate(end),
};

function file(url) {
  const [, top, ...rest] = normalize(decodeURIComponent(url)).split("/");
  if (top === "engines") return readFileSync(join(ENGINES, ...rest));
  if (top === "recorder") return readFileSync(join(RECORDER, ...rest));
  throw new Error(`there is no ${url}`);
}

const server = createServer(async (request, response) => {
  const parts = [];
  for await (const part of request) parts.push(part);
  const url = new URL(request.url, "http://localhost").pathname;
  const [, what, number, name] = url.split("/");
  try {
    const answer = ANSWERS[what]?.(Number(number), Buffer.concat(parts), name) ?? (ANSWERS[what] ? "" : file(url));
    response.writeHead(200, { "content-type": TYPES[extname(url)] ?? "application/octet-stream" });
    response.end(answer);
  } catch (problem) {
    response.writeHead(404).end(String(problem));
  }
});

let browser;
/** With all processes of the browser, so that nothing more is written into its profile. */
function end() {
  process.kill(-browser.pid, "SIGKILL");
}

server.listen(0, "127.0.0.1", () => {
  const page = `http://127.0.0.1:${server.address().port}/engines/web/page.html?${engine}`;
  browser = spawn(chromium(), [...FLAGS, `--user-data-dir=${profile}`, page], { stdio: "ignore", detached: true });
  browser.on("exit", (code) => {
    if (code !== null) status = 1; // it went away by itself
    server.close();
    rmSync(profile, { recursive: true, force: true, maxRetries: 20 });
    process.exit(status);
  });
});
for (const signal of ["SIGINT", "SIGTERM"]) process.on(signal, () => { status = 1; end(); });
