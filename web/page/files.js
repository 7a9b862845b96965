// Pictures and raw frames of files, as they are stored: without rotation, colour management or smoothing.

// { pixels: RGBA bytes, width, height, channels: 4 }
export function pixelsOf(source, width, height) {
  const canvas = new OffscreenCanvas(width, height);
  const context = canvas.getContext("2d", { willReadFrequently: true });
  context.imageSmoothingEnabled = false;
  context.drawImage(source, 0, 0);
  return { pixels: context.getImageData(0, 0, width, height).data, width, height, channels: 4 };
}

export async function readPicture(file) {
  let bitmap;
  try {
    const stored = { imageOrientation: "none", colorSpaceConversion: "none", premultiplyAlpha: "none" };
    bitmap = await createImageBitmap(file, stored);
  } catch {
    throw new Error(`${file.name}: this browser cannot read it as a picture; it may be damaged`);
  }
  try {
    return pixelsOf(bitmap, bitmap.width, bitmap.height);
  } finally {
    bitmap.close();
  }
}

const TYPES = { "|u1": Uint8Array, "<u2": Uint16Array };

// Frames of a .npy array: (rows, columns) or (frames, rows, columns), uint8 or uint16.
export async function readArray(file) {
  const bytes = new Uint8Array(await file.arrayBuffer());
  const refuse = (what) => new Error(`${file.name}: ${what}`);
  if (bytes.length < 12 || String.fromCharCode(...bytes.subarray(1, 6)) !== "NUMPY") throw refuse("is no .npy array");
  const view = new DataView(bytes.buffer);
  const long = bytes[6] > 1;
  const start = long ? 12 : 10;
  const end = start + (long ? view.getUint32(8, true) : view.getUint16(8, true));
  const header = new TextDecoder("latin1").decode(bytes.subarray(start, end));
  const type = /'descr': *'([^']+)'/.exec(header)?.[1];
  const shape = /'shape': *\(([^)]*)\)/.exec(header)?.[1].split(",").filter((n) => n.trim()).map(Number);
  if (!TYPES[type]) throw refuse(`got ${type} values, allowed: uint8 and uint16`);
  if (/'fortran_order': *True/.test(header)) throw refuse("its columns are stored first, allowed: rows first");
  if (!shape || shape.length < 2 || shape.length > 3 || shape.some((n) => !(n > 0)))
    throw refuse(`got shape (${shape}), allowed: (rows, columns) or (frames, rows, columns)`);
  const [height, width] = shape.slice(-2);
  const frames = shape.length === 3 ? shape[0] : 1;
  const Type = TYPES[type];
  const size = width * height;
  if (bytes.length - end < frames * size * Type.BYTES_PER_ELEMENT) throw refuse("ends before its last frame");
  const all = new Type(bytes.slice(end, end + frames * size * Type.BYTES_PER_ELEMENT).buffer);
  return Array.from({ length: frames }, (_, k) =>
    ({ pixels: all.slice(k * size, (k + 1) * size), width, height, channels: 1 }));
}
