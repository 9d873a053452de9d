// Tells which frame a video element puts on the screen, and when.

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
      callback(Math.max(now, metadata.expectedDisplayTime), metadata);
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
