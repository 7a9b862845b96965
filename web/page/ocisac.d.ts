// Times in s, frequencies in Hz, unknown numbers NaN. With a row time of 1: rows and cycles per row.

export interface Region { x: number; y: number; width: number; height: number }

/** A gray picture, rows one after the other; `number` ascends in a stream. */
export interface Frame { pixels: Uint8Array | Uint8ClampedArray | Uint16Array; width: number; height: number; number?: number }

export interface Options {
  rowTime: number;
  exposure?: number;
  frameTime?: number;
  /** of the tone; absent: estimated */
  frequency?: number;
  /** of the data; absent: estimated, which requires an exposure below a chip */
  chipRate?: number;
  senseFrequency?: number;
  darkLevel?: number;
  whiteLevel?: number;
  background?: number;
  duty?: number;
  waveform?: "tone" | "square";
  lineCode?: "none" | "manchester" | "4b6b" | "8b10b";
  blockBytes?: number;
  lengthened?: 0 | 1;
  wantGain?: 0 | 1;
  wantData?: 0 | 1;
  region?: Region;
  maxLights?: number;
  toneCurve?: "linear" | "srgb" | "gamma";
  gamma?: number;
  /** direction in which rows are exposed, in the stored picture */
  scanAxis?: "down" | "up" | "right" | "left";
}

export interface Light {
  box: Region;
  probability: number;
  frequency: number;
  frequencyStd: number;
  gain: number;
  gainStd: number;
  snr: number;
  phase: number;
  carriesData: boolean;
  reflectionOf: number | null;
  flags: string[];
}

export interface Tone {
  /** mean of the columns that show the tone, linear light, DN above dark */
  column: Float64Array;
  /** of the column over its mean, at multiples of `step` */
  amplitude: Float64Array;
  /** |sinc(f exposure)| at the same frequencies; NaN without an exposure */
  response: Float64Array;
  rows: number;
  step: number;
  frequency: number;
  frequencyStd: number;
  gain: number;
  gainStd: number;
  phase: number;
  mean: number;
  snr: number;
  theory: number;
  columns: number;
  flags: string[];
}

export interface Calibration { rowTime: number; rowTimeStd: number; flags: string[] }

export interface ExposureRequest {
  commFrequency?: number;
  senseFrequency?: number;
  commWeight?: number;
  senseWeight?: number;
  shortest?: number;
  longest?: number;
  step?: number;
  below?: number;
  near?: number;
  minGain?: number;
}

export interface FlickeringLight { frequency: number; uncertainty?: number; duty?: number; depth?: number }

export interface ExposureAdvice { exposure: number; objective: number; gain: number; modulation: number; holds: boolean }

/** One light in one frame. */
export interface Result {
  frame: number;
  source: number;
  region: Region;
  searched: boolean;
  gainFlags: string[];
  dataFlags: string[];
  frequency: number;
  frequencyStd: number;
  gain: number;
  gainStd: number;
  gainSnr: number;
  chipRate: number;
  rowsPerChip: number;
  /** row at which the first bit begins */
  firstBit: number;
  dataSnr: number;
  errorRate: number;
  exposure: number;
  suggestedExposure: number;
  bits: string;
  payload: Uint8Array | null;
  packet: number;
  packetShare: number;
}

export interface Receiver {
  push(frame: Frame, stamp?: { time?: number; exposure?: number; gain?: number }): Result[];
  free(): void;
}

/** An argument or a picture without meaning; the message says which and what is allowed. */
export class OcisacError extends Error {}

export interface Ocisac {
  readonly version: string;
  flagNames(mask: number): string[];
  detect(frame: Frame, options: Options): Light[];
  calibrate(frame: Frame, frequency: number, options?: Partial<Options>): Calibration;
  findFrequency(frame: Frame, options: Options): Tone;
  adviseExposure(request: ExposureRequest, avoided?: FlickeringLight[]): ExposureAdvice;
  packetChips(payload: Uint8Array, number?: number, options?: Partial<Options>): string;
  receiver(options: Options): Receiver;
}

export function load(options?: { wasm?: string }): Promise<Ocisac>;
