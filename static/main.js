// Puts the page together.

import { Api } from "./api.js";
import { Captions } from "./captions.js";
import { ServerClock } from "./clock.js";
import { Conversation } from "./conversation.js";
import { Download } from "./download.js";
import { HttpTransport } from "./http_transport.js";
import { IdleLoop } from "./idle.js";
import { explain, explainUnread, MESSAGES } from "./messages.js";
import { RtcTransport } from "./rtc_transport.js";
import { Seam } from "./seam.js";
import { Settings } from "./settings.js";
import { Sound } from "./sound.js";

const RETRY_MS = 3000;
const TRANSPORT_NAMES = { webrtc: "WebRTC", mp4: "MP4" };

const $ = (id) => document.getElementById(id);

const picture = $("picture");
const clock = new ServerClock();
const api = new Api(clock);
const idle = new IdleLoop($("idle"));
const sound = new Sound($("live"));
const seam = new Seam(picture, $("live"), idle, clock);
const parts = { api, seam, idle, video: $("live"), sound };
const conversation = new Conversation({
  seam,
  idle,
  clock,
  rtc: new RtcTransport(parts),
  http: new HttpTransport(parts),
});
const captions = new Captions($("caption"));
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

let avatars = [];
let askedWords = null;
let lastWords = null; // what the service has accepted: only that can be said again

function showState(state) {
  document.body.dataset.state = state;
  $("status").textContent = MESSAGES[state];
  $("stop").disabled = state === "loading" || state === "idle";
  $("speak").disabled = state === "loading";
  $("replay").disabled = state === "loading" || lastWords === null;
}

function showProblem(text) {
  $("problem").textContent = text;
  $("problem").hidden = !text;
}

function showNotice(text) {
  $("notice").textContent = text;
  $("notice").hidden = !text;
}

function speak(words, enteredAt) {
  showProblem("");
  showNotice("");
  if (!words.text) {
    showProblem(MESSAGES.blank);
    $("text").focus();
    return;
  }
  askedWords = words;
  conversation.say(words, enteredAt);
}

function speakText(enteredAt) {
  const { voice, speed } = settings.values;
  const words = { text: $("text").value.trim(), speed };
  if (voice) words.voice = voice;
  speak(words, enteredAt);
}

function applySettings() {
  sound.set(settings.values);
  captions.enabled = settings.values.captions;
  conversation.choose(settings.values);
}

async function showAvatar() {
  const avatar = avatars.find(({ id }) => id === settings.values.avatar);
  $("title").textContent = avatar.title;
  $("idle").poster = avatar.preview;
  await idle.load(avatar.idle, avatar.fps);
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
    $("text").addEventListener(name, () => document.body.dataset.state !== "loading" && conversation.prepare());
  }
  $("stop").addEventListener("click", () => conversation.stop());
  document.addEventListener("keydown", (event) => event.key === "Escape" && conversation.stop());
  $("replay").addEventListener("click", (event) => lastWords && speak(lastWords, event.timeStamp));
  $("unblock").addEventListener("click", () => sound.unblock());
  sound.onBlocked = (blocked) => {
    $("unblock").hidden = !blocked;
  };
  addEventListener("pagehide", () => conversation.close());

  settings.onChange = async (name) => {
    applySettings();
    if (name === "avatar") await showAvatar().catch((error) => showProblem(explain(error)));
  };

  conversation.addEventListener("state", ({ detail }) => {
    showState(detail.state);
    if (detail.state === "speaking") captions.begin(askedWords);
    else if (detail.state === "preparing") captions.clear();
  });
  conversation.addEventListener("problem", ({ detail }) => showProblem(detail.text));
  conversation.addEventListener("notice", ({ detail }) => showNotice(detail.text));
  conversation.addEventListener("accepted", ({ detail }) => {
    lastWords = askedWords;
    download.withdraw();
    $("replay").disabled = false;
    // What is typed next replaces what has just been said.
    if (document.activeElement === $("text") && $("text").value.trim() === lastWords.text) $("text").select();
    if (detail.utterance.unread?.length) showNotice(explainUnread(detail.utterance.unread));
  });
  conversation.addEventListener("shown", ({ detail }) => {
    const { stream, utterance, milliseconds, transport } = detail;
    $("latency").textContent = `First frame after ${Math.round(milliseconds)} ms · ${TRANSPORT_NAMES[transport]}`;
    Object.assign(picture.dataset, { latency: Math.round(milliseconds), transport, utterance: utterance.id });
    api.shown(stream, utterance.id, milliseconds).catch(() => {}); // a figure for the operator, nothing to the user
  });
  conversation.addEventListener("seam", ({ detail }) => {
    picture.dataset.seam = detail.frames.toFixed(2);
  });
  conversation.addEventListener("finished", ({ detail }) => {
    if (detail.completed) captions.complete();
    else captions.clear();
    if (detail.stream) download.offer(detail.stream, detail.utterance);
  });
}

async function start() {
  try {
    const [avatarList, voiceList] = await Promise.all([api.avatars(), api.voices()]);
    avatars = avatarList.avatars;
    settings.offer(avatarList, voiceList);
    applySettings();
    await showAvatar();
    showProblem("");
    showState("idle");
    if ($("text").value) conversation.prepare();
  } catch (error) {
    showProblem(`${explain(error)} ${MESSAGES.retrying}`);
    setTimeout(start, RETRY_MS);
  }
}

showState("loading");
// Before listening: focus given by the page itself is no sign that somebody is about to speak.
if (matchMedia("(hover: hover)").matches) $("text").focus({ preventScroll: true });
listen();
start();
