// Tells which frame a video element puts on the screen, and when.

const REFRESH_MS = 1000 / 60;

/**
 * When a frame of requestVideoFrameCallback is on the screen, in ms on `performance.now()`. Chromium tells that well of what
 * it plays from a file. Of WebRTC it gives times that are past; such frames are seen with the next refresh of the display.
 */
export function shownAt(now, { expectedDisplayTime, rtpTimestamp }) {
  return rtpTimestamp === undefined ? Math.max(now, expectedDisplayTime) : now + REFRESH_MS;
}

/**
 * Calls `callback(time, metadata)` for every new frame of `video` until the returned function is called.
 * time: ms on `performance.now()` at which the frame is on the screen.
 * metadata: `mediaTime` in seconds, and `rtpTimestamp` (90 kHz) where it came by WebRTC.
 */
export function watchFrames(video, callback) {
  let handle = 0;
  if ("requestVideoFrameCallback" in video) {
    const onFrame = (now, metadata) => {
      handle = video.requestVideoFrameCallback(onFrame);
      callback(shownAt(now, metadata), metadata);
    };
    handle = video.requestVideoFrameCallback(onFrame);
    return () => video.cancelVideoFrameCallback(handle);
  }
  // Browsers without the callback: look at the clock of the element on every refresh.
  let last = -1;
  const onRefresh = (now) => {
    handle = requestAnimationFrame(onRefresh);
    if (video.readyState < HTMLMediaElement.HAVE_CURRENT_DATA || video.currentTime === last) return;
    last = video.currentTime;
    callback(now, { mediaTime: last });
  };
  handle = requestAnimationFrame(onRefresh);
  return () => cancelAnimationFrame(handle);
}
