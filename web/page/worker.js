// Measures pictures and streams of frames in a thread of its own; it is ended to cancel. Messages: { job, kind, ... };
// answers: { job, stage }, { job, answer } or { job, problem }.
import { load } from "./ocisac.js";

const COLOURS = { red: 0, green: 1, blue: 2 };
const MOST_FITTED = 8;
const MOST_SOURCES = 4;

const library = load();
let stream = null;

function gray({ pixels, width, height, channels }, colour, number = 0) {
  if (channels === 1) return { pixels, width, height, number };
  const one = new Uint8Array(width * height);
  for (let k = 0, from = COLOURS[colour]; k < one.length; ++k, from += channels) one[k] = pixels[from];
  return { pixels: one, width, height, number };
}

// Without a row time, times are in rows and frequencies in cycles per row.
function optionsOf(settings, rowTime) {
  const { toneCurve, scanAxis, lineCode, blockBytes } = settings;
  const timed = rowTime !== null;
  return {
    rowTime: timed ? rowTime : 1, toneCurve, scanAxis, lineCode, blockBytes,
    exposure: timed ? settings.exposure : null,
    chipRate: timed ? settings.chipRate : null,
    senseFrequency: timed ? settings.sense : null,
  };
}

function advice(ocisac, settings, light, data) {
  const comm = data && data.chipRate > 0 ? data.chipRate / 2 : light.frequency;
  const avoided = settings.avoid.map((frequency) => ({ frequency, uncertainty: 0.01 * frequency }));
  const found = { best: null, withoutBands: null };
  if (comm > 0) found.best = ocisac.adviseExposure({ commFrequency: comm, senseFrequency: settings.sense });
  if (avoided.length > 0) found.withoutBands = ocisac.adviseExposure({}, avoided);
  return found;
}

// Lights of one picture: the row time of a known lamp, boxes, tones with spectra, bits.
function measure(ocisac, picture, settings, stage) {
  const frame = gray(picture, settings.colour);
  let { rowTime } = settings;
  let calibration = null;
  if (settings.known !== null) {
    stage("row time");
    calibration = ocisac.calibrate(frame, settings.known, optionsOf(settings, null));
    if (rowTime === null && calibration.rowTime > 0) rowTime = calibration.rowTime;
  }
  const options = optionsOf(settings, rowTime);
  stage("lights");
  const lights = ocisac.detect(frame, options);
  const whole = { x: 0, y: 0, width: frame.width, height: frame.height };
  const places = lights.length > 0 ? lights.slice(0, MOST_FITTED) : [{ box: whole, carriesData: true }];
  const found = places.map((light, k) => {
    stage(`light ${k + 1} of ${places.length}`);
    const tone = ocisac.findFrequency(frame, { ...options, region: light.box });
    const data = light.carriesData ? bitsOf(ocisac, frame, options, light) : null;
    return { light: lights[k] ?? null, box: light.box, tone, data };
  });
  // Its rows are those of the picture, as those of its bits.
  const drawn = Math.max(0, found.findIndex(({ data }) => data?.bits));
  found[drawn].column = ocisac.findFrequency(frame, { ...options, region: stripOf(found[drawn].box, frame, options) }).column;
  const advised = rowTime === null ? null : advice(ocisac, settings, lights[0] ?? found[0].tone, found[0].data);
  return { rowTime, calibration, lights, found, drawn, advice: advised };
}

// All rows of a box's columns.
function stripOf(box, { width, height }, { scanAxis }) {
  return ["right", "left"].includes(scanAxis) ? { ...box, x: 0, width } : { ...box, y: 0, height };
}

function bitsOf(ocisac, frame, options, light) {
  const receiver = ocisac.receiver({ ...options, region: light.box, wantGain: 0 });
  try {
    return receiver.push(frame)[0] ?? null;
  } finally {
    receiver.free();
  }
}

const work = {
  async picture(ocisac, { picture, settings }, stage) {
    return measure(ocisac, picture, settings, stage);
  },
  // A stream begins: its first picture is measured, too.
  async start(ocisac, { picture, settings, frameTime }, stage) {
    const first = measure(ocisac, picture, settings, stage);
    const options = { ...optionsOf(settings, first.rowTime), maxLights: MOST_SOURCES };
    if (first.rowTime !== null && frameTime) options.frameTime = frameTime;
    stream = { receiver: ocisac.receiver(options), settings, timed: first.rowTime !== null };
    return first;
  },
  async frame(_, { picture, number, time }) {
    const stamp = stream.timed && time !== undefined ? { time } : {};
    return stream.receiver.push(gray(picture, stream.settings.colour, number), stamp);
  },
  async stop() {
    stream?.receiver.free();
    stream = null;
    return null;
  },
  async version(ocisac) {
    return ocisac.version;
  },
};

self.onmessage = async ({ data }) => {
  const { job, kind } = data;
  try {
    const ocisac = await library;
    self.postMessage({ job, answer: await work[kind](ocisac, data, (stage) => self.postMessage({ job, stage })) });
  } catch (problem) {
    self.postMessage({ job, problem: problem.message });
  }
};
