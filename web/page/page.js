// The page: files, camera, progress, tables and drawings. All numbers come from the worker.
import { pixelsOf, readArray, readPicture } from "./files.js";

const MOST_FRAMES = 300; // of a video
const MOST_ERRORS = 0.1; // expected share of wrong bits up to which they are shown: noise alone gives 0.2
const at = (id) => document.getElementById(id);

let worker = null;
let jobs = new Map();
let running = null; // of the present work: { cancelled }

// ---- the worker ----

function startWorker() {
  worker = new Worker(new URL("./worker.js", import.meta.url), { type: "module" });
  jobs = new Map();
  worker.onmessage = ({ data: { job, stage, answer, problem } }) => {
    const one = jobs.get(job);
    if (!one) return;
    if (stage) return one.stage(stage);
    jobs.delete(job);
    if (problem !== undefined) one.reject(new Error(problem));
    else one.resolve(answer);
  };
  worker.onerror = (event) => {
    for (const { reject } of jobs.values()) reject(new Error(event.message || "the library could not be loaded"));
  };
}

let last = 0;
function ask(kind, values = {}, stage = () => {}) {
  return new Promise((resolve, reject) => {
    jobs.set(++last, { resolve, reject, stage });
    const pixels = values.picture?.pixels.buffer;
    worker.postMessage({ job: last, kind, ...values }, pixels ? [pixels] : []);
  });
}

// ---- settings ----

function number(name, unit = 1) {
  const text = at("settings").elements[name].value.trim().replace(",", ".");
  if (text === "") return null;
  const value = Number(text) * unit;
  if (!(value > 0 && Number.isFinite(value))) {
    const label = at("settings").elements[name].labels[0].firstChild.textContent;
    throw new Error(`${label}: got ${text}, allowed: a number above 0`);
  }
  return value;
}

function settings() {
  const { lineCode, scanAxis, colour, toneCurve, avoid } = at("settings").elements;
  const avoided = avoid.value.split(/[\s,;]+/).filter(Boolean).map(Number);
  if (avoided.some((f) => !(f > 0))) throw new Error(`Lights to avoid: got ${avoid.value}, allowed: frequencies in Hz`);
  return {
    rowTime: number("rowTime", 1e-6), known: number("known"), exposure: number("exposure", 1e-6),
    chipRate: number("chipRate"), sense: number("sense"), blockBytes: number("blockBytes") ?? 16, avoid: avoided,
    lineCode: lineCode.value, scanAxis: scanAxis.value, colour: colour.value, toneCurve: toneCurve.value,
  };
}

// ---- one piece of work at a time ----

function say(text, share = null) {
  at("status").textContent = text;
  if (share === null) at("progress").removeAttribute("value");
  else at("progress").value = share;
}

function busy(is) {
  at("progress").hidden = at("cancel").hidden = !is;
  for (const id of ["camera", "demo", "file"]) at(id).disabled = is;
}

class Cancelled extends Error {}

function stopIf(state) {
  if (state.cancelled) throw new Cancelled();
}

async function run(work) {
  if (running) return;
  const state = (running = { cancelled: false });
  at("problem").textContent = "";
  busy(true);
  say("Reading …");
  try {
    say((await work(state)) ?? "Done.");
    at("results-title").focus({ preventScroll: true });
  } catch (problem) {
    if (state.cancelled) say("Cancelled.");
    else {
      say("Nothing was measured.");
      at("problem").textContent = problem.message;
    }
  } finally {
    running = null;
    busy(false);
  }
}

function cancel() {
  if (!running) return;
  running.cancelled = true;
  worker.terminate();
  const waiting = [...jobs.values()];
  startWorker();
  for (const { reject } of waiting) reject(new Cancelled());
}

// ---- sources ----

async function measureFile(file, state) {
  const chosen = settings();
  if (file.name.toLowerCase().endsWith(".npy")) return measureFrames(await readArray(file), chosen, state);
  if (file.type.startsWith("video/")) return measureVideo(file, chosen, state);
  return measurePicture(await readPicture(file), chosen, state);
}

const staged = (stage) => say(`Measuring: ${stage} …`);

async function measurePicture(picture, chosen, state) {
  stopIf(state);
  const shown = copyOf(picture);
  const found = await ask("picture", { picture, settings: chosen }, staged);
  stopIf(state);
  show(shown, found, chosen);
  showData([]);
  return summary(found);
}

async function measureFrames(frames, chosen, state) {
  if (frames.length === 1) return measurePicture(frames[0], chosen, state);
  const received = collected();
  const shown = copyOf(frames[0]);
  const found = await ask("start", { picture: copyOf(frames[0]), settings: chosen, frameTime: frameTime() }, staged);
  show(shown, found, chosen);
  for (let k = 0; k < frames.length; ++k) {
    stopIf(state);
    say(`Frame ${k + 1} of ${frames.length}`, k / frames.length);
    received.add(await ask("frame", { picture: frames[k], number: k }));
    showData(received.lights());
  }
  await ask("stop");
  return `${summary(found)} ${received.summary(frames.length)}`;
}

// Frames of an array have no time stamps: 30 frames a second, as cameras do and `ocisac simulate` assumes.
const frameTime = () => 1 / 30;

async function measureVideo(file, chosen, state) {
  const video = document.createElement("video");
  video.muted = true;
  video.playsInline = true;
  video.src = URL.createObjectURL(file);
  try {
    await event(video, "loadeddata", `${file.name}: this browser cannot play it; it may be damaged`);
    const received = collected();
    const { videoWidth: width, videoHeight: height, duration } = video;
    const step = await framePeriod(video, state);
    const count = Math.max(1, Math.min(MOST_FRAMES, Math.floor(duration / step + 0.5)));
    let found = null;
    for (let k = 0; k < count; ++k) {
      stopIf(state);
      say(`Frame ${k + 1} of ${count}`, k / count);
      await seek(video, Math.min(duration, (k + 0.5) * step));
      const picture = pixelsOf(video, width, height);
      if (k === 0) {
        const shown = copyOf(picture);
        found = await ask("start", { picture: copyOf(picture), settings: chosen, frameTime: step }, staged);
        stopIf(state);
        show(shown, found, chosen);
      }
      received.add(await ask("frame", { picture, number: k, time: k * step }));
      showData(received.lights());
    }
    await ask("stop");
    return `${summary(found)} ${received.summary(count)}`;
  } finally {
    URL.revokeObjectURL(video.src);
    video.removeAttribute("src");
  }
}

function event(target, name, problem) {
  return new Promise((resolve, reject) => {
    target.addEventListener(name, resolve, { once: true });
    target.addEventListener("error", () => reject(new Error(problem)), { once: true });
  });
}

async function seek(video, time) {
  const arrived = event(video, "seeked", "the video ends early; it may be damaged");
  video.currentTime = time;
  await arrived;
}

// From the time stamps of the first frames that are played.
async function framePeriod(video, state) {
  const times = [];
  await new Promise((resolve, reject) => {
    const next = (_, { mediaTime }) => {
      if (times.at(-1) !== mediaTime) times.push(mediaTime);
      if (times.length < 8) video.requestVideoFrameCallback(next);
      else resolve();
    };
    video.requestVideoFrameCallback(next);
    video.addEventListener("ended", resolve, { once: true });
    setTimeout(resolve, 3000);
    video.play().catch(reject);
  });
  video.pause();
  stopIf(state);
  const steps = times.slice(1).map((time, k) => time - times[k]).filter((s) => s > 1e-3).sort((a, b) => a - b);
  return steps[0] ?? 1 / 30;
}

async function useCamera(state) {
  const chosen = settings();
  if (!navigator.mediaDevices?.getUserMedia) throw new Error("This browser gives pages no camera.");
  const wanted = { facingMode: "environment", width: { ideal: 1920 }, height: { ideal: 1080 } };
  let media;
  try {
    media = await navigator.mediaDevices.getUserMedia({ video: wanted });
  } catch (problem) {
    throw new Error(`The camera cannot be used: ${problem.message}`);
  }
  const video = at("video");
  try {
    video.srcObject = media;
    await video.play();
    video.hidden = false;
    const received = collected();
    let found = null;
    for (let k = 0; ; ++k) {
      const { mediaTime } = await new Promise((next) => video.requestVideoFrameCallback((_, data) => next(data)));
      stopIf(state);
      if (!media.active) break;
      const picture = pixelsOf(video, video.videoWidth, video.videoHeight);
      if (k === 0) {
        const shown = copyOf(picture);
        found = await ask("start", { picture: copyOf(picture), settings: chosen, frameTime: 1 / 30 }, staged);
        show(shown, found, chosen);
      }
      received.add(await ask("frame", { picture, number: k, time: mediaTime }));
      showData(received.lights());
      say(`Camera: ${k + 1} frames measured. Cancel ends it.`);
    }
    return received.summary(0);
  } finally {
    for (const track of media.getTracks()) track.stop();
    video.srcObject = null;
    video.hidden = true;
  }
}

async function demo(state) {
  const form = at("settings").elements;
  const told = await (await fetch("demo.json")).json();
  for (const [name, value] of Object.entries(told)) form[name].value = value;
  const answer = await fetch("demo.npy");
  const file = new File([await answer.blob()], "demo.npy");
  return measureFrames(await readArray(file), settings(), state);
}

// ---- what the receiver said of all frames ----

function collected() {
  const sources = new Map();
  return {
    add(results) {
      for (const result of results) {
        const one = sources.get(result.source) ?? { source: result.source, frames: 0, payloads: new Map() };
        one.frames += result.bits ? 1 : 0;
        one.last = result.bits || result.gain === result.gain ? result : one.last ?? result;
        if (result.payload) one.payloads.set(result.packet, result.payload);
        one.share = result.packetShare;
        sources.set(result.source, one);
      }
    },
    lights: () => [...sources.values()],
    summary(frames) {
      const payloads = [...sources.values()].reduce((sum, one) => sum + one.payloads.size, 0);
      return `${frames ? `${frames} frames, ` : ""}${payloads} payload${payloads === 1 ? "" : "s"} whole.`;
    },
  };
}

// ---- tables ----

const digits = (value, count = 5) => (Number.isFinite(value) ? String(Number(value.toPrecision(count))) : "unknown");
const withSpread = (value, spread, unit) =>
  `${digits(value)}${spread > 0 ? ` ± ${digits(spread, 2)}` : ""}${Number.isFinite(value) ? ` ${unit}` : ""}`.trim();
const microseconds = (seconds) => `${digits(seconds * 1e6)} µs`;

function fill(list, facts) {
  list.replaceChildren(...facts.flatMap(([name, value, className]) => {
    const term = document.createElement("dt");
    const text = document.createElement("dd");
    term.textContent = name;
    text.textContent = value;
    if (className) text.className = className;
    return [term, text];
  }));
}

function summary({ lights }) {
  if (lights.length === 0) return "No modulated light was found; the whole picture was measured.";
  return lights.length === 1 ? "One light was found." : `${lights.length} lights were found.`;
}

let present = null; // what is shown

function show(picture, found, chosen) {
  present = { picture, found, chosen, unit: found.rowTime === null ? "cycles/row" : "Hz" };
  at("results").hidden = false;
  drawPicture(picture, found);
  const { unit } = present;
  at("lights").replaceChildren(...found.found.map(({ light, tone, box }, k) => {
    const row = document.createElement("tr");
    const remarks = [...new Set([...(light?.flags ?? []), ...tone.flags])].map((flag) => flag.replaceAll("_", " "));
    if (light?.carriesData) remarks.unshift("carries data");
    if (light && light.reflectionOf !== null) remarks.unshift(`reflection of light ${light.reflectionOf + 1}`);
    const cells = [
      light ? `${k + 1}` : "whole picture",
      withSpread(light?.frequency ?? tone.frequency, light?.frequencyStd ?? tone.frequencyStd, unit),
      withSpread(light?.gain ?? tone.gain, light?.gainStd ?? tone.gainStd, ""),
      digits(tone.theory, 4),
      light ? digits(light.probability, 3) : "",
      `x ${box.x}, y ${box.y}, ${box.width} × ${box.height}`,
      remarks.join(", "),
    ];
    cells.forEach((text, index) => {
      const cell = document.createElement(index === 0 ? "th" : "td");
      if (index === 0) cell.scope = "row";
      cell.textContent = text;
      row.append(cell);
    });
    return row;
  }));
  fill(at("facts"), facts(found, chosen));
  drawSpectrum(found, unit);
  drawColumn(found);
}

function facts({ rowTime, calibration, advice }, chosen) {
  const rows = [["Row time", rowTime === null ? "unknown: give it, or the frequency of the lamp" : microseconds(rowTime)]];
  if (calibration) {
    const flags = calibration.flags.length ? ` (${calibration.flags.join(", ").replaceAll("_", " ")})` : "";
    rows[0][1] = `${digits(calibration.rowTime * 1e6)} ± ${digits(calibration.rowTimeStd * 1e6, 2)} µs from the lamp${flags}`;
  }
  if (advice?.best) {
    const serves = chosen.sense ? "Best exposure for data and sensing" : "Best exposure for this light";
    rows.push([serves, `${microseconds(advice.best.exposure)} (gain ${digits(advice.best.gain, 3)})`]);
  }
  if (advice?.withoutBands) {
    const { exposure, modulation, holds } = advice.withoutBands;
    const left = `${digits(modulation * 100, 2)} % left of ${chosen.avoid.join(" and ")} Hz`;
    rows.push(["Exposure without bands of other lights", `${microseconds(exposure)}, ${left}${holds ? "" : " (the best there is)"}`]);
  }
  return rows;
}

function textOf(payload) {
  try {
    return `“${new TextDecoder("utf-8", { fatal: true }).decode(payload)}”`;
  } catch {
    return [...payload].map((byte) => byte.toString(16).padStart(2, "0")).join(" ");
  }
}

// Bits and payloads: of the lights of a stream, or of the picture.
function showData(lights) {
  const rows = [];
  let doubtful = false;
  for (const one of lights) {
    const { x, y } = one.last?.region ?? { x: 0, y: 0 };
    const name = `Light at ${x}, ${y}`;
    for (const [packet, payload] of one.payloads) rows.push([`${name}, packet ${packet}`, textOf(payload)]);
    if (one.payloads.size === 0 && one.share > 0) rows.push([`${name}, packet`, `${digits(one.share * 100, 3)} % received`]);
    if (reliable(one.last)) rows.push([`${name}, bits of a frame`, one.last.bits, "bits"], rate(name, one.last));
    else doubtful ||= Boolean(one.last?.bits);
    // The strongest line of chips is no tone of the lamp, and another one in every frame.
    const sends = one.payloads.size > 0 || reliable(one.last);
    if (!sends && Number.isFinite(one.last?.gain) && !one.last.gainFlags.includes("weak")) {
      const { gain, gainStd, frequency } = one.last;
      rows.push([`${name}, tone`, `${digits(frequency)} ${present.unit}, gain ${withSpread(gain, gainStd, "")}`]);
    }
  }
  if (lights.length === 0)
    present.found.found.forEach(({ data }, k) => {
      if (reliable(data)) rows.push([`Light ${k + 1}, bits`, data.bits, "bits"], rate(`Light ${k + 1}`, data));
      else doubtful ||= Boolean(data?.bits);
    });
  if (doubtful) rows.push(["Not shown", `bits of which more than ${100 * MOST_ERRORS} % are expected to be wrong`]);
  fill(at("data"), rows.length ? rows : [["Data", "none was received"]]);
}

const reliable = (data) => Boolean(data?.bits) && data.errorRate <= MOST_ERRORS;

function rate(name, { rowsPerChip, chipRate, errorRate }) {
  const inHertz = present.found.rowTime === null ? "" : `, ${digits(chipRate)} chips a second`;
  return [`${name}, chips`, `${digits(rowsPerChip)} rows each${inHertz}; expected wrong: ${digits(errorRate * 100, 2)} %`];
}

// ---- drawings ----

const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

function copyOf({ pixels, ...rest }) {
  return { pixels: pixels.slice(), ...rest };
}

function drawPicture({ pixels, width, height, channels }, { found, lights }) {
  const canvas = at("picture");
  Object.assign(canvas, { width, height });
  const context = canvas.getContext("2d");
  let bytes = pixels;
  if (channels === 1) {
    bytes = new Uint8ClampedArray(4 * width * height).fill(255);
    const scale = pixels instanceof Uint16Array ? 1 / 257 : 1;
    for (let k = 0; k < width * height; ++k) bytes.fill(pixels[k] * scale, 4 * k, 4 * k + 3);
  }
  context.putImageData(new ImageData(bytes, width, height), 0, 0);
  if (lights.length === 0) {
    canvas.setAttribute("aria-label", `Picture of ${width} by ${height} pixels without a found light`);
    return;
  }
  const line = Math.max(2, width / 300);
  context.lineWidth = line;
  context.strokeStyle = context.fillStyle = colour("--box");
  context.font = `600 ${Math.max(14, width / 30)}px system-ui, sans-serif`;
  found.forEach(({ box }, k) => {
    context.strokeRect(box.x + line / 2, box.y + line / 2, box.width - line, box.height - line);
    context.fillText(`${k + 1}`, box.x + 2 * line, box.y + Math.max(16, width / 28));
  });
  canvas.setAttribute("aria-label", `Picture with ${found.length} boxes of lights; the table tells where`);
}

// Axes of a drawing; gives functions that place values.
function axes(canvas, [left, right], [low, high], labels) {
  const context = canvas.getContext("2d");
  const width = canvas.clientWidth;
  const height = Math.round(Math.max(220, Math.min(360, 0.4 * width)));
  Object.assign(canvas, { width: width * devicePixelRatio, height: height * devicePixelRatio });
  context.scale(devicePixelRatio, devicePixelRatio);
  const frame = { x: 62, y: 14, width: width - 76, height: height - 58 };
  const ink = getComputedStyle(document.body).color;
  Object.assign(context, { strokeStyle: ink, fillStyle: ink, lineWidth: 1, font: "15px system-ui, sans-serif" });
  context.strokeRect(frame.x, frame.y, frame.width, frame.height);
  const x = (value) => frame.x + ((value - left) / (right - left)) * frame.width;
  const y = (value) => frame.y + (1 - (Math.min(Math.max(value, low), high) - low) / (high - low)) * frame.height;
  context.textAlign = "center";
  for (let k = 0; k <= 4; ++k) {
    const value = left + (k / 4) * (right - left);
    context.fillText(digits(value, 3), Math.min(x(value), width - 28), height - 26);
  }
  context.fillText(labels.x, frame.x + frame.width / 2, height - 6);
  context.textAlign = "right";
  for (const value of labels.ticks) context.fillText(labels.tick(value), frame.x - 6, y(value) + 5);
  return { context, x, y, frame };
}

function path(context, points, style, width, dash = []) {
  context.beginPath();
  context.strokeStyle = style;
  context.lineWidth = width;
  context.setLineDash(dash);
  points.forEach(([a, b], k) => (k === 0 ? context.moveTo(a, b) : context.lineTo(a, b)));
  context.stroke();
  context.setLineDash([]);
}

function drawSpectrum({ found }, unit) {
  const { tone } = found[0];
  const { amplitude, response, step, frequency, gain, theory } = tone;
  const labels = { x: `frequency (${unit})`, ticks: [0, -1, -2, -3, -4], tick: (v) => `10${["⁰", "⁻¹", "⁻²", "⁻³", "⁻⁴"][-v]}` };
  const last = (amplitude.length - 1) * step;
  const { context, x, y } = axes(at("spectrum"), [0, last], [-4.5, 0.3], labels);
  const curve = (values) => Array.from(values, (value, k) => [x(k * step), y(Math.log10(Math.max(value, 1e-9)))]);
  path(context, curve(amplitude), colour("--accent"), 1.2);
  if (Number.isFinite(response[0])) path(context, curve(response), colour("--other"), 1.5, [7, 5]);
  if (Number.isFinite(gain) && gain > 0) {
    context.beginPath();
    context.arc(x(Math.min(frequency, last)), y(Math.log10(gain)), 7, 0, 7);
    context.strokeStyle = colour("--fit");
    context.lineWidth = 3;
    context.stroke();
  }
  const fit = Number.isFinite(gain)
    ? `Light 1: the fit (circle) gives gain ${digits(gain)} at ${digits(frequency)} ${unit}.`
    : "Light 1: no tone was fitted.";
  const dashed = Number.isFinite(theory) ? ` Dashed: |sinc(f·T)| of the exposure, ${digits(theory, 4)} at the tone.` : "";
  at("spectrum-text").textContent = `${fit}${dashed} Line: amplitude of the column over its mean.`;
  at("spectrum").setAttribute("aria-label", at("spectrum-text").textContent);
}

function drawColumn({ found, drawn }) {
  const { column, data } = found[drawn];
  const first = reliable(data) ? data.firstBit : 0;
  const chips = reliable(data) ? Math.min(data.bits.length, 40) : 0;
  const shown = chips ? Math.ceil(chips * data.rowsPerChip) : Math.min(column.length, 400);
  const begin = Math.max(0, Math.floor(first));
  const part = column.slice(begin, Math.min(column.length, begin + shown + 1));
  const low = Math.min(...part);
  const high = Math.max(...part, low + 1e-9);
  const margin = 0.06 * (high - low);
  const labels = { x: "row", ticks: [low, (low + high) / 2, high], tick: (v) => digits(v, 3) };
  const { context, x, y, frame } = axes(at("column"), [begin, begin + shown], [low - margin, high + margin], labels);
  for (let k = 0; k < chips; ++k) {
    const from = x(first + k * data.rowsPerChip);
    const to = Math.min(x(first + (k + 1) * data.rowsPerChip), frame.x + frame.width);
    context.fillStyle = data.bits[k] === "1" ? `${colour("--other")}44` : "#8881";
    context.fillRect(from, frame.y, to - from, frame.height);
  }
  path(context, Array.from(part, (value, k) => [x(begin + k), y(value)]), colour("--accent"), 1.5);
  at("column-text").textContent = chips
    ? `Light ${drawn + 1}: rows ${begin} to ${begin + shown}, the first ${chips} chips ${data.bits.slice(0, chips)}; shaded chips are bright.`
    : `Light ${drawn + 1}: the first ${shown} rows; no chips were received.`;
  at("column").setAttribute("aria-label", at("column-text").textContent);
}

// ---- start ----

startWorker();
const drop = at("drop");
for (const name of ["dragenter", "dragover"])
  drop.addEventListener(name, (dragged) => {
    dragged.preventDefault();
    drop.classList.add("over");
  });
drop.addEventListener("dragleave", () => drop.classList.remove("over"));
drop.addEventListener("drop", (dropped) => {
  dropped.preventDefault();
  drop.classList.remove("over");
  const [file] = dropped.dataTransfer.files;
  if (file) run((state) => measureFile(file, state));
});
at("file").addEventListener("change", ({ target }) => {
  const [file] = target.files;
  target.value = "";
  if (file) run((state) => measureFile(file, state));
});
at("camera").addEventListener("click", () => run(useCamera));
at("demo").addEventListener("click", () => run(demo));
at("cancel").addEventListener("click", cancel);
addEventListener("resize", () => {
  if (present) drawSpectrum(present.found, present.unit), drawColumn(present.found);
});
at("settings").addEventListener("submit", (submitted) => submitted.preventDefault());

ask("version").then(
  (version) => {
    at("version").textContent = `ocisac ${version}, on this device alone.`;
    if (!running) say("Ready.");
  },
  (problem) => {
    say("This browser cannot run the library.");
    at("problem").textContent = `${problem.message}. WebAssembly with exceptions and SIMD is needed.`;
  },
);
if ("serviceWorker" in navigator) navigator.serviceWorker.register("service-worker.js").catch(() => {});
