import "./visref_recorder.js";

export const { Recorder, RecordingError, threeNode, babylonName } = globalThis.visref;
