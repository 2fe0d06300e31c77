import "./visref_recorder.js";

export const { Recorder, RecordingError } = globalThis.visref;
