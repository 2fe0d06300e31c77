export * from "./visref_recorder.js";
