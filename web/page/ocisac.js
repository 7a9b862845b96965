// The receiver for JavaScript: ocisac.h, built to WebAssembly, with its structs as plain objects. No logic of its own.
import createModule from "./ocisac.mjs";

// Fields of the structs of ocisac.h, in their order.
const REGION = [["x", "u32"], ["y", "u32"], ["width", "u32"], ["height", "u32"]];
const LAYOUTS = {
  options: [["size", "u32"], ["rowTime", "f64"], ["exposure", "f64"], ["frameTime", "f64"], ["frequency", "f64"],
    ["chipRate", "f64"], ["senseFrequency", "f64"], ["darkLevel", "f64"], ["whiteLevel", "f64"], ["background", "f64"],
    ["duty", "f64"], ["waveform", "i32"], ["lineCode", "i32"], ["blockBytes", "u32"], ["lengthened", "i32"],
    ["wantGain", "i32"], ["wantData", "i32"], ["region", REGION], ["maxLights", "u32"], ["toneCurve", "i32"],
    ["gamma", "f64"], ["scanAxis", "i32"]],
  frame: [["pixels", "u32"], ["format", "i32"], ["width", "u32"], ["height", "u32"], ["stride", "i32"],
    ["number", "i64"]],
  stamp: [["size", "u32"], ["time", "f64"], ["exposure", "f64"], ["gain", "f64"]],
  result: [["size", "u32"], ["frame", "i64"], ["region", REGION], ["searched", "i32"], ["gainFlags", "u32"],
    ["dataFlags", "u32"], ["frequency", "f64"], ["gain", "f64"], ["gainStd", "f64"], ["gainSnr", "f64"],
    ["chipRate", "f64"], ["dataSnr", "f64"], ["errorRate", "f64"], ["suggestedExposure", "f64"], ["bits", "u32"],
    ["bitCount", "u32"], ["payload", "u32"], ["payloadBytes", "u32"], ["packet", "u32"], ["source", "u32"],
    ["frequencyStd", "f64"], ["rowsPerChip", "f64"], ["exposure", "f64"], ["packetShare", "f64"], ["firstBit", "f64"]],
  light: [["size", "u32"], ["box", REGION], ["probability", "f64"], ["frequency", "f64"], ["frequencyStd", "f64"],
    ["gain", "f64"], ["gainStd", "f64"], ["snr", "f64"], ["phase", "f64"], ["carriesData", "i32"],
    ["reflectionOf", "i32"], ["flags", "u32"]],
  calibration: [["size", "u32"], ["rowTime", "f64"], ["rowTimeStd", "f64"], ["flags", "u32"]],
  tone: [["size", "u32"], ["column", "u32"], ["amplitude", "u32"], ["response", "u32"], ["rows", "u32"],
    ["step", "f64"], ["frequency", "f64"], ["frequencyStd", "f64"], ["gain", "f64"], ["gainStd", "f64"],
    ["phase", "f64"], ["mean", "f64"], ["snr", "f64"], ["theory", "f64"], ["columns", "u32"], ["flags", "u32"]],
  flicker: [["size", "u32"], ["frequency", "f64"], ["uncertainty", "f64"], ["duty", "f64"], ["depth", "f64"]],
  exposure_request: [["size", "u32"], ["commFrequency", "f64"], ["senseFrequency", "f64"], ["commWeight", "f64"],
    ["senseWeight", "f64"], ["shortest", "f64"], ["longest", "f64"], ["step", "f64"], ["below", "f64"],
    ["near", "f64"], ["minGain", "f64"]],
  exposure_advice: [["size", "u32"], ["exposure", "f64"], ["objective", "f64"], ["gain", "f64"],
    ["modulation", "f64"], ["holds", "i32"]],
};
const BYTES = { u32: 4, i32: 4, f64: 8, i64: 8 };
const CHOICES = {
  waveform: ["tone", "square"],
  lineCode: ["none", "manchester", "4b6b", "8b10b"],
  toneCurve: ["linear", "srgb", "gamma"],
  scanAxis: ["down", "up", "right", "left"],
};
const MOST_LIGHTS = 64;

// Offsets by C's rule: each field at a multiple of its own size.
function placed(fields) {
  let at = 0;
  let alignment = 4;
  const places = fields.map(([name, kind]) => {
    if (Array.isArray(kind)) {
      const place = { name, kind, at };
      at += 4 * kind.length;
      return place;
    }
    const bytes = BYTES[kind];
    alignment = Math.max(alignment, bytes);
    at = Math.ceil(at / bytes) * bytes + bytes;
    return { name, kind, at: at - bytes };
  });
  return { places, size: Math.ceil(at / alignment) * alignment };
}

const STRUCTS = Object.fromEntries(Object.entries(LAYOUTS).map(([name, fields]) => [name, placed(fields)]));

export class OcisacError extends Error {}

// Loads the library once. `wasm`: address of ocisac.wasm; by default beside this file.
export async function load({ wasm } = {}) {
  const address = wasm ?? new URL("./ocisac.wasm", import.meta.url).href;
  return new Ocisac(await createModule({ locateFile: () => address }));
}

class Ocisac {
  #c;

  constructor(module) {
    this.#c = module;
    for (const [name, { size }] of Object.entries(STRUCTS)) {
      if (name === "frame") continue;
      const stated = this.#within((memory) => this.#read("options", memory.struct(name), ["size"]).size);
      if (stated !== size) throw new OcisacError(`ocisac_${name}: got ${stated} bytes, allowed: ${size}`);
    }
  }

  get version() {
    return this.#c.UTF8ToString(this.#c._ocisac_version());
  }

  // Names of the set bits.
  flagNames(mask) {
    const bits = Array.from({ length: 32 }, (_, k) => (1 << k) >>> 0);
    return bits.filter((bit) => (mask & bit) >>> 0).map((bit) => this.#c._ocisac_flag_name(bit))
      .filter((place) => place !== 0).map((place) => this.#c.UTF8ToString(place));
  }

  detect(frame, options) {
    return this.#within((memory) => {
      const { size } = STRUCTS.light;
      const lights = memory.bytes(size * MOST_LIGHTS);
      for (let k = 0; k < MOST_LIGHTS; ++k) this.#c._ocisac_light_init(lights + k * size);
      const found = memory.bytes(4);
      this.#check(this.#c._ocisac_detect(memory.options(options), memory.frame(frame), lights, MOST_LIGHTS, found));
      const count = Math.min(MOST_LIGHTS, this.#view().getUint32(found, true));
      return Array.from({ length: count }, (_, k) => this.#light(lights + k * size));
    });
  }

  calibrate(frame, frequency, options) {
    return this.#within((memory) => {
      const place = memory.struct("calibration");
      const asked = memory.options({ rowTime: 1, ...options });
      this.#check(this.#c._ocisac_calibrate(asked, memory.frame(frame), frequency, place));
      const found = this.#read("calibration", place);
      return { ...found, flags: this.flagNames(found.flags) };
    });
  }

  // The tone of a picture, its column and spectrum.
  findFrequency(frame, options) {
    return this.#within((memory) => {
      const asked = memory.options(options);
      const stored = memory.frame(frame);
      const tone = memory.struct("tone");
      const across = ["right", "left"].includes(options?.scanAxis);
      const region = options?.region;
      const rows = across ? region?.width ?? frame.width : region?.height ?? frame.height;
      const places = { column: rows, amplitude: 2 * rows + 1, response: 2 * rows + 1 };
      for (const name of Object.keys(places)) places[name] = [memory.bytes(8 * places[name]), places[name]];
      const pointers = Object.fromEntries(Object.entries(places).map(([name, [place]]) => [name, place]));
      this.#write("tone", tone, { ...pointers, rows });
      this.#check(this.#c._ocisac_find_frequency(asked, stored, tone));
      const found = this.#read("tone", tone);
      for (const [name, [place, count]] of Object.entries(places))
        found[name] = new Float64Array(this.#c.HEAPU8.slice(place, place + 8 * count).buffer);
      return { ...found, flags: this.flagNames(found.flags) };
    });
  }

  adviseExposure(request, avoided = []) {
    return this.#within((memory) => {
      const asked = memory.struct("exposure_request", request);
      const { size } = STRUCTS.flicker;
      const lights = memory.bytes(size * Math.max(1, avoided.length));
      avoided.forEach((light, k) => {
        this.#c._ocisac_flicker_init(lights + k * size);
        this.#write("flicker", lights + k * size, light);
      });
      const advice = memory.struct("exposure_advice");
      this.#check(this.#c._ocisac_advise_exposure(asked, avoided.length ? lights : 0, avoided.length, advice));
      const found = this.#read("exposure_advice", advice);
      return { ...found, holds: found.holds !== 0 };
    });
  }

  // Chips that transmit a payload, a string of 0 and 1.
  packetChips(payload, number = 0, options = {}) {
    return this.#within((memory) => {
      const asked = memory.options({ rowTime: 1, ...options });
      const bytes = memory.copy(payload);
      const count = memory.bytes(4);
      const call = (place, capacity) =>
        this.#check(this.#c._ocisac_packet_chips(asked, bytes, payload.length, number, place, capacity, count));
      call(0, 0);
      const all = this.#view().getUint32(count, true);
      const chips = memory.bytes(all);
      call(chips, all);
      return String.fromCharCode(...this.#c.HEAPU8.subarray(chips, chips + all));
    });
  }

  // A receiver of successive frames; free() it in the end.
  receiver(options) {
    const handle = this.#within((memory) => {
      const place = memory.bytes(4);
      this.#check(this.#c._ocisac_create(memory.options(options), place));
      return this.#view().getUint32(place, true);
    });
    return {
      push: (frame, stamp = {}) => this.#push(handle, frame, stamp),
      free: () => this.#c._ocisac_destroy(handle),
    };
  }

  #push(handle, frame, stamp) {
    return this.#within((memory) => {
      this.#check(this.#c._ocisac_push_stamped(handle, memory.frame(frame), memory.struct("stamp", stamp)));
      const place = memory.struct("result");
      const results = [];
      while (this.#check(this.#c._ocisac_poll(handle, place)) === 0) {
        const found = this.#read("result", place);
        const { payload, payloadBytes: bytes } = found;
        results.push({
          ...found,
          searched: found.searched !== 0,
          gainFlags: this.flagNames(found.gainFlags),
          dataFlags: this.flagNames(found.dataFlags),
          bits: this.#c.UTF8ToString(found.bits),
          payload: payload === 0 ? null : this.#c.HEAPU8.slice(payload, payload + bytes),
        });
      }
      return results;
    });
  }

  #light(place) {
    const found = this.#read("light", place);
    const reflectionOf = found.reflectionOf < 0 ? null : found.reflectionOf;
    return { ...found, carriesData: found.carriesData !== 0, reflectionOf, flags: this.flagNames(found.flags) };
  }

  #check(code) {
    if (code < 0) throw new OcisacError(this.#c.UTF8ToString(this.#c._ocisac_last_error()));
    return code;
  }

  // The memory may have grown, and its views with it.
  #view() {
    return new DataView(this.#c.HEAPU8.buffer);
  }

  #read(name, place, only) {
    const view = this.#view();
    const one = (kind, at) => ({
      u32: () => view.getUint32(at, true),
      i32: () => view.getInt32(at, true),
      f64: () => view.getFloat64(at, true),
      i64: () => Number(view.getBigInt64(at, true)),
    })[kind]();
    const value = (kind, at) => Array.isArray(kind)
      ? Object.fromEntries(kind.map(([part, type], k) => [part, one(type, at + 4 * k)]))
      : one(kind, at);
    const wanted = STRUCTS[name].places.filter((field) => !only || only.includes(field.name));
    return Object.fromEntries(wanted.map((field) => [field.name, value(field.kind, place + field.at)]));
  }

  #write(name, place, values) {
    const view = this.#view();
    const one = (kind, at, value) => ({
      u32: () => view.setUint32(at, value, true),
      i32: () => view.setInt32(at, value, true),
      f64: () => view.setFloat64(at, value, true),
      i64: () => view.setBigInt64(at, BigInt(value), true),
    })[kind]();
    const fields = Object.fromEntries(STRUCTS[name].places.map((field) => [field.name, field]));
    for (const [key, given] of Object.entries(values)) {
      if (given === undefined || given === null) continue;
      const field = fields[key];
      if (!field) throw new OcisacError(`${name}: got ${key}, allowed: ${Object.keys(fields).join(", ")}`);
      if (Array.isArray(field.kind)) {
        field.kind.forEach(([part, type], k) => one(type, place + field.at + 4 * k, given[part]));
        continue;
      }
      let value = given;
      if (typeof given === "string") {
        value = CHOICES[key]?.indexOf(given) ?? -1;
        if (value < 0) throw new OcisacError(`${key}: got ${given}, allowed: ${CHOICES[key]?.join(", ")}`);
      }
      one(field.kind, place + field.at, value);
    }
  }

  // Calls `use` with memory that is freed afterwards.
  #within(use) {
    const taken = [];
    const bytes = (count) => {
      const place = this.#c._malloc(Math.max(1, count));
      if (place === 0) throw new OcisacError("out of memory");
      taken.push(place);
      return place;
    };
    const copy = (array) => {
      const place = bytes(array.byteLength);
      this.#c.HEAPU8.set(new Uint8Array(array.buffer, array.byteOffset, array.byteLength), place);
      return place;
    };
    const struct = (name, values = {}) => {
      const place = bytes(STRUCTS[name].size);
      this.#c[`_ocisac_${name}_init`](place);
      this.#write(name, place, values);
      return place;
    };
    const frame = ({ pixels, width, height, number = 0 }) => {
      if (pixels.length !== width * height)
        throw new OcisacError(`pixels: got ${pixels.length}, allowed: width * height = ${width * height}`);
      const place = bytes(STRUCTS.frame.size);
      const wide = pixels instanceof Uint16Array;
      const stride = width * pixels.BYTES_PER_ELEMENT;
      this.#write("frame", place, { pixels: copy(pixels), format: wide ? 1 : 0, width, height, stride, number });
      return place;
    };
    try {
      return use({ bytes, copy, struct, frame, options: (values) => struct("options", values) });
    } finally {
      for (const place of taken) this.#c._free(place);
    }
  }
}
