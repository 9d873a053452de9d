// Looks at what <mary-avatar> shows at every refresh of the display. For bench/seams.py.
//
// A look is {at, live, frame, since, light, moved, apart}: page time in ms; whether the live picture is seen, not the idle
// clip; the frame of the loop that came up last (of the live picture, by what speak_started says of its first one) and the
// time at which the screen shows it (see onScreen); mean luma of
// the upper face; how far the head has moved, in pixels of the avatar's picture, null while the picture is the same; and,
// if asked for, the mean difference of luma between the mouths of both videos: small if hers is as closed as the clip's.

const HEAD = [152, 60, 208, 140]; // hair and forehead of the 512x512 picture: no part that moves by itself
const MOUTH = [208, 296, 104, 64];
const SCALE = 2; // pixels of the picture to one that is looked at
const FPS = 25;
const FRAMES = 125; // of the loop
const REFRESH = 1000 / 60; // ms

// Found by comparing with the pictures of Page.startScreencast, whose head tells the frame of the loop to 0.1: Chromium's
// expectedDisplayTime is right for files; what came by WebRTC is seen a refresh after its callback. Without this the phase
// would be wrong by half a frame, in opposite directions for the two ways.
const onScreen = (now, { expectedDisplayTime, rtpTimestamp }) =>
  rtpTimestamp === undefined ? Math.max(now, expectedDisplayTime) : now + REFRESH;

function eye(video) {
  const of = ([, , width, height]) => {
    const canvas = Object.assign(document.createElement("canvas"), { width: width / SCALE, height: height / SCALE });
    return canvas.getContext("2d", { willReadFrequently: true });
  };
  const contexts = new Map([HEAD, MOUTH].map((area) => [area, of(area)]));
  return (area) => {
    const context = contexts.get(area);
    const { width, height } = context.canvas;
    if (video.readyState < HTMLMediaElement.HAVE_CURRENT_DATA) return null;
    context.drawImage(video, ...area, 0, 0, width, height);
    const { data } = context.getImageData(0, 0, width, height);
    const luma = new Float32Array(width * height);
    for (let i = 0; i < luma.length; i += 1) luma[i] = 0.299 * data[4 * i] + 0.587 * data[4 * i + 1] + 0.114 * data[4 * i + 2];
    return { luma, width, height };
  };
}

const mean = (values) => values.reduce((sum, value) => sum + value, 0) / values.length;

// Length of the translation that takes one image to the other best, to first order (Lucas and Kanade 1981).
function displacement(a, b) {
  const { luma, width, height } = a;
  let xx = 0, xy = 0, yy = 0, xt = 0, yt = 0;
  for (let y = 1; y < height - 1; y += 1) {
    for (let x = 1; x < width - 1; x += 1) {
      const i = y * width + x;
      const dx = (luma[i + 1] - luma[i - 1] + b.luma[i + 1] - b.luma[i - 1]) / 4;
      const dy = (luma[i + width] - luma[i - width] + b.luma[i + width] - b.luma[i - width]) / 4;
      const dt = b.luma[i] - luma[i];
      xx += dx * dx; xy += dx * dy; yy += dy * dy; xt += dx * dt; yt += dy * dt;
    }
  }
  const determinant = xx * yy - xy * xy;
  return (SCALE * Math.hypot(yy * xt - xy * yt, xx * yt - xy * xt)) / determinant;
}

function watch(avatar) {
  const [idle, live] = ["idle", "live"].map((id) => avatar.shadowRoot.getElementById(id));
  const eyes = { idle: eye(idle), live: eye(live) };
  const start = idle.buffered.start(0) < 1 / FPS ? idle.buffered.start(0) : 0;
  const frames = { idle: null, live: null };
  const times = { idle: null, live: null };
  const looks = [];
  let started = null, lag = null, first = true, seen = null, mouths = false, stopped = false;

  const follow = (video, name, place) => {
    const onFrame = (now, metadata) => {
      frames[name] = place(metadata);
      times[name] = onScreen(now, metadata);
      video.requestVideoFrameCallback(onFrame);
    };
    video.requestVideoFrameCallback(onFrame);
  };
  follow(idle, "idle", ({ mediaTime }) => Math.round((mediaTime - start) * FPS) % FRAMES);
  follow(live, "live", ({ mediaTime, rtpTimestamp }) => {
    if (rtpTimestamp === undefined) lag = 0; // the file is on the service's clock
    return rtpTimestamp === undefined ? mediaTime : rtpTimestamp / 90_000;
  });
  avatar.addEventListener("speak_started", ({ detail }) => {
    started = detail;
    first = true;
  });

  const tick = (at) => {
    if (stopped) return;
    requestAnimationFrame(tick);
    const name = avatar.live ? "live" : "idle";
    const head = eyes[name](HEAD);
    if (!head) return;
    if (name === "live" && first && started) {
      first = false;
      // The first frame may be missing; so of all utterances the smallest lag is right.
      lag = Math.min(lag ?? Infinity, frames.live - started.media_time);
    }
    const media = lag === null ? null : frames.live - lag;
    const frame = name === "idle" ? frames.idle : media && started.loop_frame + (media - started.media_time) * FPS;
    const fresh = !seen || name !== seen.name || mean(head.luma.map((value, i) => Math.abs(value - seen.head.luma[i]))) > 0;
    const look = { at, live: avatar.live, frame, since: times[name], light: mean(head.luma), moved: null, apart: null };
    looks.push(look);
    if (fresh && seen) look.moved = displacement(seen.head, head);
    if (fresh) seen = { name, head };
    if (!avatar.live || !mouths) return;
    const [closed, speaking] = [eyes.idle(MOUTH), eyes.live(MOUTH)];
    look.apart = closed && mean(closed.luma.map((value, i) => Math.abs(value - speaking.luma[i])));
  };
  requestAnimationFrame(tick);
  return {
    /** What was seen since it was last asked for. */
    take: () => looks.splice(0),
    /** Look at mouths, too. */
    lookAtMouths: () => {
      mouths = true;
    },
    /** Stops her while her mouth is open: resolves to the page time at which `stop` was called. */
    interrupt: (open) =>
      new Promise((resolve) => {
        const look = () => {
          if (!(looks.at(-1)?.apart > open)) return requestAnimationFrame(look);
          const at = performance.now();
          avatar.stop();
          return resolve(at);
        };
        look();
      }),
    end: () => {
      stopped = true;
    },
  };
}
