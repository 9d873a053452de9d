// The page around <mary-avatar>: what to say, settings, download.

import "./mary.js";
import { Api } from "./api.js";
import { ServerClock } from "./clock.js";
import { Download } from "./download.js";
import { FlvPlayback } from "./flv.js";
import { explain, explainUnread, MESSAGES } from "./messages.js";
import { Settings } from "./settings.js";

const RETRY_MS = 3000;
const TRANSPORT_NAMES = { webrtc: "WebRTC", mp4: "MP4", flv: "FLV" };

const $ = (id) => document.getElementById(id);

const picture = $("picture");
const api = new Api(new ServerClock());
const download = new Download($("download"));
const settings = new Settings({
  avatar: $("avatar"),
  voice: $("voice"),
  speed: $("speed"),
  speedValue: $("speed-value"),
  transport: $("transport"),
  volume: $("volume"),
  mute: $("mute"),
  captions: $("captions"),
});

let offered = false; // the service has said which avatars and voices there are
let lastWords = null; // what the service has accepted: only that can be said again

function showState() {
  const state = offered ? picture.state : "loading";
  const woken = document.body.dataset.state === "loading" && state !== "loading";
  document.body.dataset.state = state;
  $("status").textContent = MESSAGES[state];
  $("stop").disabled = state === "loading" || state === "idle";
  $("speak").disabled = state === "loading";
  $("replay").disabled = state === "loading" || lastWords === null;
  if (!woken) return;
  showProblem("");
  if ($("text").value) picture.prepare();
}

function showProblem(text) {
  $("problem").textContent = text;
  $("problem").hidden = !text;
}

function showNotice(text) {
  $("notice").textContent = text;
  $("notice").hidden = !text;
}

function speak({ text, voice, speed }, since) {
  showProblem("");
  showNotice("");
  if (!text) {
    showProblem(MESSAGES.blank);
    $("text").focus();
    return;
  }
  picture.say(text, { voice, speed, interrupt: true, since });
}

function speakText(since) {
  const { voice, speed } = settings.values;
  speak({ text: $("text").value.trim(), voice, speed }, since);
}

function applySettings() {
  const { avatar, voice, speed, transport, volume, muted, captions } = settings.values;
  Object.assign(picture, { avatar, voice, speed, transport, volume, muted, captions });
}

function listen() {
  $("composer").addEventListener("submit", (event) => {
    event.preventDefault();
    speakText(event.timeStamp);
  });
  $("text").addEventListener("keydown", (event) => {
    if (event.key !== "Enter" || event.shiftKey || event.isComposing) return;
    event.preventDefault();
    if (!event.repeat && document.body.dataset.state !== "loading") speakText(event.timeStamp);
  });
  for (const name of ["focus", "pointerdown", "input"]) {
    $("text").addEventListener(name, () => document.body.dataset.state !== "loading" && picture.prepare());
  }
  $("stop").addEventListener("click", () => picture.stop());
  document.addEventListener("keydown", (event) => event.key === "Escape" && picture.stop());
  $("replay").addEventListener("click", (event) => lastWords && speak(lastWords, event.timeStamp));
  settings.onChange = applySettings;

  picture.addEventListener("state", showState);
  picture.addEventListener("loaded", ({ detail }) => {
    $("title").textContent = detail.title;
  });
  picture.addEventListener("problem", (event) => {
    event.preventDefault(); // it has a better place here than on the picture
    showProblem(event.detail.text);
  });
  picture.addEventListener("notice", ({ detail }) => showNotice(detail.text));
  picture.addEventListener("accepted", ({ detail }) => {
    lastWords = { text: detail.text, voice: detail.voice, speed: detail.speed };
    download.withdraw();
    $("replay").disabled = false;
    // What is typed next replaces what has just been said.
    if (document.activeElement === $("text") && $("text").value.trim() === detail.text) $("text").select();
    if (detail.unread.length) showNotice(explainUnread(detail.unread));
  });
  picture.addEventListener("shown", ({ detail }) => {
    const { utterance, milliseconds, transport } = detail;
    $("latency").textContent = `First frame after ${Math.round(milliseconds)} ms · ${TRANSPORT_NAMES[transport]}`;
    Object.assign(picture.dataset, { latency: Math.round(milliseconds), transport, utterance });
  });
  picture.addEventListener("seam", ({ detail }) => {
    picture.dataset.seam = detail.frames.toFixed(2);
  });
  picture.addEventListener("speak_ended", ({ detail }) => download.offer(detail.video, detail.utterance));
}

async function start() {
  try {
    settings.offer(await api.avatars(), await api.voices());
    if (!(await FlvPlayback.available())) settings.withhold("flv");
    applySettings();
    offered = true;
    showState();
  } catch (error) {
    showProblem(`${explain(error)} ${MESSAGES.retrying}`);
    setTimeout(start, RETRY_MS);
  }
}

showState();
// Before listening: focus given by the page itself is no sign that somebody is about to speak.
if (matchMedia("(hover: hover)").matches) $("text").focus({ preventScroll: true });
listen();
start();
