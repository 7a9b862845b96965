// Flashes the screen with the chips of a packet, in step with its pictures.
import { load } from "./ocisac.js";

const at = (id) => document.getElementById(id);
const form = at("packet").elements;
let ocisac = null;
let flashing = false;

function chips() {
  const pictures = Number(form.pictures.value);
  if (!(Number.isInteger(pictures) && pictures >= 1 && pictures <= 60))
    throw new Error(`Pictures for each chip: got ${form.pictures.value}, allowed: 1 to 60`);
  const options = { lineCode: form.lineCode.value, blockBytes: Number(form.blockBytes.value) };
  return { pictures, sent: ocisac.packetChips(new TextEncoder().encode(form.text.value), 0, options) };
}

function plan() {
  at("problem").textContent = "";
  at("start").disabled = true;
  try {
    const { pictures, sent } = chips();
    const seconds = (sent.length * pictures) / 60;
    at("plan").textContent = `${sent.length} chips, ${(60 / pictures).toFixed(1)} a second on a display of 60 Hz: ${seconds.toFixed(0)} s for a whole cycle.`;
    at("start").disabled = false;
  } catch (problem) {
    at("plan").textContent = "Nothing to send.";
    at("problem").textContent = problem.message;
  }
}

function flash() {
  const { pictures, sent } = chips();
  const dialog = at("flash");
  flashing = true;
  dialog.showModal();
  let shown = 0;
  const next = () => {
    if (!flashing) return;
    dialog.style.background = sent[Math.floor(shown++ / pictures) % sent.length] === "1" ? "#fff" : "#000";
    requestAnimationFrame(next);
  };
  requestAnimationFrame(next);
}

function end() {
  flashing = false;
  at("flash").close();
}

at("start").addEventListener("click", flash);
at("flash").addEventListener("click", end);
at("flash").addEventListener("keydown", end);
at("flash").addEventListener("close", () => (flashing = false));
at("packet").addEventListener("input", plan);
at("packet").addEventListener("submit", (submitted) => submitted.preventDefault());
load().then((loaded) => {
  ocisac = loaded;
  plan();
}, (problem) => (at("problem").textContent = problem.message));
